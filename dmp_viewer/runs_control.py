"""Answers what the user does in the list of runs, and keeps the list in step with the run folders."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QTimer, QUrl
from qtpy.QtGui import QDesktopServices

from dmp.errors import RunError
from dmp.run_upkeep import remove_run
from dmp.runs import Run, default_runs_folder
from dmp_viewer.background import Background
from dmp_viewer.control_part import ControlPart
from dmp_viewer.runs_entries import RunRow, row_of, rows_of
from dmp_viewer.runs_pictures import RunPictures
from dmp_viewer.runs_trash import Trashed, move_to_trash, put_back
from dmp_viewer.views import dialogs
from dmp_viewer.views.banner import Message

if TYPE_CHECKING:
    from dmp_viewer.controller import Controller

# A run that is being trained is looked at this often.
_LOOK_MS = 1000


class RunsControl(ControlPart):
    """The part of the controller that keeps house with runs.

    Args:
        controller: whose window and workspace it works on.
    """

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self._dock = controller.window.runs
        # Of its own, so that a long list waits for nothing, and nothing for it.
        self._reading = Background(self)
        self._is_reading = self._is_stale = False
        self.pictures = RunPictures(lambda: controller.preferences.up, self)
        self.pictures.made.connect(lambda _key: self._dock.list.viewport().update())
        self._dock.pictures_of = self.pictures.picture
        self._dock.seen.connect(self.refresh)
        self._dock.visibilityChanged.connect(lambda _visible: self._draw_toggle())
        self._dock.search.textChanged.connect(lambda _text: self.pictures.forget_wishes())
        self._dock.list.chosenChanged.connect(self.draw_possible)
        self._dock.list.openRequested.connect(self._do_listed_open)
        self._dock.list.trashRequested.connect(self._do_listed_trash)
        self._dock.list.renamed.connect(self._rename)
        self._look = QTimer(self)
        self._look.setSingleShot(True)
        self._look.setInterval(_LOOK_MS)
        self._look.timeout.connect(self._look_at_run)
        workspace = self._workspace
        workspace.run_changed.connect(self._on_run_changed, check_nargs=False)
        for signal in (workspace.snapshots_changed, workspace.kept_step_changed):
            signal.connect(self._look_soon, check_nargs=False)
        for signal in (workspace.state_changed, workspace.problem_changed):
            signal.connect(self.draw_possible, check_nargs=False)
        controller.runner.finished.connect(lambda _outcome: self.refresh())
        self.draw_possible()

    @property
    def folder(self) -> Path:
        """The folder that all runs are in."""
        return self._controller.runs_folder or default_runs_folder()

    def wait(self, seconds: float) -> bool:
        """Pump events until the list and its pictures are up to date; tells whether that was reached in time."""
        return self._reading.wait(seconds) and self.pictures.wait(seconds)

    def close(self) -> None:
        """Read nothing any more."""
        self._look.stop()
        self._reading.close()
        self.pictures.close()

    # -- the list -----------------------------------------------------------------------------------------------------

    def refresh(self) -> None:
        """Read the runs again, if anybody can see them."""
        if not self._dock.isVisible():
            return
        if self._is_reading:
            self._is_stale = True
            return
        self._is_reading, self._is_stale = True, False
        folder = self.folder
        self._reading.submit("", lambda: rows_of(folder), self._on_read, self._on_not_read)

    def _on_read(self, rows: list[RunRow]) -> None:
        self._is_reading = False
        self._dock.set_rows(rows)
        self._draw_shown()
        if self._is_stale:
            self.refresh()

    def _on_not_read(self, error: Exception) -> None:
        self._is_reading = False
        self._controller.tell_error(error, "Reading the runs")

    def _on_run_changed(self) -> None:
        self._draw_shown()
        self.refresh()

    def _look_soon(self) -> None:
        if self._dock.isVisible() and not self._look.isActive():
            self._look.start()

    def _look_at_run(self) -> None:
        """Tell how far the run on show is."""
        folder = self._shown_folder()
        if folder is not None and any(row.folder == folder for row in self._dock.all_rows):
            self._reading.submit("", lambda: row_of(Run.open(folder)), self._dock.replace_row, lambda _error: None)

    def _shown_folder(self) -> Path | None:
        """Return the folder of the run on show as the list names it, if it is there."""
        run = self._workspace.run
        found = (row.folder for row in self._dock.all_rows if run is not None and row.run_id == run.run_id)
        return next(found, None)

    def _draw_shown(self) -> None:
        self._dock.list.set_shown(self._shown_folder())

    def _draw_toggle(self) -> None:
        self._controller.window.named_actions["show_runs"].setChecked(not self._dock.isHidden())

    def draw_possible(self) -> None:
        """Switch on what makes sense for the chosen runs."""
        workspace, rows = self._workspace, self._dock.list.chosen()
        one = rows[0] if len(rows) == 1 else None
        run, problem = workspace.run, workspace.problem
        is_shown = one is not None and run is not None and one.run_id == run.run_id
        sizes = None if problem is None else (problem.mesh.n_vertices, problem.mesh.n_faces)
        readable = one is not None and one.can_be_opened
        possible = {
            "listed_open": readable and not is_shown,
            "listed_proceed": one is not None and one.can_be_continued and not workspace.state.is_active,
            "listed_compare": readable and not is_shown and one is not None and one.size == sizes and one.state != "waiting",
            "listed_settings": readable,
            "listed_queue": any(row.can_be_continued for row in rows),
            "listed_queue_settings": problem is not None and any(row.settings is not None for row in rows),
            "listed_rename": readable,
            "listed_reveal": one is not None,
            "listed_trash": any(row.state != "running" for row in rows),
        }
        for name, is_possible in possible.items():
            self._controller.window.named_actions[name].setEnabled(bool(is_possible))

    # -- what can be done ---------------------------------------------------------------------------------------------

    def _do_show_runs(self) -> None:
        is_shown = self._controller.window.named_actions["show_runs"].isChecked()
        self._dock.setVisible(is_shown)
        if is_shown:
            self._dock.search.setFocus()

    def _chosen(self) -> RunRow | None:
        rows = self._dock.list.chosen()
        return rows[0] if len(rows) == 1 else None

    def _do_listed_open(self) -> None:
        row = self._chosen()
        if row is not None and row.can_be_opened:
            self._controller.opener.open_path(row.folder)

    def _do_listed_proceed(self) -> None:
        row = self._chosen()
        if row is not None and row.can_be_continued:
            self._controller.opener.continue_run(row.folder)

    def _do_listed_compare(self) -> None:
        row, problem = self._chosen(), self._workspace.problem
        if row is not None and problem is not None:
            self._controller.comparing.compare_with(problem, row.folder)

    def _do_listed_settings(self) -> None:
        row, controller = self._chosen(), self._controller
        if row is None or row.settings is None:
            return
        window = controller.window
        window.panel.set_settings(row.settings)
        controller.opener.change_task()
        window.set_panel_visible(True)
        window.named_actions["show_panel"].setChecked(True)
        start = ("Start", controller.start) if self._workspace.controls.start else None
        text = f"The settings of “{row.title}” are in the run panel, for the next training."
        controller.say(Message("info", text, action=start))

    def _do_listed_queue(self) -> None:
        for row in self._dock.list.chosen():
            if row.can_be_continued:
                self._controller.queue.add_run(row)

    def _do_listed_queue_settings(self) -> None:
        for row in reversed(self._dock.list.chosen()):
            if row.settings is not None:
                self._controller.queue.add_settings(row.settings)

    def _do_listed_rename(self) -> None:
        self._dock.list.rename_chosen()

    def _do_listed_reveal(self) -> None:
        row = self._chosen()
        if row is not None and not QDesktopServices.openUrl(QUrl.fromLocalFile(str(row.folder))):
            self._controller.say(Message("info", f"No program here shows folders. The run lies in {row.folder}."))

    def _rename(self, folder: Path, name: str) -> None:
        run = self._workspace.run
        # The run that is trained here is renamed by its own object, which writes run.json once more at its end.
        ours = run if isinstance(run, Run) and folder == self._shown_folder() else None
        self._reading.submit(
            "",
            lambda: (ours or Run.open(folder)).rename(name),
            lambda _none: self.refresh(),
            lambda error: self._controller.tell_error(error, "Renaming"),
        )

    # -- removing -----------------------------------------------------------------------------------------------------

    def _do_listed_trash(self) -> None:
        rows = self._dock.list.chosen()
        for row in rows:
            if row.state == "running":
                self._controller.say(Message("info", f"“{row.title}” is being trained. Stop its training first."))
        folders = [row.folder for row in rows if row.state != "running"]
        if folders:
            self._reading.submit(
                "Moving to the trash…",
                lambda: [move_to_trash(folder) for folder in folders],
                lambda results: self._on_trashed(results, {row.folder: row for row in rows}),
                lambda error: self._controller.tell_error(error, "Moving to the trash"),
            )

    def _on_trashed(self, results: list[Trashed], rows: dict[Path, RunRow]) -> None:
        gone = [result for result in results if result.is_gone]
        if gone:
            self._let_go([rows[result.folder] for result in gone])
            what = f"“{rows[gone[0].folder].title}” was" if len(gone) == 1 else f"{len(gone)} runs were"
            back = [result for result in gone if result.place is not None]
            undo = ("Put back", lambda: self._put_back(back)) if back else None
            self._controller.say(Message("info", f"{what} moved to the trash.", action=undo))
        for result in results:
            if result.problem:
                self._controller.say(Message("error", result.problem))
        stuck = [rows[result.folder] for result in results if not result.is_gone and not result.problem]
        if stuck:
            self._offer_removal(stuck)
        self.refresh()

    def _offer_removal(self, rows: list[RunRow]) -> None:
        """Ask, where the system has no trash, whether runs are to be removed for good."""
        what = f"“{rows[0].title}”" if len(rows) == 1 else f"{len(rows)} runs"
        text = f"There is no trash for the disk that {what} {'is' if len(rows) == 1 else 'are'} on. Delete for good?"
        details = "Snapshots, settings and checkpoint are gone then, and cannot be brought back."
        if not dialogs.confirm(self._controller.window, text, details, "Delete for good"):
            return

        def remove() -> list[str]:
            problems = []
            for row in rows:
                try:
                    remove_run(row.folder)
                except RunError as error:
                    problems.append(str(error))
            return problems

        def done(problems: list[str]) -> None:
            for problem in problems:
                self._controller.say(Message("error", problem))
            self._let_go([row for row in rows if not row.folder.exists()])
            self.refresh()

        self._reading.submit("Deleting…", remove, done, lambda error: self._controller.tell_error(error, "Deleting"))

    def _let_go(self, rows: list[RunRow]) -> None:
        """Show and queue runs no longer that are gone."""
        workspace, other = self._workspace, self._workspace.comparison.other
        ids = {row.run_id for row in rows}
        self._controller.queue.forget(*(row.folder for row in rows))
        if other is not None and other.run_id in ids:
            workspace.comparison.set_other(None)
        run, problem, source = workspace.run, workspace.problem, workspace.source
        if run is not None and run.run_id in ids and problem is not None and source is not None:
            workspace.open_problem(problem, source)

    def _put_back(self, results: list[Trashed]) -> None:
        def work() -> Any:
            for result in results:
                put_back(result)

        self._reading.submit(
            "", work, lambda _none: self.refresh(), lambda error: self._controller.tell_error(error, "Putting back")
        )
