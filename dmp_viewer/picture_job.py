"""``--screenshot``: train in the real window to a step, show it, save a picture of the whole window, and close it."""

from __future__ import annotations

import sys
from pathlib import Path

from qtpy.QtCore import QObject, QTimer, Signal

from dmp.errors import DmpError
from dmp_viewer.controller import Controller
from dmp_viewer.runner import Outcome
from dmp_viewer.saving import save_picture
from dmp_viewer.states import RunnerState


class PictureJob(QObject):
    """Waits for the step, takes the picture, and ends the application.

    Args:
        controller: of the window to take a picture of.
        path: where to save it.
        at_step: the step to show; None takes what is there once everything is opened.

    Attributes:
        exit_code: 0 when the picture was saved, otherwise 2.

    Signals:
        finished: the exit code, after the window was closed.
    """

    finished = Signal(int)

    def __init__(self, controller: Controller, path: Path, at_step: int | None) -> None:
        super().__init__(controller)
        self._controller = controller
        self._path = path
        self._at_step = at_step
        self._expects_mesh = False
        self._decided = False
        self._failed = False
        self.exit_code = 2

    def begin(self, *, expects_mesh: bool) -> None:
        """Watch the controller from now on."""
        self._expects_mesh = expects_mesh
        controller = self._controller
        controller.workspace.snapshots_changed.connect(self._look)
        controller.runner.finished.connect(self._on_runner_finished)
        controller.errorTold.connect(self._fail)
        controller.background.busyChanged.connect(lambda _text: QTimer.singleShot(0, self._look))
        QTimer.singleShot(0, self._look)

    def _look(self) -> None:
        """Take the picture when all that was asked for is there."""
        workspace, runner = self._controller.workspace, self._controller.runner
        # Without a mesh the start page is shown, whose pictures of the samples are drawn in the background.
        busy = self._controller.opener.is_opening if self._expects_mesh else self._controller.background.is_busy
        if self._decided or busy or (self._expects_mesh and workspace.problem is None):
            return
        if self._at_step is not None:
            if self._at_step in workspace.snapshot_steps:
                runner.pause()
                workspace.show_step(self._at_step)
            elif runner.state.is_active or self._controller.opener.is_about_to_start:
                return
            else:
                steps = workspace.snapshot_steps
                self._fail(f"There is no snapshot of step {self._at_step}; this run has {_listed(steps)}.")
                return
        self._decided = True
        # A moment for layout, curve and 3-D view, which are drawn by timers.
        QTimer.singleShot(400, self._take)

    def _on_runner_finished(self, outcome: Outcome) -> None:
        if self._controller.runner.state is not RunnerState.FAILED:
            QTimer.singleShot(0, self._look)

    def _take(self) -> None:
        self._controller.presenter.flush()
        # The small pictures above the timeline are drawn in the background.
        self._controller.scanner.wait(10.0)
        picture = self._controller.exporter.picture()
        try:
            save_picture(picture, self._path)
        except DmpError as error:
            print(f"dmp-viewer: {error}", file=sys.stderr)
        else:
            # An error told while the last things were drawn is in the picture, and still an error.
            self.exit_code = 2 if self._failed else 0
        self._leave()

    def _fail(self, text: str) -> None:
        if not self._failed:
            print(f"dmp-viewer: {text}", file=sys.stderr)
        self._failed = True
        if not self._decided:
            self._decided = True
            self._leave()

    def _leave(self) -> None:
        self._controller.window.close()
        self.finished.emit(self.exit_code)


def _listed(steps: list[int]) -> str:
    return f"snapshots from {steps[0]} to {steps[-1]}" if steps else "no snapshots"
