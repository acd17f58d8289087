"""Fixtures of the window's tests: the application, a real window on its own display, and runs that cost no training."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
import torch  # noqa: F401  # before Qt, as in the application
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QCoreApplication
from qtpy.QtGui import QAction
from qtpy.QtWidgets import QApplication, QMainWindow

from dmp.mesh import TriangleMesh
from dmp.meshio import write_mesh
from dmp.problem import Problem, denoising
from dmp.settings import Settings, settings_for
from dmp.shapes.alterations import with_holes
from dmp.snapshot import Snapshot, StepRecord
from dmp_viewer import actions, keys, startup
from dmp_viewer.app import make_application
from dmp_viewer.controller import Controller
from dmp_viewer.settings import Preferences
from dmp_viewer.shutdown import destroy
from dmp_viewer.tasks import TASKS
from dmp_viewer.views import dialogs, export_dialog, filter_choice, questions, run_choice
from dmp_viewer.views.main_window import MainWindow
from tests.meshes import grid_mesh


@pytest.fixture(scope="session")
def qapp() -> Iterator[QApplication]:
    """The application as the program makes it; pytest-qt takes it from here."""
    reason = startup.missing_display()
    if reason is not None:
        pytest.skip(reason)
    startup.set_surface_format()
    application = make_application()
    startup.probe_opengl()
    yield application


# Every function that opens a dialog and waits for an answer.
DIALOGS = (
    *((dialogs, name) for name in ("ask_mesh", "ask_run", "ask_save_mesh", "ask_save_picture", "confirm")),
    *((questions, name) for name in ("ask_range", "ask_vertex")),
    (run_choice, "ask_run_to_compare"),
    (filter_choice, "ask_filter"),
    (export_dialog, "ask_target"),
)


@pytest.fixture(autouse=True)
def no_dialogs(monkeypatch: pytest.MonkeyPatch) -> None:
    """A dialog that nobody expects would wait for ever; a test that expects one answers it."""

    def unexpected(*_: object, **__: object) -> None:
        raise AssertionError("A dialog was opened that this test does not expect.")

    for module, name in DIALOGS:
        monkeypatch.setattr(module, name, unexpected)


@pytest.fixture
def problem(noisy_sphere: TriangleMesh, sphere: TriangleMesh) -> Problem:
    """The noisy sphere of 258 vertices with its ground truth."""
    return denoising(noisy_sphere, settings_for(), sphere)


@dataclass
class FakeRun:
    """A run in memory; what it would write is only remembered."""

    problem: Problem
    settings: Settings = field(default_factory=lambda: settings_for(steps=40, snapshot_every=10))
    run_id: str = "fake"
    name: str = "fake run"
    state: str = "stopped"
    kept_step: int | None = None
    rows: list[dict[str, float]] = field(default_factory=list)
    snapshots: dict[int, Snapshot] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    folder: Path | None = None

    def curve(self) -> list[dict[str, float]]:
        return self.rows

    def snapshot_steps(self) -> list[int]:
        return sorted(self.snapshots)

    def snapshot(self, step: int) -> Snapshot:
        return self.snapshots[step]

    def keep(self, step: int | None) -> None:
        self.kept_step = step

    def mesh_at(self, step: int) -> TriangleMesh:
        return self.problem.mesh.with_vertices(self.snapshots[step].vertices)

    def record(self, step: int) -> StepRecord:
        """Return the record of a step; the prediction goes from the base to the input, and overshoots nothing."""
        share = step / self.settings.steps
        vertices = self.problem.base + share * (self.problem.target - self.problem.base)
        metrics = {"data_loss": 1.1 - share, "held_out_error": 0.5 + (share - 0.5) ** 2, "mad": 10 + 20 * (share - 0.4) ** 2}
        snapshot = (
            Snapshot(self.run_id, step, vertices, metrics, step / 10) if step % self.settings.snapshot_every == 0 else None
        )
        return StepRecord(step, step / 10, metrics, snapshot)

    def records(self, last: int | None = None) -> Iterator[StepRecord]:
        """Yield the records of all steps from 0 on, remembering them as a run folder would."""
        for step in range((self.settings.steps if last is None else last) + 1):
            record = self.record(step)
            self.rows.append({"step": step, "seconds": record.seconds, **record.metrics})
            if record.snapshot is not None:
                self.snapshots[step] = record.snapshot
            yield record


@pytest.fixture
def fake_run(problem: Problem) -> FakeRun:
    """A run that has not begun."""
    return FakeRun(problem)


@pytest.fixture
def trained_run(problem: Problem) -> FakeRun:
    """A run with snapshots of steps 0, 10, 20, 30 and 40."""
    run = FakeRun(problem, state="finished")
    assert len(list(run.records())) == 41
    return run


@pytest.fixture
def make_viewer(qtbot: QtBot, tmp_path: Path) -> Iterator[Callable[..., Controller]]:
    """Return a maker of real windows on screen, which are closed at the end."""
    made: list[Controller] = []

    def make(preferences: Preferences | None = None, *, width: int = 1000, height: int = 700, show: bool = True) -> Controller:
        remembered = preferences or Preferences(theme="light")
        window = MainWindow(multi_samples=0, tasks=TASKS, keys=keys.bindings(remembered.keys).keys)
        window.resize(width, height)
        controller = Controller(window, remembered, tmp_path / "window.json", runs_folder=tmp_path / "runs")
        controller.window.panel.set_settings(quick_settings())
        made.append(controller)
        if show:
            window.show()
            qtbot.waitExposed(window)
        return controller

    yield make
    for controller in made:
        controller.window.close_guard = lambda: True
        controller.runner.stop()
        controller.runner.wait(10)
        controller.background.close()
        controller.scanner.close()
        controller.exports.close()
        controller.runs.close()
        controller.comparing.close()
        controller.presenter.close()
        controller.queue.release()
        controller.window.close()
        destroy(controller.window)
    QCoreApplication.processEvents()


@pytest.fixture
def viewer(make_viewer: Callable[..., Controller]) -> Controller:
    """One real window on screen."""
    return make_viewer()


@pytest.fixture
def mesh_files(tmp_path: Path, noisy_sphere: TriangleMesh, sphere: TriangleMesh) -> tuple[Path, Path]:
    """A noisy mesh and its ground truth as files."""
    noisy, clean = tmp_path / "scan.ply", tmp_path / "clean.ply"
    write_mesh(noisy, noisy_sphere)
    write_mesh(clean, sphere)
    return noisy, clean


def quick_settings(**changes: object) -> Settings:
    """Settings for a training of a second or two."""
    return replace(settings_for(steps=30, snapshot_every=5, log_every=1, threads=1, width_divisor=16), **changes)


def pane_pixels(controller: Controller, pane: int) -> np.ndarray:
    """Return what a pane shows, (height, width, 3) uint8."""
    controller.presenter.flush()
    image = controller.window.panes.interactor.grabFramebuffer().convertToFormat(image_format())
    rows = np.frombuffer(image.constBits(), dtype=np.uint8).reshape(image.height(), image.bytesPerLine())
    pixels = rows[:, : 3 * image.width()].reshape(image.height(), image.width(), 3)
    third = image.width() // 3
    return pixels[:, pane * third + 4 : (pane + 1) * third - 4].copy()


def image_format() -> object:
    """Return the format of three bytes a pixel."""
    from qtpy.QtGui import QImage

    return QImage.Format.Format_RGB888


@pytest.fixture
def sheet_file(tmp_path: Path) -> Path:
    """An open sheet with three holes of different sizes."""
    sheet = with_holes(grid_mesh(24), [(6.0, 6.0, 0.0), (17.0, 6.0, 0.0), (12.0, 17.0, 0.0)], [21, 9, 4])
    write_mesh(tmp_path / "sheet.ply", sheet)
    return tmp_path / "sheet.ply"


@pytest.fixture
def sheet(viewer: Controller, sheet_file: Path) -> Controller:
    """A window with the sheet, about to fill its holes."""
    viewer.window.panel.set_settings(quick_settings(task="complete", hold_out=0.0))
    viewer.opener.open_path(sheet_file)
    assert viewer.background.wait(30)
    viewer.presenter.flush()
    return viewer


@pytest.fixture
def window(qtbot: QtBot) -> QMainWindow:
    window = QMainWindow()
    qtbot.addWidget(window)
    return window


@pytest.fixture
def named_actions(window: QMainWindow) -> dict[str, QAction]:
    return actions.build(window, {spec.name: (lambda: None) for spec in actions.ACTIONS})
