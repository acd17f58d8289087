"""Measures how long the window needs for another snapshot, apart from drawing it: `python scripts/scrubbing.py RUN`.

RUN is the folder of a training, for instance of 50,000 vertices with 100 snapshots. Every snapshot is shown once, in order, for
each colouring and both kinds of shading. Printed are the median and the 95th percentile over the snapshots: of the time that
passed, which grows with whatever else the machine does, and of the processor's time of the window's thread. Drawing is switched
off. Without a display it starts itself again under xvfb-run.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pictures import Stage, settle

if TYPE_CHECKING:
    from dmp_viewer.controller import Controller


def measure(controller: Controller) -> tuple[list[float], list[float]]:
    """Show every snapshot once; returns what each took, milliseconds: on the clock, and of the processor."""
    passed, worked = [], []
    for step in controller.workspace.snapshot_steps:
        clock, processor = time.perf_counter(), time.thread_time()
        controller.workspace.show_step(step)
        controller.presenter.flush()
        passed.append((time.perf_counter() - clock) * 1000)
        worked.append((time.thread_time() - processor) * 1000)
    return passed, worked


def report(run: Path) -> None:
    """Print the times for a run."""
    import torch

    from dmp_viewer import startup
    from dmp_viewer.app import make_application
    from dmp_viewer.colors import QUANTITIES

    torch.set_num_threads(1)
    startup.set_surface_format()
    application = make_application()
    startup.probe_opengl()
    with tempfile.TemporaryDirectory() as folder, Stage(Path(folder), size=(1280, 800)) as controller:
        controller.opener.open_path(run)
        settle(controller)
        workspace = controller.workspace
        assert workspace.problem is not None
        count, steps = workspace.problem.mesh.n_vertices, len(workspace.snapshot_steps)
        print(f"{count:,} vertices, {steps} snapshots; milliseconds a snapshot: median, 95th percentile")
        controller.window.panes.interactor.setUpdatesEnabled(False)
        for shading in ("flat", "smooth"):
            for quantity in QUANTITIES:
                if not workspace.colors.can_show(quantity):
                    continue
                workspace.look.set(shading=shading)
                workspace.colors.set(quantity=quantity)
                settle(controller)
                times = [np.percentile(values, [50, 95]) for values in measure(controller)]
                passed, worked = (f"{middle:6.1f} {high:6.1f}" for middle, high in times)
                print(f"{shading:7} {quantity:15} passed {passed}   worked {worked}", flush=True)
    application.quit()


def main() -> int:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description="Measure how long the window needs for another snapshot.")
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a training")
    arguments = parser.parse_args()
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        server = shutil.which("xvfb-run")
        if server is None:
            print("There is no display, and xvfb-run is not installed.", file=sys.stderr)
            return 2
        command = [server, "-a", "-s", "-screen 0 1400x900x24", sys.executable, *sys.argv]
        return subprocess.run(command, check=False).returncode
    report(arguments.run.absolute())
    return 0


if __name__ == "__main__":
    sys.exit(main())
