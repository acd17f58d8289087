"""Draws the workspace into the window: what has changed is collected, and drawn once per turn of the event loop."""

from __future__ import annotations

from qtpy.QtCore import QObject, QTimer

from dmp.errors import DmpError
from dmp.problem import Problem
from dmp.settings import Settings
from dmp_viewer import curve_notes as notes
from dmp_viewer.curve import Curve
from dmp_viewer.hole_presenter import HolePresenter
from dmp_viewer.marks import step_marks
from dmp_viewer.memory_use import memory_text
from dmp_viewer.model import Workspace
from dmp_viewer.other_run import OtherRun
from dmp_viewer.pane_presenter import PanePresenter
from dmp_viewer.possible import possible_actions
from dmp_viewer.views.banner import Message
from dmp_viewer.views.main_window import MainWindow
from dmp_viewer.views.run_panel import Status, progress_text
from dmp_viewer.views.timeline import slider_marks

# The curve is drawn again ten times a second, a long one less often: what comes meanwhile is less than a pixel of it.
_CURVE_INTERVAL_MS, _LONGEST_CURVE_INTERVAL_MS, _CURVE_ROWS_A_MS = 100, 1000, 40
_ALL = (
    "mesh", "look", "switches", "input", "middle", "predicted", "compared", "scale", "steps", "markers", "controls",
    "progress", "titles", "holes", "rims", "note", "picked", "other",
)  # fmt: skip
_PANES = ("input", "middle", "predicted", "compared", "scale", "picked")


class Presenter(QObject):
    """Keeps the views equal to the workspace; changes nothing in it."""

    def __init__(self, window: MainWindow, workspace: Workspace) -> None:
        super().__init__(window)
        self._window = window
        self._workspace = workspace
        self._speed = 0.0
        self._drawn_other: OtherRun | None = None
        self._holes = HolePresenter(window, workspace)
        self._panes = PanePresenter(window, workspace, self._holes, self._tell)
        self._dirty: set[str] = set()
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(0)
        self._timer.timeout.connect(self.flush)
        self._curve_timer = QTimer(self)
        self._curve_timer.setSingleShot(True)
        self._drawn_curve: Curve | None = None
        self._curve_timer.timeout.connect(self._draw_curve)
        for signal, parts in (
            (workspace.problem_changed, _ALL),
            (workspace.run_changed, (*_PANES, "steps", "markers", "controls", "progress", "titles", "note")),
            (workspace.snapshots_changed, ("steps", "markers", "controls")),
            (workspace.shown_step_changed, ("predicted", "scale", "steps", "controls", "titles", "picked")),
            (workspace.kept_step_changed, ("markers", "controls", "titles")),
            (workspace.suggestion_changed, ("markers", "controls")),
            (workspace.follow_latest_changed, ("controls",)),
            (workspace.colors.changed, ("look", "switches", *_PANES, "holes")),
            (workspace.colors.extents_changed, ("scale",)),
            (workspace.look.changed, ("look", "switches", *_PANES)),
            (workspace.comparison.changed, ("switches", *_PANES, "other", "markers", "controls", "titles")),
            (workspace.bookmarks.changed, ("markers", "controls")),
            (workspace.picking.changed, ("picked", "controls")),
            (workspace.picking.history_changed, ("picked",)),
            (workspace.comparison.mode_changed, ("switches", "compared", "titles")),
            (workspace.state_changed, ("controls", "progress", "titles", "note")),
            (workspace.wanted_changed, ("controls", "holes", "rims", "note")),
            (workspace.holes.changed, ("holes", "rims")),
            (workspace.holes.pointed_changed, ("rims",)),
            (workspace.filling_only_changed, ("predicted", "scale", "controls", "titles")),
            (workspace.hole_measures_changed, ("titles", "note")),
            (workspace.progress_changed, ("progress",)),
        ):
            # A default argument instead of a closure: psygnal keeps a strong reference to the function, and calls it bare.
            signal.connect(lambda parts=parts: self.mark(*parts), check_nargs=False)
        workspace.curve_changed.connect(self._on_curve_changed)

    def mark(self, *parts: str) -> None:
        """Have parts of the window drawn anew with the next turn of the event loop."""
        self._dirty.update(parts)
        self._timer.start()

    def refresh_all(self) -> None:
        """Draw everything anew."""
        self.mark(*_ALL)
        self._on_curve_changed()

    def set_speed(self, steps_per_second: float) -> None:
        """Tell how fast the training is, for the next drawing of the progress."""
        self._speed = steps_per_second

    def close(self) -> None:
        """Draw nothing any more."""
        self._timer.stop()
        self._curve_timer.stop()

    def flush(self) -> None:
        """Draw what has changed, now."""
        self._timer.stop()
        parts, self._dirty = self._dirty, set()
        workspace = self._workspace
        self._window.set_has_mesh(workspace.problem is not None)
        if "look" in parts:
            self._panes.draw_look()
        if "switches" in parts:
            self._panes.draw_switches()
        if workspace.problem is not None:
            self._draw_panes(workspace.problem, parts)
        for part, draw in (
            ("steps", self._draw_steps),
            ("markers", self._draw_markers),
            ("controls", self._draw_controls),
            ("progress", self._draw_progress),
            ("titles", self._panes.draw_titles),
            ("holes", self._holes.draw_list),
            ("rims", self._holes.draw_rims),
            ("note", self._draw_note),
            ("picked", self._panes.draw_picked),
            ("other", self._draw_other),
        ):
            if part in parts:
                draw()

    def _draw_panes(self, problem: Problem, parts: set[str]) -> None:
        panes = self._panes
        if "mesh" in parts and panes.draw_mesh(problem):
            self.mark("rims")
        for part, draw in (
            ("input", panes.draw_input),
            ("middle", panes.draw_middle),
            ("predicted", panes.draw_prediction),
            ("compared", panes.draw_compared),
            ("scale", panes.draw_scale),
        ):
            if part in parts:
                draw()

    def _tell(self, error: DmpError) -> None:
        self._window.banners.show_message(Message("error", str(error)))

    # -- steps --------------------------------------------------------------------------------------------------------

    def _draw_steps(self) -> None:
        workspace, window = self._workspace, self._window
        window.timeline.set_steps(workspace.snapshot_steps)
        window.timeline.set_shown_step(workspace.shown_step, max(workspace.total_steps, workspace.latest_step or 0))
        window.curve.set_shown_step(workspace.shown_step)

    def _draw_other(self) -> None:
        other, window = self._workspace.comparison.other, self._window
        if other is not self._drawn_other:
            self._drawn_other = other
            window.curve.set_other(other.curve if other is not None else None, other.name if other is not None else "")
        if other is None:
            window.other_timeline.set_run("", [], None, [])
        else:
            marks = slider_marks(other.marks(), [], other.steps, window.theme)
            window.other_timeline.set_run(other.name, other.steps, other.shown_step, marks)

    def _draw_markers(self) -> None:
        workspace, window = self._workspace, self._window
        marks = step_marks(workspace)
        window.timeline.set_marks(marks, workspace.bookmarks.steps)
        suggestion = workspace.suggestion
        window.curve.set_marks(
            marks, suggestion.reason if suggestion is not None else "", suggestion.between if suggestion is not None else None
        )

    def _on_curve_changed(self) -> None:
        curve = self._workspace.curve
        longest = _LONGEST_CURVE_INTERVAL_MS if curve is self._drawn_curve else _CURVE_INTERVAL_MS
        interval = min(longest, max(_CURVE_INTERVAL_MS, len(curve) // _CURVE_ROWS_A_MS))
        if not self._curve_timer.isActive() or interval < self._curve_timer.remainingTime():
            self._curve_timer.start(interval)

    def _draw_curve(self) -> None:
        workspace = self._workspace
        self._drawn_curve = workspace.curve
        settings: Settings | None = workspace.run.settings if workspace.run is not None else None
        self._window.curve.set_curve(workspace.curve, settings)
        self._draw_note()

    # -- controls -----------------------------------------------------------------------------------------------------

    def _draw_controls(self) -> None:
        workspace, actions = self._workspace, self._window.named_actions
        shown, kept = workspace.shown_step, workspace.kept_step
        for name, possible in possible_actions(workspace).items():
            actions[name].setEnabled(possible)
        actions["bookmark"].setChecked(shown in workspace.bookmarks.steps)
        actions["follow"].setChecked(workspace.follow_latest)
        actions["keep"].setText("&Kept" if kept is not None and shown == kept else "&Keep this step")
        actions["save"].setText(f"&Save kept step {kept:,}…" if kept is not None else "&Save mesh…")
        actions["start"].setText("&Start" if workspace.run is None else "&Start a new run")
        actions["filling_only"].setVisible(workspace.is_completion)
        actions["filling_only"].setChecked(workspace.filling_only)
        until, run = workspace.continue_until, workspace.run
        raised = until is not None and run is not None and until > run.settings.steps
        actions["proceed"].setText(f"&Continue to {until:,} steps" if raised else "&Continue")
        self._window.panel.set_controls(workspace.controls, workspace.state)

    def _draw_progress(self) -> None:
        workspace = self._workspace
        status = Status(
            state=workspace.state,
            step=workspace.current_step,
            total=workspace.total_steps,
            speed=self._speed,
            seconds=workspace.seconds,
            device=workspace.device,
            run_state=self._run_state(),
        )
        self._window.panel.set_status(status)
        self._window.set_progress(progress_text(status, memory_text(workspace.device) if workspace.state.is_active else ""))

    def _run_state(self) -> str:
        workspace = self._workspace
        if workspace.run is None or workspace.state.is_active:
            return ""
        return "rest" if workspace.came_to_rest else workspace.run.state

    def _draw_note(self) -> None:
        """Say what the curve shows, and draw the values to compare it with."""
        workspace, curve = self._workspace, self._window.curve
        settings = workspace.run.settings if workspace.run is not None else workspace.wanted
        curve.set_task(notes.kind_of(settings))
        curve.set_note(notes.note(workspace))
        curve.set_references(notes.references(workspace))
