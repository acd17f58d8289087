"""Opens meshes, ground truths, runs and samples: reads them off the GUI thread and puts them into the workspace."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QObject
from qtpy.QtGui import QImage

from dmp.errors import DmpError
from dmp.runs import Run, is_run_folder, list_runs
from dmp.settings import Settings, settings_for
from dmp_viewer import tasks
from dmp_viewer.model import Source
from dmp_viewer.views.banner import Message

if TYPE_CHECKING:
    from dmp_viewer.controller import Controller

_LOG = logging.getLogger(__name__)


class Opener(QObject):
    """What the user opens, and what is offered to open.

    Args:
        controller: whose workspace it fills.
    """

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self._controller = controller
        self._workspace = controller.workspace
        self._window = controller.window
        self._opening = 0
        self._start_wanted = False
        self._continue_wanted = False

    @property
    def is_opening(self) -> bool:
        """Whether something is being read for the workspace."""
        return self._opening > 0

    @property
    def is_about_to_start(self) -> bool:
        """Whether a training will start as soon as everything is read."""
        return self._start_wanted

    def forget_start(self) -> None:
        """Do not start after all, because something went wrong."""
        self._start_wanted = self._continue_wanted = False

    def _open(self, text: str, work: Callable[[], Any], done: Callable[[Any], None], doing: str) -> None:
        self._opening += 1

        def on_done(result: Any) -> None:
            self._opening -= 1
            done(result)
            self._start_if_wanted()

        def on_failed(error: Exception) -> None:
            self._opening -= 1
            self._controller.tell_error(error, doing)

        self._controller.background.submit(text, work, on_done, on_failed)

    def open_path(self, path: Path, ground_truth: Path | None = None) -> None:
        """Open a mesh file or a run folder, after asking when a training would be ended by it."""
        if not self._controller.may_leave_training(f"open {path.name}"):
            return
        self._window.banners.clear()
        if is_run_folder(path):
            self._open(
                f"Opening the run {path.name}…",
                lambda: tasks.open_run(path),
                self._on_run_opened,
                f"Opening {path.name}",
            )
            return
        settings = self.settings_for_opening()
        self._open(
            f"Reading and smoothing {path.name}…",
            lambda: tasks.open_mesh(path, ground_truth, settings),
            self._on_mesh_opened,
            f"Opening {path.name}",
        )

    def open_sample(self, name: str) -> None:
        """Open one of the samples with its ground truth."""
        from dmp.samples import sample

        try:
            found = sample(name)
        except DmpError as error:
            self._controller.tell_error(error)
            return
        settings = self.settings_for_opening()
        if settings.task != found.task:
            self._window.panel.set_settings(settings_for(found.task, seed=settings.seed, device=settings.device))
        self.open_path(found.mesh_path, found.ground_truth_path)

    def change_task(self) -> None:
        """Set the open mesh up for the task of the panel; a run on show stays, the next one gets the new task."""
        source = self._workspace.source
        if source is None or self._workspace.run is not None or self._controller.runner.state.is_active:
            return
        settings = self.settings_for_opening()
        loops = self._workspace.holes.loops_to_fill()
        self._window.banners.clear()
        self._open("Setting up…", lambda: tasks.set_up(source, settings, loops), self._on_task_set_up, "Setting up")

    def offer_samples(self, *, with_pictures: bool = True) -> None:
        """Fill the menu and the start page with the samples that this version can work on, and draw their pictures."""
        from dmp.samples import samples

        try:
            offered = [item for item in samples() if item.task in tasks.TASKS]
        except DmpError as error:  # the window is of use without samples
            _LOG.warning("No samples: %s", error)
            return
        self._window.set_samples([(item.name, item.title, item.description) for item in offered])
        for item in offered if with_pictures else ():
            self._controller.background.submit(
                "",
                lambda item=item: _picture_of(item.mesh_path),  # type: ignore[misc]
                lambda image, name=item.name: self._on_picture_made(name, image),  # type: ignore[misc]
                lambda error, name=item.name: _LOG.warning("No picture of the sample %s: %s", name, error),  # type: ignore[misc]
            )

    def offer_interrupted_run(self) -> None:
        """Offer to go on with the newest run that ended without a word, as after a crash; one at a time."""

        def offer(found: list[tuple[Run, int]]) -> None:
            if not found or self._workspace.problem is not None:
                return
            run, step = found[0]
            others = {1: "", 2: " One more was interrupted, too."}
            more = others.get(len(found), f" {len(found) - 1} more were interrupted, too.")
            text = f"The training of {run.name} was interrupted at step {step:,}. Nothing before it is lost.{more}"
            proceed = ("Continue", lambda: self.continue_run(run.folder))
            discard = ("Discard notice", lambda: self._discard_notice(run))
            self._controller.say(Message("info", text, action=proceed, other=discard))

        def find() -> list[tuple[Run, int]]:
            return [(run, run.last_step) for run in list_runs(folder) if run.state == "interrupted"]

        folder = self._controller.runs_folder
        self._controller.background.submit("", find, offer, _log_failure)

    def continue_run(self, folder: Path) -> None:
        """Open a run and go on with it from its last checkpoint, if there is anything left to do."""
        self._continue_wanted = True
        self.open_path(folder)

    def _discard_notice(self, run: Run) -> None:
        """Count an interrupted run as stopped, so that it is not offered again, and offer the next one."""
        self._controller.background.submit("", run.acknowledge, lambda _: self.offer_interrupted_run(), _log_failure)

    def settings_for_opening(self) -> Settings:
        """Return the settings of the panel, or the usual ones while a number is being typed."""
        try:
            return self._window.panel.settings()
        except DmpError:  # a number that is being typed must not keep a mesh from being opened
            return Settings()

    def start_when_opened(self) -> None:
        """Start, or continue, the training as soon as what is being opened is there."""
        self._start_wanted = True

    def _start_if_wanted(self) -> None:
        if self._start_wanted and not self.is_opening:
            self._start_wanted = False
            if self._workspace.controls.proceed:
                self._controller.proceed()
            else:
                self._controller.start()

    def _on_mesh_opened(self, opened: tasks.OpenedMesh) -> None:
        self._turn_up(opened.source)
        self._workspace.open_problem(opened.problem, opened.source)
        self._workspace.holes.set_failed(opened.failed)
        self._remember(opened.source.path)
        self._tell_notes(opened.notes)
        if self.settings_for_opening().task == "denoise":
            self._controller.hole_control.offer_filling()

    def _on_run_opened(self, opened: tasks.OpenedRun) -> None:
        self._turn_up(opened.source)
        self._controller.forget_told_warnings()
        self._workspace.open_run(opened.run, opened.problem, opened.source, opened.suggestion)
        self._window.panel.set_settings(opened.run.settings)
        self._remember(opened.run.folder)
        goes_on, self._continue_wanted = self._continue_wanted and self._workspace.controls.proceed, False
        if goes_on:
            self._controller.proceed()
            self._controller.forget_told_warnings()
        elif self._controller.remote.tell_about(opened.run):
            pass
        elif opened.run.state == "interrupted":
            step = f"{opened.run.last_step:,}"
            text = f"This run was interrupted at step {step}. Nothing before it is lost, and Continue goes on from there."
            self._controller.say(Message("info", text))
        elif opened.run.reason:
            self._controller.say(Message("error", f"This run failed. {opened.run.reason}"))
        self._controller.tell_about_run(opened.run)

    def _on_task_set_up(self, opened: tasks.OpenedMesh) -> None:
        if opened.source is not self._workspace.source:
            return  # another mesh was opened meanwhile
        self.show_opened(opened)

    def show_opened(self, opened: tasks.OpenedMesh) -> None:
        """Show a mesh that is set up, in place of the one on show."""
        self._workspace.open_problem(opened.problem, opened.source)
        self._workspace.holes.set_failed(opened.failed)
        self._tell_notes(opened.notes)

    def _on_truth_opened(self, opened: tasks.OpenedMesh) -> None:
        self._workspace.replace_problem(opened.problem, opened.source)
        self._tell_notes(opened.notes)

    def _on_picture_made(self, name: str, image: QImage) -> None:
        card = self._window.start_page.cards.get(name)
        if card is not None:
            card.set_picture(image)

    def _turn_up(self, source: Source) -> None:
        wanted = source.up or self._controller.preferences.up
        self._workspace.look.set(up="z" if wanted == "z" else "y")

    def _tell_notes(self, notes: Sequence[str]) -> None:
        if notes:
            self._controller.say(Message("info", " ".join(notes)))

    def _remember(self, path: Path | None) -> None:
        if path is not None:
            self._controller.preferences.add_recent(path)
            self._controller.preferences.folder = str(path.parent)
            self._window.set_recent(self._controller.preferences.existing_recent())

    def open_ground_truth(self, path: Path) -> None:
        """Compare the open mesh with its clean version."""
        problem, source = self._workspace.problem, self._workspace.source
        if problem is not None and source is not None and not self._controller.runner.state.is_active:
            self._open(
                f"Reading {path.name}…",
                lambda: tasks.add_ground_truth(problem, source, path),
                self._on_truth_opened,
                f"Opening {path.name}",
            )


def _log_failure(error: Exception) -> None:
    _LOG.warning("The runs cannot be listed: %s", error)


def _picture_of(path: Path) -> QImage:
    from dmp.meshio import read_mesh
    from dmp_viewer.thumbnails import thumbnail
    from dmp_viewer.views.start_page import CARD_PICTURE

    pixels = thumbnail(read_mesh(path), 2 * CARD_PICTURE.width(), 2 * CARD_PICTURE.height(), (0.66, 0.74, 0.85), up="z")
    height, width, _ = pixels.shape
    return QImage(pixels.tobytes(), width, height, 4 * width, QImage.Format.Format_RGBA8888).copy()
