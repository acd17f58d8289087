"""Each part of the endurance checks at a size that fits the tests."""

from __future__ import annotations

import os

import pytest

from tests.soak import clicking, cycles, disks, folders, kills, pace, scales, signals

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a system that can fork")


@pytest.fixture(autouse=True)
def _no_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a killed process has written is in the system's hands; only a power failure needs the disk itself."""
    monkeypatch.setattr(os, "fsync", lambda _descriptor: None)


# A fork of a process with threads is safe here: the child leaves by itself, and uses one thread only.
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_kills(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kills, "CASES", kills.CASES[:1])
    result = kills.run(2, seed=1)
    assert result.details == ()
    assert result.passed == result.total >= 2


def test_folders() -> None:
    result = folders.run(15, seed=1)
    assert result.details == ()
    assert result.passed == result.total == 15


def test_scales() -> None:
    result = scales.run(3, seed=1)
    assert result.details == ()
    assert result.passed == result.total == 3


def test_disks() -> None:
    result = disks.run(2, seed=1)
    if not result.total:
        pytest.skip(result.details[0])
    assert result.details == ()
    assert result.passed == result.total == 2


def test_signals() -> None:
    """One to a window, one to a command."""
    result = signals.run(2, seed=1)
    if not result.total:
        pytest.skip(result.details[0])
    assert result.details == ()
    assert result.passed == result.total == 2


def test_cycles() -> None:
    result = cycles.run(2, seed=1)
    if not result.total:
        pytest.skip(result.details[0])
    assert result.details == ()
    assert result.passed == result.total == 2


def test_what_piles_up_is_found() -> None:
    even = {"memory": 500.0, "threads": 12.0, "python_threads": 3.0, "files": 11.0, "widgets": 500.0}
    assert cycles.grown([even] * 20) == []
    leaking = [{**even, "files": 11.0 + number} for number in range(20)]
    assert cycles.grown(leaking) == ["files grew from 14 to 30"]


def test_clicking() -> None:
    result = clicking.run(30, seed=1)
    if not result.total:
        pytest.skip(result.details[0])
    assert result.details == ()
    assert result.passed == result.total == 30


def test_a_training_that_slows_down_or_grows_is_found() -> None:
    def tenths(cost: float, growth: float) -> list[dict[str, object]]:
        times = [0.01 * 100 * tenth + cost * max(0, tenth - 5) for tenth in range(11)]
        return [
            {"step": 100 * tenth, "seconds": times[tenth], "memory": 600 + growth * tenth, "faults": []} for tenth in range(11)
        ]

    assert pace.judged(tenths(0.1, 5.0))[0] == []
    assert [failure.partition(":")[0] for failure in pace.judged(tenths(0.2, 0.0))[0]] == [f"tenth {n}" for n in range(5, 10)]
    assert [failure.partition(":")[0] for failure in pace.judged(tenths(0.0, 10.0))[0]] == ["tenth 7", "tenth 8", "tenth 9"]
