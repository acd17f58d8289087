"""Contestants that take turns."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Timing:
    """Medians over the rounds.

    Attributes:
        seconds: wall time.
        processor_seconds: time that the processor spent on this process, all threads together; other programs on the
            machine hardly change it.
    """

    seconds: float
    processor_seconds: float


def _nothing() -> None:
    pass


def take_turns(
    contestants: Mapping[str, Callable[[], object]],
    rounds: int,
    *,
    warm_up: int = 1,
    finish: Callable[[], object] = _nothing,
) -> dict[str, Timing]:
    """Time each contestant once a round, so that whatever else the machine does meets all of them.

    Args:
        contestants: by name.
        rounds: that count.
        warm_up: rounds before those.
        finish: waits until what a contestant has begun is done; its time counts.
    """
    wall: dict[str, list[float]] = {name: [] for name in contestants}
    processor: dict[str, list[float]] = {name: [] for name in contestants}
    for number in range(-warm_up, rounds):
        for name, run in contestants.items():
            wall_before, processor_before = time.perf_counter(), time.process_time()
            run()
            finish()
            if number >= 0:
                wall[name].append(time.perf_counter() - wall_before)
                processor[name].append(time.process_time() - processor_before)
    return {name: Timing(statistics.median(wall[name]), statistics.median(processor[name])) for name in contestants}
