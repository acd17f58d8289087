"""Trains a small mesh in the window for a long time: a step at the end is as fast as one at the beginning, memory is flat.

Measured are seconds of the processor, which other work on the machine changes little: those of the whole process, drawing
included, for each step. The first tenth is left out, in which the window loads what it needs.
"""

from __future__ import annotations

import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tests.soak import Result
from tests.soak.windows import WITHOUT_DISPLAY, has_display, told_by_child

# Minutes.
FULL_SIZE = 20
_MOST_SLOWER = 1.15
_MOST_MEMORY_MB = 50.0


def run(size: int, seed: int) -> Result:
    """Train for ``size`` minutes."""
    return measured(60.0 * size, seed)


def measured(seconds: float, seed: int) -> Result:
    """Train for so many seconds, and compare the second tenth with the last one."""
    name = f"tenths of a training of {seconds / 60:.0f} minutes with an even pace and flat memory"
    if not has_display():
        return Result(name, 0, 0, (WITHOUT_DISPLAY,))
    with tempfile.TemporaryDirectory(prefix="dmp-pace-") as folder:
        told, wrong = told_by_child("pace", seconds, seed, folder, folder=Path(folder), seconds=seconds + 300)
    tenths = [line for line in told if "memory" in line]
    if wrong or len(tenths) < 11:
        return Result(name, 0, 10, (wrong or "it ended early",))
    failures, summary = judged(tenths)
    return Result(name, 10 - min(10, len(failures)), 10, (*failures, summary))


def judged(tenths: list[dict[str, Any]]) -> tuple[list[str], str]:
    """Tell where a training became slower or took more memory.

    Args:
        tenths: step, memory, seconds of the processor and faults at the beginning and after each tenth.

    Returns:
        A sentence for each failure, and one with the numbers.
    """
    failures = [f"tenth {index}: {text}" for index, line in enumerate(tenths) for text in line["faults"]]
    costs = [
        (after["seconds"] - before["seconds"]) / max(after["step"] - before["step"], 1) for before, after in pairwise(tenths)
    ]
    usual, memory = float(np.median(costs[1:4])), tenths[2]["memory"]
    for index, (cost, line) in enumerate(zip(costs, tenths[1:], strict=True)):
        if index > 0 and cost > _MOST_SLOWER * usual:
            failures.append(f"tenth {index}: a step took {1000 * cost:.2f} ms of the processor instead of {1000 * usual:.2f}")
        if index > 1 and line["memory"] > memory + _MOST_MEMORY_MB:
            failures.append(f"tenth {index}: {line['memory']:.0f} MB instead of {memory:.0f}")
    told_costs = ", ".join(f"{1000 * cost:.2f}" for cost in costs)
    told_memory = ", ".join(f"{line['memory']:.0f}" for line in tenths)
    return failures, f"{tenths[-1]['step']:,} steps; ms a step: {told_costs}; MB: {told_memory}"


def main(seconds: float, seed: int, folder: Path) -> None:
    """In the child: train, and tell ten times what is used."""
    from tests.soak import window_child as child

    mesh = child.write_samples(folder)[0]
    _, faults = child.begin()
    # So many snapshots as a training of hours has.
    settings = child.quick(steps=1_000_000, snapshot_every=1000, log_every=10, seed=seed)
    controller = child.new_window(folder, faults, settings)
    child.watch("opening")
    controller.opener.open_path(mesh)
    controller.background.wait(child.HANG_SECONDS)
    controller.start()
    child.wait_until(lambda: controller.workspace.run is not None and controller.workspace.current_step > 10)
    started = time.monotonic()
    for tenth in range(11):
        while time.monotonic() < started + seconds * tenth / 10:
            child.watch(f"tenth {tenth}")
            child.pump(min(5.0, seconds / 10))
        child.tell(step=controller.workspace.current_step, faults=faults.found, **child.used())
        faults.found.clear()
    controller.runner.stop()
    controller.runner.wait(child.HANG_SECONDS)
    child.finish()


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
