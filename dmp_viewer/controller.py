"""Wires workspace, window and training; the only place with slots that cut across them, named ``_on_<sender>_<event>``.

What changes in the workspace is collected and drawn once per turn of the event loop, the curve at most ten times a second.
"""

from __future__ import annotations

import logging
import traceback
from dataclasses import replace
from pathlib import Path

from qtpy.QtCore import QObject, QTimer, Signal
from qtpy.QtWidgets import QApplication

from dmp.errors import DmpError, NoHolesError
from dmp.runs import Run, default_runs_folder, is_run_folder
from dmp.snapshot import Snapshot
from dmp_viewer import settings as preferences_file
from dmp_viewer import tasks, theme
from dmp_viewer.background import Background, close_all
from dmp_viewer.comparing_control import ComparingControl
from dmp_viewer.curve_notes import is_judged_by_rest
from dmp_viewer.export import Exporter
from dmp_viewer.export_control import ExportControl
from dmp_viewer.hole_control import HoleControl
from dmp_viewer.judging_control import JudgingControl
from dmp_viewer.model import Workspace
from dmp_viewer.opener import Opener
from dmp_viewer.pace import Pace
from dmp_viewer.presenter import Presenter
from dmp_viewer.queue_control import QueueControl
from dmp_viewer.remote_control import RemoteControl
from dmp_viewer.report_control import ReportControl
from dmp_viewer.runner import Outcome, Progress, Runner, Session
from dmp_viewer.runs_control import RunsControl
from dmp_viewer.scanner import SnapshotScanner
from dmp_viewer.settings import Preferences
from dmp_viewer.states import RunnerState
from dmp_viewer.time_control import TimeControl
from dmp_viewer.view_control import ViewControl
from dmp_viewer.views import dialogs
from dmp_viewer.views.banner import Message
from dmp_viewer.views.main_window import MainWindow

_LOG = logging.getLogger(__name__)
_CLOSE_SECONDS = 3.0


class Controller(QObject):
    """Answers what the user does, and keeps the window in step with the workspace.

    Args:
        window: the views.
        preferences: what is remembered; written back when the window closes.
        preferences_path: where to, or None to remember nothing.
        runs_folder: where new runs go; by default where the library keeps them.

    Signals:
        errorTold: the sentence of an error that was shown.
    """

    errorTold = Signal(str)

    def __init__(
        self, window: MainWindow, preferences: Preferences, preferences_path: Path | None, runs_folder: Path | None = None
    ) -> None:
        super().__init__(window)
        self.window = window
        self.workspace = Workspace()
        self.runner = Runner(self)
        self.background = Background(self)
        self.scanner = SnapshotScanner(self.workspace, self)
        self.preferences = preferences
        self.runs_folder = runs_folder
        self.presenter = Presenter(window, self.workspace)
        self.exporter = Exporter(window, self.workspace, self.say)
        self._preferences_path = preferences_path
        self._warnings_told = 0
        self.opener = Opener(self)
        self.hole_control = HoleControl(self)
        self.judging = JudgingControl(self)
        self.comparing = ComparingControl(self)
        self.time = TimeControl(self)
        self.report = ReportControl(self)
        self.exports = ExportControl(self)
        self._connect()
        self.remote = RemoteControl(self)
        self.runs = RunsControl(self)
        self.view = ViewControl(self)
        self.queue = QueueControl(self, is_kept=preferences_path is not None)
        self._restore()

    def _connect(self) -> None:
        window, runner = self.window, self.runner
        window.close_guard = self._on_window_closing
        window.actionTriggered.connect(self._on_window_action)
        window.filesDropped.connect(self._on_window_files_dropped)
        window.sampleChosen.connect(self.opener.open_sample)
        window.recentChosen.connect(self._on_window_recent_chosen)
        window.curve.stepClicked.connect(self._on_curve_step_clicked)
        window.curve.logAxisChanged.connect(self._on_curve_log_axis_changed)
        window.curve.smoothingChanged.connect(self._on_curve_smoothing_changed)
        window.panes.interactor.interacted.connect(runner.give_way)
        window.timeline.slider.sliderMoved.connect(lambda _place: runner.give_way())
        window.panel.taskChosen.connect(self.opener.change_task)
        window.panel.settingsChanged.connect(self.workspace.set_wanted)
        self.workspace.set_wanted(window.panel.settings())
        runner.stateChanged.connect(self._on_runner_state_changed)
        runner.prepared.connect(self._on_runner_prepared)
        runner.progressed.connect(self._on_runner_progressed)
        runner.snapshotTaken.connect(self._on_runner_snapshot_taken)
        runner.failed.connect(self._on_runner_failed)
        runner.finished.connect(self._on_runner_finished)
        self.background.busyChanged.connect(window.statusBar().showMessage)
        theme.application().styleHints().colorSchemeChanged.connect(self._on_system_scheme_changed)

    def _restore(self) -> None:
        preferences, window = self.preferences, self.window
        self.workspace.colors.set(
            quantity=preferences.quantity, range=preferences.range, unit=preferences.unit, outliers=preferences.outliers
        )
        self.workspace.look.set(edges=preferences.edges, shading=preferences.shading, orthographic=preferences.orthographic)
        window.curve.set_log_axis(preferences.log_axis)
        window.curve.set_smoothing(preferences.smoothing)
        window.set_panel_visible(preferences.show_panel)
        window.set_curve_visible(preferences.show_curve)
        window.named_actions["show_panel"].setChecked(preferences.show_panel)
        window.named_actions["show_curve"].setChecked(preferences.show_curve)
        window.named_actions["show_thumbnails"].setChecked(preferences.show_thumbnails)
        window.timeline.set_strip_wanted(preferences.show_thumbnails)
        window.timeline.set_speed(preferences.play_speed)
        window.restore_layout(preferences.geometry, preferences.splitters)
        window.restore_docks(preferences.docks)
        window.named_actions["show_runs"].setChecked(not window.runs.isHidden())
        window.set_recent(preferences.existing_recent())
        self.set_theme(preferences.theme)
        self._set_pace(Pace(preferences.pace))
        self.presenter.refresh_all()

    # -- messages -----------------------------------------------------------------------------------------------------

    def say(self, message: Message) -> None:
        """Show a message in the window."""
        self.window.banners.show_message(message)

    def tell_error(self, error: BaseException, doing: str = "") -> None:
        """Tell an error: as it stands when it was made for people, otherwise as a fault of the program with its details."""
        self.opener.forget_start()
        if isinstance(error, DmpError):
            # Without holes there is nothing to do, and nothing wrong.
            self.say(Message("info" if isinstance(error, NoHolesError) else "error", str(error)))
            self.errorTold.emit(str(error))
            return
        details = "".join(traceback.format_exception(error))
        what = f"{doing}: s" if doing else "S"
        text = f"{what}omething went wrong inside the program ({type(error).__name__}: {error})."
        self.say(Message("error", text, details))
        self.errorTold.emit(text)

    # -- leaving a training -------------------------------------------------------------------------------------------

    def may_leave_training(self, what: str) -> bool:
        """Tell whether ``what`` may be done: at once when nothing is being trained, else after a question and a clean end."""
        if self.runner.state.is_active:
            details = "The run keeps all its snapshots and can be opened and continued later."
            if not dialogs.confirm(self.window, f"A training is running. End it and {what}?", details, "End and open"):
                return False
            self._end_training()
        return self._may_lose_what_is_in_memory()

    def _may_lose_what_is_in_memory(self) -> bool:
        """Ask before a run is let go that could not be written to its folder; a window that nobody looks at never waits."""
        run = self.workspace.run
        if not isinstance(run, Run) or not run.is_in_memory or self._preferences_path is None:
            return True
        text = f"What was learnt last could not be written to {run.folder}. Let it go?"
        details = "It is in memory only. Cancel, make room or save the mesh somewhere else, and try again."
        return dialogs.confirm(self.window, text, details, "Let it go")

    def _end_training(self) -> None:
        """Stop the training and wait for it; a step that hangs is left behind only when the user says so."""
        self.runner.stop()
        while not self.runner.wait(_CLOSE_SECONDS):
            details = "What was learnt until the last snapshot is safe in the run folder."
            if dialogs.confirm(self.window, "The training does not answer. Leave it behind?", details, "Leave it"):
                self.runner.abandon()

    # -- training -----------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Begin a new run on the open mesh with the settings of the panel."""
        workspace = self.workspace
        source = workspace.source
        if self.opener.is_opening:
            self.opener.start_when_opened()
            return
        if source is None or not workspace.controls.start:
            return
        try:
            settings = self.window.panel.settings()
        except DmpError:  # the panel says already which one
            return
        self.window.banners.clear()
        self._warnings_told = 0
        folder, loops = self.runs_folder, self.hole_control.loops_to_fill()
        if self.remote.start(source, settings, folder, loops):
            return
        leaves_core = self.runner.pace is Pace.SMOOTH
        self.runner.start(lambda: tasks.start_session(source, settings, folder, loops, leaves_core=leaves_core))

    def proceed(self) -> None:
        """Go on with the run on show."""
        run = self.workspace.run
        if self.opener.is_opening or not self.workspace.controls.proceed or not isinstance(run, Run):
            return
        self.window.banners.clear()
        self._warnings_told = len(run.warnings)
        steps = self.workspace.continue_until
        if self.remote.proceed(run, steps):
            return
        leaves_core = self.runner.pace is Pace.SMOOTH
        self.runner.start(lambda: tasks.continue_session(run, steps, leaves_core=leaves_core))

    def _on_runner_state_changed(self, state: RunnerState) -> None:
        self.workspace.set_state(state)

    def _on_runner_prepared(self, session: Session) -> None:
        self.queue.before_begin(session)
        self.workspace.begin_run(session.run, session.problem, session.device)

    def _on_runner_progressed(self, progress: Progress) -> None:
        if self.workspace.run is not None and progress.run_id == self.workspace.run.run_id:
            self.presenter.set_speed(progress.steps_per_second)
            self.workspace.add_records(progress.records)
            self._tell_run_warnings()

    def _on_runner_snapshot_taken(self, snapshot: Snapshot) -> None:
        if self.workspace.run is not None and snapshot.run_id == self.workspace.run.run_id:
            self.workspace.add_snapshot(snapshot)

    def _on_runner_failed(self, error: BaseException) -> None:
        self.tell_error(error, "Training")

    def _on_runner_finished(self, outcome: Outcome) -> None:
        run = self.workspace.run
        if run is None or outcome.run_id != run.run_id:
            return
        try:
            self.workspace.refresh_from_run()
        except DmpError as error:
            self.tell_error(error)
        self._tell_run_warnings()
        if outcome.completed and self.workspace.came_to_rest:
            step = f"{self.workspace.current_step:,}"
            self.say(Message("success", f"The inserted vertices have come to rest at step {step}: the completion is done."))
            return
        if outcome.completed and is_judged_by_rest(self.workspace):
            more = "; with more steps it can still get better" if run.settings.rest_movement > 0 else ""
            self.say(Message("success", f"The training has reached its last step, and the completion is ready{more}."))
            return
        suggestion = self.workspace.suggestion
        if outcome.completed and suggestion is not None and self.workspace.kept_step is None:
            text = f"The training has reached its last step. Suggested: step {suggestion.step:,}. {suggestion.reason}"
            seen = self.workspace.shown_step == suggestion.step
            show = None if seen else ("Show it", lambda: self.workspace.show_step(suggestion.step))
            self.say(Message("success", text, action=show))

    def forget_told_warnings(self) -> None:
        """Tell all warnings of the next run, from the first one on."""
        self._warnings_told = 0

    def tell_about_run(self, run: Run) -> None:
        """Tell what is odd about a run that was opened."""
        self._tell_run_warnings()
        if change := run.change_of_input():
            self.say(Message("info", change))

    def _tell_run_warnings(self) -> None:
        run = self.workspace.run
        if run is not None:
            for text in run.warnings[self._warnings_told :]:
                self.say(Message("warning", text))
            self._warnings_told = len(run.warnings)

    # -- actions ------------------------------------------------------------------------------------------------------

    def _on_window_action(self, name: str) -> None:
        parts = (self.judging, self.time, self.comparing, self.report, self.exports, self.runs, self.queue, self.view)
        if not any(part.do(name) for part in parts):
            getattr(self, f"_do_{name}")()

    def _do_open(self) -> None:
        from dmp.meshio import READABLE_SUFFIXES

        path = dialogs.ask_mesh(self.window, "Open a mesh", self.preferences.folder, tuple(READABLE_SUFFIXES))
        if path is not None:
            self.opener.open_path(path)

    def _do_open_ground_truth(self) -> None:
        from dmp.meshio import READABLE_SUFFIXES

        problem, source = self.workspace.problem, self.workspace.source
        if problem is None or source is None:
            return
        folder = str(source.folder or self.preferences.folder)
        path = dialogs.ask_mesh(self.window, "Open the clean version of this mesh", folder, tuple(READABLE_SUFFIXES))
        if path is not None:
            self.opener.open_ground_truth(path)

    def _do_open_run(self) -> None:
        folder = self.runs_folder or default_runs_folder()
        path = dialogs.ask_run(self.window, str(folder if folder.is_dir() else self.preferences.folder))
        if path is None:
            return
        if is_run_folder(path):
            self.opener.open_path(path)
        else:
            self.say(Message("error", f"{path} is not a run folder. Choose a folder that holds a file named run.json."))

    def _on_window_files_dropped(self, paths: list[Path]) -> None:
        self.opener.open_path(paths[0])
        if len(paths) > 1:
            self.say(Message("info", f"{len(paths)} files were dropped; only {paths[0].name} was opened."))

    def _on_window_recent_chosen(self, text: str) -> None:
        self.opener.open_path(Path(text))

    def _do_save(self) -> None:
        step = self.workspace.kept_step if self.workspace.kept_step is not None else self.workspace.shown_step
        self.exporter.save_mesh(step, self.preferences.folder)

    def _do_save_shown(self) -> None:
        self.exporter.save_mesh(self.workspace.shown_step, self.preferences.folder)

    def _do_screenshot(self) -> None:
        self.exporter.save_picture(self.preferences.folder)

    def _do_quit(self) -> None:
        self.window.close()

    def _do_filling_only(self) -> None:
        self.workspace.set_filling_only(not self.workspace.filling_only)

    def _do_reset_view(self) -> None:
        self.window.panes.reset_view()

    def _do_show_panel(self) -> None:
        self.window.set_panel_visible(self.window.named_actions["show_panel"].isChecked())

    def _do_show_curve(self) -> None:
        self.window.set_curve_visible(self.window.named_actions["show_curve"].isChecked())

    def _do_pace_smooth(self) -> None:
        self._set_pace(Pace.SMOOTH)

    def _do_pace_fast(self) -> None:
        self._set_pace(Pace.FAST)

    def _set_pace(self, pace: Pace) -> None:
        self.preferences.pace = pace.value
        self.runner.set_pace(pace)
        self.window.set_pace(pace.value)

    def _do_theme_auto(self) -> None:
        self.set_theme("auto")

    def _do_theme_light(self) -> None:
        self.set_theme("light")

    def _do_theme_dark(self) -> None:
        self.set_theme("dark")

    def _do_start(self) -> None:
        self.start()

    def _do_proceed(self) -> None:
        self.proceed()

    def _do_pause(self) -> None:
        self.runner.pause()

    def _do_resume(self) -> None:
        self.runner.resume()

    def _do_stop(self) -> None:
        self.runner.stop()

    def _do_keep(self) -> None:
        self._keep(self.workspace.shown_step)

    def _do_forget_kept(self) -> None:
        self._keep(None)

    def _do_keys(self) -> None:
        dialogs.KeysDialog(self.window, self.window.keys()).show()

    def _do_log_file(self) -> None:
        from dmp_viewer.startup import log_path

        QApplication.clipboard().setText(str(log_path()))
        self.window.statusBar().showMessage(f"Copied: {log_path()}", 6000)

    def _do_about(self) -> None:
        dialogs.AboutDialog(self.window, self.workspace.device).show()

    def _keep(self, step: int | None) -> None:
        try:
            self.workspace.keep(step)
        except DmpError as error:
            self.tell_error(error)

    # -- curve and theme ----------------------------------------------------------------------------------------------

    def _on_curve_step_clicked(self, step: float) -> None:
        self.workspace.show_step(round(step))

    def _on_curve_log_axis_changed(self, logarithmic: bool) -> None:
        self.preferences.log_axis = logarithmic
        self.window.curve.set_log_axis(logarithmic)

    def _on_curve_smoothing_changed(self, strength: float) -> None:
        self.preferences.smoothing = strength
        self.window.curve.set_smoothing(strength)

    def set_theme(self, choice: str) -> None:
        """Use ``auto``, ``light`` or ``dark`` colours from now on."""
        self.preferences.theme = choice
        self.window.named_actions[f"theme_{choice}"].setChecked(True)
        self.window.set_theme(theme.apply(choice, theme.application()))
        self.presenter.refresh_all()

    def _on_system_scheme_changed(self) -> None:
        if self.preferences.theme == "auto":
            QTimer.singleShot(0, self, lambda: self.set_theme("auto"))

    # -- closing ------------------------------------------------------------------------------------------------------

    def _on_window_closing(self) -> bool:
        if not self.queue.may_close():
            return False
        self.queue.close()
        if self.runner.state.is_active:
            self.window.statusBar().showMessage("Ending the training…")
            self.remote.leave()
            self._end_training()
        if not self._may_lose_what_is_in_memory():
            return False
        self.leave()
        return True

    def leave(self) -> None:
        """Write what is to be remembered, and end everything that works in the background."""
        self.save_preferences()
        self.window.timeline.set_playing(False)
        self.queue.release()
        self.exports.cancel()
        self.scanner.cancel()
        close_all(self.findChildren(Background))
        for part in (self.exports, self.runs, self.comparing, self.presenter):
            part.close()

    def save_preferences(self) -> None:
        """Write what is to be remembered."""
        if self._preferences_path is None:
            return
        policy, look, window = self.workspace.colors.policy, self.workspace.look.policy, self.window
        geometry, splitters = window.layout_state()
        remembered = replace(
            self.preferences,
            geometry=geometry, splitters=splitters, docks=window.docks_state(), quantity=policy.quantity, unit=policy.unit,
            # A locked range belongs to the mesh that it was locked for.
            range="step" if policy.range == "locked" else policy.range,
            outliers=policy.outliers, edges=look.edges, shading=look.shading, orthographic=look.orthographic,
            show_panel=window.named_actions["show_panel"].isChecked(),
            show_curve=window.named_actions["show_curve"].isChecked(),
        )  # fmt: skip
        preferences_file.save(remembered, self._preferences_path)
