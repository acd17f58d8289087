"""Trains what waits, one after another, and answers what the user does with the queue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from qtpy.QtCore import QTimer

from dmp.errors import DmpError, RunError
from dmp.run_upkeep import remove_run
from dmp.runs import Run
from dmp.settings import Settings
from dmp_viewer import remote, tasks
from dmp_viewer.control_part import ControlPart
from dmp_viewer.icons import icon
from dmp_viewer.pace import Pace
from dmp_viewer.queue_file import QueueFile
from dmp_viewer.queue_model import Queue, Waiting
from dmp_viewer.runner import Outcome, Session
from dmp_viewer.runs_entries import RunRow, row_of
from dmp_viewer.states import RunnerState
from dmp_viewer.views import dialogs
from dmp_viewer.views.banner import Message

if TYPE_CHECKING:
    from dmp_viewer.controller import Controller
    from dmp_viewer.model import Source


_LOOK_MS = 2000
_ANOTHERS = "The queue belongs to another window of this program. It can be changed there, or here once that one is closed."


@dataclass
class _Turn:
    """The waiting training whose turn it is; filled by the training thread before its first step."""

    item: Waiting
    opened: tasks.OpenedRun | None = None


class QueueControl(ControlPart):
    """The part of the controller that lets trainings wait for each other.

    Args:
        controller: whose window, workspace and training thread it works on.
        is_kept: whether what waits is kept from one start to the next.
    """

    def __init__(self, controller: Controller, *, is_kept: bool) -> None:
        super().__init__(controller)
        self._view = controller.window.runs.queue
        self._is_kept = is_kept
        self._file: QueueFile | None = None
        # What waits in another window, which holds the queue now.
        self._anothers: list[Waiting] | None = None
        self._anothers_folders: list[Path] = []
        self._turn: _Turn | None = None
        self._was_stopped = False
        self.queue = Queue()
        self.queue.changed.connect(self._on_changed)
        self._view.chosenChanged.connect(self.draw_possible)
        self._view.arranged.connect(self.queue.arrange)
        self._view.removeRequested.connect(self._do_queue_remove)
        self._workspace.state_changed.connect(self._draw, check_nargs=False)
        self._workspace.problem_changed.connect(self.draw_possible, check_nargs=False)
        controller.window.themeChanged.connect(self._draw)
        controller.runner.stateChanged.connect(self._on_runner_state_changed)
        controller.runner.finished.connect(self._on_runner_finished)
        self._look = QTimer(self)
        self._look.setInterval(_LOOK_MS)
        self._look.timeout.connect(self.look_at_other_window)
        if is_kept:
            self._file = QueueFile(controller.runs.folder)
            self._look.start()
        self._draw()

    # -- what waits ---------------------------------------------------------------------------------------------------

    def add_settings(self, settings: Settings) -> None:
        """Let a training of the open mesh wait; its run folder is made now, so that it cannot be lost."""
        source, controller = self._workspace.source, self._controller
        if source is None or not self._take():
            return
        folder = controller.runs_folder
        loops = controller.hole_control.loops_to_fill() if settings.task == "complete" else None
        # Asked now: the training may end before the folder is made.
        is_during_another = controller.runner.state.is_active
        controller.background.submit(
            "Putting into the queue…",
            lambda: row_of(tasks.waiting_run(source, settings, folder, loops)),
            lambda row: self.add_run(row, is_new=True, is_during_another=is_during_another),
            lambda error: controller.tell_error(error, "Putting into the queue"),
        )

    def add_run(self, row: RunRow, *, is_new: bool = False, is_during_another: bool = False) -> None:
        """Let a run wait that has steps left.

        Args:
            row: the run.
            is_new: whether it was made to wait.
            is_during_another: whether a training went on when that was asked for.
        """
        if not self._take():
            return
        added = self.queue.add(Waiting(row.folder, row.title, row.settings_text, is_new or row.state == "waiting"))
        is_active = self._controller.runner.state.is_active
        if added and (is_active or is_during_another):
            # Whoever adds to what is going on wants it to go on.
            self.queue.set_on(True)
            if not is_active:
                self._go_on()
        self._controller.window.show_runs()
        self._controller.runs.refresh()

    def forget(self, *folders: Path) -> None:
        """Let runs wait no longer that are gone."""
        self.queue.remove(*folders)

    def offer_kept(self) -> None:
        """Bring back what waited when the window was closed, and say so."""
        if self._file is None or not self._file.folders():
            return
        if self._file.is_anothers:
            self.look_at_other_window()
        elif self._take():
            self._offer("in the queue since last time")

    def look_at_other_window(self) -> None:
        """Show what waits in the window that holds the queue, and take it over when that one is closed."""
        if self._file is None or self._file.is_ours:
            return
        folders = self._file.folders()
        if not folders and self._anothers is None:
            return
        if self._file.is_anothers:
            if self._anothers is None or folders != self._anothers_folders:
                self._anothers, self._anothers_folders = _waiting(folders), folders
                self._draw()
        elif self._anothers is not None:
            self._anothers = None
            if folders and self._take():
                self._offer("in the queue of the window that was closed")
            self._draw()

    def _take(self) -> bool:
        """Make the queue that of this window, with all that waits in it; says so when it is that of another window."""
        if self._file is None or self._file.is_ours:
            return True
        if not self._file.take():
            self._controller.say(Message("info", _ANOTHERS))
            self.look_at_other_window()
            return False
        self._anothers = None
        self.queue.restore(_waiting(self._file.folders()))
        return True

    def _offer(self, where: str) -> None:
        count = len(self.queue.items)
        if count:
            what = "1 training waits" if count == 1 else f"{count} trainings wait"
            start = ("Start the queue", self._do_queue_go)
            show = ("Show it", self._controller.window.show_runs)
            self._controller.say(Message("info", f"{what} {where}.", action=start, other=show))

    def may_close(self) -> bool:
        """Tell, after a question when trainings wait, whether the window may close."""
        waiting = len(self.queue.items)
        if not waiting or not self._is_kept:
            return True
        what = "1 training waits" if waiting == 1 else f"{waiting} trainings wait"
        details = "What waits is kept, and offered again at the next start. Nothing is trained while the window is closed."
        return dialogs.confirm(self._controller.window, f"{what} in the queue. Close all the same?", details, "Close")

    def close(self) -> None:
        """Begin nothing any more."""
        self.queue.set_on(False)

    def release(self) -> None:
        """Leave the queue to other windows, at the end of this one."""
        self._look.stop()
        if self._file is not None:
            self._file.release()

    # -- one after another --------------------------------------------------------------------------------------------

    def before_begin(self, session: Session) -> None:
        """Show the mesh of the training that begins, when it is another one than that on show."""
        turn = self._turn
        if turn is None or turn.opened is None or turn.opened.run.run_id != session.run.run_id:
            return
        self.queue.remove(turn.item.folder)
        if not _is_same(self._workspace.source, turn.opened.source):
            opened = turn.opened
            self._workspace.open_run(opened.run, opened.problem, opened.source, opened.suggestion)

    def _begin_next(self) -> None:
        from dmp.batch.remote import read_link

        item, controller = self.queue.next, self._controller
        if item is None or controller.runner.state.is_active or not self.queue.is_on:
            return
        turn = self._turn = _Turn(item)

        def prepare() -> Session:
            turn.opened = tasks.open_run(item.folder)
            if address or read_link(item.folder) is not None:
                return remote.continue_session(turn.opened.run, address)
            return tasks.continue_session(turn.opened.run, leaves_core=leaves_core)

        address, leaves_core = controller.remote.address, controller.runner.pace is Pace.SMOOTH
        controller.forget_told_warnings()
        controller.runner.start(prepare)

    def _on_runner_state_changed(self, state: RunnerState) -> None:
        if state is RunnerState.PREPARING:
            self._was_stopped = False
        elif state is RunnerState.STOPPING:
            self._was_stopped = True

    def _on_runner_finished(self, _outcome: Outcome) -> None:
        turn, self._turn = self._turn, None
        if turn is not None and self._controller.runner.state is RunnerState.FAILED:
            # What failed before its first step waits on, with the reason; what failed later is among the runs.
            self.queue.set_problem(turn.item.folder, "It could not be trained; the message above tells why.")
        if self.queue.next is None:
            if turn is not None and not self._was_stopped:
                self.queue.set_on(False)
            self._draw()
            return
        if self.queue.is_on:
            self._go_on()

    def _go_on(self) -> None:
        """Begin what is next, unless the last training ended in a way that a person should look at first."""
        run = self._workspace.run
        if self._was_stopped:
            self._hold("The training was stopped, so the queue waits.")
        elif isinstance(run, Run) and run.is_in_memory:
            self._hold(f"The queue waits, because what was learnt last could not be written to {run.folder}.")
        else:
            QTimer.singleShot(0, self._begin_next)

    def _hold(self, reason: str) -> None:
        self.queue.set_on(False)
        self._controller.say(Message("info", reason, action=("Go on with the queue", self._do_queue_go)))

    # -- actions ------------------------------------------------------------------------------------------------------

    def _do_queue_add(self) -> None:
        try:
            settings = self._controller.window.panel.settings()
        except DmpError:  # the panel says already which one
            return
        self.add_settings(settings)

    def _do_queue_go(self) -> None:
        if not self._take():
            return
        self.queue.set_on(not self.queue.is_on)
        if self.queue.is_on and not self._controller.opener.is_opening:
            self._begin_next()

    def _do_queue_up(self) -> None:
        self._move(-1)

    def _do_queue_down(self) -> None:
        self._move(1)

    def _move(self, places: int) -> None:
        folder = self._view.chosen()
        if folder is not None:
            self.queue.move(folder, places)
            self._view.choose(folder)

    def _do_queue_remove(self) -> None:
        folder = self._view.chosen()
        item = next((item for item in self.queue.items if item.folder == folder), None)
        if item is None:
            return
        self.queue.remove(item.folder)
        if item.is_new:
            # Made for the queue, nothing learnt: an empty run would only be in the way.
            self._controller.background.submit(
                "", lambda: _remove_unbegun(item.folder), lambda _none: self._controller.runs.refresh(), lambda _error: None
            )

    # -- drawing ------------------------------------------------------------------------------------------------------

    def _on_changed(self) -> None:
        if self._file is not None and self._file.is_ours:
            self._file.save(self.queue.items)
            if not self.queue.items and not self.queue.is_on:
                self._file.release()
        self._draw()

    def _draw(self) -> None:
        if self._anothers is None:
            self._view.set_items(self.queue.items, self._status())
        else:
            self._view.set_items(self._anothers, "in another window", note=_ANOTHERS)
        self.draw_possible()

    def _status(self) -> str:
        queue, is_active = self.queue, self._workspace.state.is_active
        waiting = len(queue.items)
        if not waiting:
            return "last one in training" if queue.is_on and is_active else ""
        if not queue.is_on:
            return f"{waiting} waiting, held"
        return f"{waiting} waiting, next after this one" if is_active else f"{waiting} waiting"

    def draw_possible(self) -> None:
        """Switch on what makes sense now."""
        actions, queue = self._controller.window.named_actions, self.queue
        folders, chosen = [item.folder for item in queue.items], self._view.chosen()
        place = folders.index(chosen) if chosen in folders else None
        actions["queue_add"].setEnabled(self._workspace.source is not None)
        actions["queue_go"].setEnabled(queue.next is not None)
        actions["queue_go"].setText("&Hold the queue" if queue.is_on else "&Start the queue")
        actions["queue_go"].setIconText("Hold" if queue.is_on else "Start")
        actions["queue_go"].setIcon(icon("pause" if queue.is_on else "play", self._controller.window.theme))
        actions["queue_up"].setEnabled(place is not None and place > 0)
        actions["queue_down"].setEnabled(place is not None and place < len(folders) - 1)
        actions["queue_remove"].setEnabled(place is not None)


def _waiting(folders: Sequence[Path]) -> list[Waiting]:
    """Return what waits in folders; without those that cannot be read or have no steps left."""
    found = []
    for folder in folders:
        try:
            row = row_of(Run.open(folder))
        except RunError:
            continue
        if row.can_be_continued:
            found.append(Waiting(row.folder, row.title, row.settings_text, row.state == "waiting"))
    return found


def _remove_unbegun(folder: Path) -> None:
    if not Run.open(folder).snapshot_steps():
        remove_run(folder)


def _is_same(shown: Source | None, source: Source) -> bool:
    """Tell whether the mesh of a run is the one on show, whose choices (holes, axis) are to stay then."""
    if shown is None:
        return False
    mesh, other = shown.mesh, source.mesh
    return mesh.same_connectivity(other) and bool(np.array_equal(mesh.vertices, other.vertices))
