"""Opens a mesh, trains a little, stops and closes, hundreds of times in one process; nothing may pile up.

Every tenth time the whole window is closed and a new one is made; before that, memory, threads, open files and widgets are
measured. Those of the last tenth must be those of the second tenth (the first one loads what is needed).
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.soak import Result
from tests.soak.windows import WITHOUT_DISPLAY, has_display, told_by_child

if TYPE_CHECKING:
    from dmp_viewer.model import Workspace

FULL_SIZE = 500
_STEPS = 5
_ROUNDS_OF_A_WINDOW = 10
_MOST_MEMORY_MB = 50.0
_MOST_MORE = {"threads": 2.0, "python_threads": 0.0, "files": 2.0, "widgets": 20.0}


def run(size: int, seed: int) -> Result:
    """Do ``size`` rounds in one process."""
    name = "rounds of opening, training, stopping and closing in one process, nothing piles up"
    if not has_display():
        return Result(name, 0, 0, (WITHOUT_DISPLAY,))
    with tempfile.TemporaryDirectory(prefix="dmp-cycles-") as folder:
        told, wrong = told_by_child("cycles", size, seed, folder, folder=Path(folder), seconds=600 + 30 * size)
    rounds = [line for line in told if "faults" in line]
    measured = [line for line in rounds if "memory" in line]
    failures = [f"round {line['round']}: {text}" for line in rounds for text in line["faults"]]
    piled_up = grown(measured)
    failures += [*piled_up, *([wrong] if wrong else [])]
    held = max(0, sum(not line["faults"] for line in rounds) - len(piled_up))
    if measured:
        first, last = measured[len(measured) // 10], measured[-1]
        seen = (f"{what} {first[what]:.0f} after a tenth and {last[what]:.0f} at the end" for what in ("memory", *_MOST_MORE))
        failures.append(f"Used: {', '.join(seen)}.")
    return Result(name, held, size, tuple(failures))


def grown(measured: list[dict[str, Any]]) -> list[str]:
    """Return what has grown from the second tenth of the measurements to the last one."""
    if len(measured) < 3:
        return []
    tenth = max(1, len(measured) // 10)
    before, after = measured[tenth : 2 * tenth], measured[-tenth:]
    failures = []
    for what, most in {"memory": _MOST_MEMORY_MB, **_MOST_MORE}.items():
        values = [float(np.median([line[what] for line in part])) for part in (before, after)]
        if values[1] > values[0] + most:
            failures.append(f"{what} grew from {values[0]:.0f} to {values[1]:.0f}")
    return failures


def main(size: int, seed: int, folder: Path) -> None:
    """In the child: do the rounds, and tell what is used after each."""
    from tests.soak import window_child as child

    random = np.random.default_rng(seed)
    meshes = child.write_samples(folder)[:3]
    _, faults = child.begin()
    settings = child.quick()
    controller = None
    for number in range(size):
        child.watch(f"round {number}")
        if controller is None:
            controller = child.new_window(folder, faults, settings)
        mesh = meshes[int(random.integers(len(meshes)))]
        task = "complete" if mesh.name == "sheet.ply" else "denoise"
        controller.window.panel.set_settings(child.quick(task=task, preset=("compact", "best")[int(random.integers(2))]))
        controller.opener.open_path(mesh)
        if not controller.background.wait(child.HANG_SECONDS):
            faults.found.append("the mesh was not opened")
        child.pump(0.05)
        controller.start()
        if not child.wait_until(partial(_has_reached, controller.workspace, _STEPS)):
            faults.found.append(f"step {_STEPS} was not reached")
        controller.runner.stop()
        if not controller.runner.wait(child.HANG_SECONDS):
            faults.found.append("the training did not stop")
        child.pump(0.1)
        is_measured = number % _ROUNDS_OF_A_WINDOW == _ROUNDS_OF_A_WINDOW - 1
        measures = child.used() if is_measured else {}
        if is_measured:
            child.end_window(controller)
            controller = None
        _forget_old_runs(folder / "runs")
        child.tell(round=number, faults=faults.found, **measures)
        faults.found.clear()
    child.finish()


def _has_reached(workspace: Workspace, step: int) -> bool:
    return workspace.run is not None and workspace.current_step >= step


def _forget_old_runs(folder: Path) -> None:
    """Leave the three newest runs, so that the list of runs stays short."""
    for path in sorted(folder.glob("*"), key=lambda path: path.stat().st_mtime)[:-3]:
        shutil.rmtree(path, ignore_errors=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
