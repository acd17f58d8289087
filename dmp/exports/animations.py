"""Which steps an animation shows, and how fast."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmp.errors import DmpError

# More would make a GIF of hundreds of megabytes.
MOST_FRAMES = 2000
_USUAL_FPS, _TURNING_FPS, _TURNING_SECONDS = 10.0, 15.0, 6.0


@dataclass(frozen=True)
class Plan:
    """What is wished.

    Attributes:
        is_turntable: one step is turned once around; otherwise all steps go by.
        step: that step.
        first, last: between which steps; None is the end.
        turn: by how much the mesh turns meanwhile, degrees.
        seconds: how long it takes; None is a frame for each step.
        frames_per_second: None is the usual.
        hold_seconds: for how long the last frame stays, which a turntable does not.
    """

    is_turntable: bool = False
    step: int = 0
    first: int = 0
    last: int | None = None
    turn: float = 0.0
    seconds: float | None = None
    frames_per_second: float | None = None
    hold_seconds: float = 2.0


@dataclass(frozen=True)
class Frames:
    """The steps of all frames in their order, how fast they go by, and for how long the last one stays."""

    steps: list[int]
    frames_per_second: float
    hold_seconds: float


def planned(plan: Plan, steps: Sequence[int]) -> Frames:
    """Return the frames of an animation.

    Args:
        plan: what is wished.
        steps: the snapshots of the run, ascending.

    Raises:
        DmpError: when there is nothing to show, or too much.
    """
    fps = plan.frames_per_second or (_TURNING_FPS if plan.is_turntable else _USUAL_FPS)
    if not 0.1 <= fps <= 60:
        raise DmpError(f"{fps:g} frames per second are not possible: choose between 0.1 and 60.")
    if plan.seconds is not None and not plan.seconds > 0:
        raise DmpError("An animation must last longer than 0 seconds.")
    if plan.is_turntable:
        count = max(2, round(fps * (plan.seconds or _TURNING_SECONDS)))
        chosen, hold = [plan.step] * min(count, MOST_FRAMES + 1), 0.0
    else:
        shown = [step for step in steps if plan.first <= step <= (steps[-1] if plan.last is None else plan.last)]
        if not shown:
            raise DmpError(f"The run has no snapshot from step {plan.first} to {plan.last}, so there is nothing to animate.")
        count = len(shown) if plan.seconds is None else max(1, round(fps * plan.seconds))
        places = np.linspace(0, len(shown) - 1, min(count, MOST_FRAMES + 1)).round().astype(int)
        chosen, hold = [shown[place] for place in places], max(0.0, plan.hold_seconds)
    if len(chosen) > MOST_FRAMES:
        raise DmpError(f"That would be more than {MOST_FRAMES:,} frames. Choose a shorter time or fewer frames per second.")
    return Frames(chosen, fps, hold)
