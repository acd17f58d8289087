from __future__ import annotations

import pytest

from dmp.errors import DmpError
from dmp.exports.animations import MOST_FRAMES, Plan, planned


def test_without_a_length_each_step_is_a_frame() -> None:
    frames = planned(Plan(), [0, 5, 10, 15])
    assert (frames.steps, frames.frames_per_second, frames.hold_seconds) == ([0, 5, 10, 15], 10.0, 2.0)


def test_a_length_spreads_the_steps_evenly_from_the_first_to_the_last() -> None:
    frames = planned(Plan(seconds=2.0, frames_per_second=4.0), [0, 5, 10])
    assert len(frames.steps) == 8
    assert (frames.steps[0], frames.steps[-1]) == (0, 10)
    assert frames.steps == sorted(frames.steps)
    assert planned(Plan(seconds=0.5, frames_per_second=4.0), list(range(101))).steps == [0, 100]


def test_a_part_of_the_steps() -> None:
    assert planned(Plan(first=5, last=10), [0, 5, 10, 15]).steps == [5, 10]


def test_a_turntable_shows_one_step_and_does_not_rest_at_its_end() -> None:
    frames = planned(Plan(is_turntable=True, step=10, seconds=2.0), [0, 5, 10])
    assert frames.steps == [10] * 30
    assert frames.hold_seconds == 0


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        (Plan(first=6, last=8), "no snapshot from step 6 to 8"),
        (Plan(frames_per_second=100), "100 frames per second"),
        (Plan(seconds=0.0), "longer than 0"),
        (Plan(seconds=1e9), f"more than {MOST_FRAMES:,} frames"),
        (Plan(is_turntable=True, seconds=1e6), "frames"),
    ],
)
def test_what_cannot_be_is_one_sentence(plan: Plan, words: str) -> None:
    with pytest.raises(DmpError, match=words):
        planned(plan, [0, 5, 10])
