"""What the window checks share in their child process: the window itself, what it must never say, and what it uses."""

from __future__ import annotations

import faulthandler
import gc
import json
import logging
import os
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch  # noqa: F401  # before Qt, as in the application
from qtpy.QtCore import QCoreApplication
from qtpy.QtWidgets import QApplication

from dmp.errors import DmpError
from dmp.meshio import write_mesh
from dmp.settings import Settings, settings_for
from dmp.shapes.alterations import with_holes
from dmp_viewer import startup
from dmp_viewer.app import make_application
from dmp_viewer.controller import Controller
from dmp_viewer.settings import Preferences
from dmp_viewer.shutdown import destroy
from dmp_viewer.tasks import TASKS
from dmp_viewer.views.main_window import MainWindow
from tests.meshes import grid_mesh, sphere_mesh

# An action that lasts longer is a hang; long enough for a machine that does other things as well.
HANG_SECONDS = 120.0


class Faults(logging.Handler):
    """Collects everything that must never happen: errors that nobody caught, and those that the window calls its own."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.found: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Note an error that was logged, with where it comes from."""
        text = record.getMessage()
        if record.exc_info and isinstance(record.exc_info[1], DmpError):
            return  # told in a sentence made for people
        if record.exc_info and record.exc_info[1] is not None:
            error, trace = record.exc_info[1], record.exc_info[2]
            while trace is not None and trace.tb_next is not None:
                trace = trace.tb_next
            place = "" if trace is None else f" at {Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno}"
            text = f"{text}: {type(error).__name__}: {error}{place}"
        self.found.append(text)

    def on_told(self, text: str) -> None:
        """Note what the window says, when that is a fault of the program."""
        if "went wrong inside the program" in text:
            self.found.append(text)


def begin() -> tuple[QApplication, Faults]:
    """Return the application and what collects its faults."""
    startup.set_surface_format()
    application = make_application()
    startup.probe_opengl()
    application.setQuitOnLastWindowClosed(False)
    faults = Faults()
    logging.getLogger("dmp_viewer").addHandler(faults)
    return application, faults


def new_window(folder: Path, faults: Faults, settings: Settings) -> Controller:
    """Return a window on screen whose runs and preferences lie in a folder."""
    window = MainWindow(multi_samples=0, tasks=TASKS)
    controller = Controller(window, Preferences(theme="light"), folder / "window.json", runs_folder=folder / "runs")
    startup.install_hooks(controller.tell_error)
    controller.errorTold.connect(faults.on_told)
    window.panel.set_settings(settings)
    window.resize(1100, 750)
    window.show()
    pump(0.1)
    return controller


def end_window(controller: Controller) -> None:
    """Close a window and forget it."""
    controller.window.close_guard = lambda: True
    controller.runner.stop()
    controller.runner.wait(HANG_SECONDS)
    controller.queue.close()
    controller.leave()
    controller.window.close()
    destroy(controller.window)
    pump(0.02)


def pump(seconds: float) -> None:
    """Let the window do what it has to for a while."""
    deadline = time.monotonic() + seconds
    while True:
        QCoreApplication.processEvents()
        if time.monotonic() >= deadline:
            return
        time.sleep(0.002)


def wait_until(condition: Callable[[], bool], seconds: float = HANG_SECONDS) -> bool:
    """Pump events until something holds; tells whether it did in time."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        pump(0.01)
    return True


def watch(what: str) -> None:
    """Take note of what begins now; when it takes too long, the process ends with the places where it hangs."""
    faulthandler.dump_traceback_later(HANG_SECONDS, exit=True)
    print(json.dumps({"begun": what}), flush=True)


def used() -> dict[str, float]:
    """Return what the process uses: memory in MB, threads, open files, widgets, seconds of the processor."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    application = QApplication.instance()
    return {
        "memory": pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        "threads": float(len(list(Path("/proc/self/task").iterdir()))),
        "python_threads": float(threading.active_count()),
        "files": float(len(list(Path("/proc/self/fd").iterdir()))),
        "widgets": float(len(application.allWidgets()) if isinstance(application, QApplication) else 0),
        "seconds": time.process_time(),
    }


def tell(**values: Any) -> None:
    """Tell the parent process something."""
    print(json.dumps(values), flush=True)


def quick(**changes: Any) -> Settings:
    """Return settings for a training that is quick and goes on as long as it may."""
    return settings_for(**{"steps": 2000, "snapshot_every": 2, "log_every": 1, "threads": 1, "width_divisor": 16, **changes})


def write_samples(folder: Path) -> list[Path]:
    """Write meshes that are good, odd, large, small, with holes and broken; return their paths, the good ones first."""
    ball = sphere_mesh(3)
    random = np.random.default_rng(0)
    noisy = ball.with_vertices(ball.vertices + 0.02 * random.standard_normal(ball.vertices.shape))
    write_mesh(folder / "ball.ply", noisy)
    write_mesh(folder / "small.obj", sphere_mesh(1))
    write_mesh(folder / "sheet.ply", with_holes(grid_mesh(16, height=0.05), [(7.0, 7.0, 0.0)], [9]))
    write_mesh(folder / "far.ply", noisy.with_vertices(noisy.vertices + 1e6))
    good = [folder / name for name in ("ball.ply", "small.obj", "sheet.ply", "far.ply")]
    (folder / "broken.ply").write_bytes((folder / "ball.ply").read_bytes()[:-7])
    (folder / "empty.obj").write_bytes(b"")
    (folder / "text.stl").write_text("no mesh\n", encoding="utf-8")
    return [*good, *(folder / name for name in ("broken.ply", "empty.obj", "text.stl", "missing.ply"))]


def finish() -> None:
    """End the process without the destructors of Qt, OpenGL and threads in whatever order Python finds them."""
    faulthandler.cancel_dump_traceback_later()
    sys.stdout.flush()
    os._exit(0)
