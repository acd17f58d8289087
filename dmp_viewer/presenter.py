"""Draws the workspace into the window: what has changed is collected, and drawn once per turn of the event loop."""

from __future__ import annotations

import numpy as np
from qtpy.QtCore import QObject, QTimer

from dmp.errors import DmpError
from dmp.problem import Problem
from dmp.settings import Settings
from dmp_viewer import curve_notes as notes
from dmp_viewer.colors import color_table
from dmp_viewer.hole_presenter import HolePresenter
from dmp_viewer.model import Workspace
from dmp_viewer.states import RunnerState
from dmp_viewer.views.banner import Message
from dmp_viewer.views.main_window import MainWindow
from dmp_viewer.views.mesh_panes import INPUT, PANE_NAMES, PREDICTED, SMOOTHED
from dmp_viewer.views.run_panel import Status

_CURVE_INTERVAL_MS = 100
_BEST = {"mad": "best MAD", "hole_distance": "closest to truth"}
_SEPARATOR = "  ·  "
_ALL = ("mesh", "policy", "predicted", "steps", "markers", "controls", "progress", "titles", "holes", "rims", "note")


class Presenter(QObject):
    """Keeps the views equal to the workspace; changes nothing in it."""

    def __init__(self, window: MainWindow, workspace: Workspace) -> None:
        super().__init__(window)
        self._window = window
        self._workspace = workspace
        self._speed = 0.0
        self._drawn: Problem | None = None
        self._holes = HolePresenter(window, workspace)
        self._dirty: set[str] = set()
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(0)
        self._timer.timeout.connect(self.flush)
        self._curve_timer = QTimer(self)
        self._curve_timer.setSingleShot(True)
        self._curve_timer.setInterval(_CURVE_INTERVAL_MS)
        self._curve_timer.timeout.connect(self._draw_curve)
        for signal, parts in (
            (workspace.problem_changed, _ALL),
            (workspace.run_changed, ("predicted", "steps", "markers", "controls", "progress", "titles", "note")),
            (workspace.snapshots_changed, ("steps", "markers", "controls")),
            (workspace.shown_step_changed, ("predicted", "steps", "controls", "titles")),
            (workspace.kept_step_changed, ("markers", "controls", "titles")),
            (workspace.suggestion_changed, ("markers", "controls")),
            (workspace.follow_latest_changed, ("controls",)),
            (workspace.coloring_changed, ("policy", "predicted", "mesh_values", "holes")),
            (workspace.linked_changed, ("policy",)),
            (workspace.edges_changed, ("policy",)),
            (workspace.up_changed, ("policy",)),
            (workspace.state_changed, ("controls", "progress", "titles", "note")),
            (workspace.wanted_changed, ("controls", "holes", "rims", "note")),
            (workspace.holes.changed, ("holes", "rims")),
            (workspace.holes.pointed_changed, ("rims",)),
            (workspace.filling_only_changed, ("predicted", "controls", "titles")),
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
        self.mark(*_ALL, "mesh_values")
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
        if "policy" in parts:
            self._draw_policy()
        if workspace.problem is not None:
            if "mesh" in parts or "mesh_values" in parts:
                self._draw_meshes(workspace.problem)
            if "predicted" in parts or "mesh" in parts:
                self._draw_prediction(workspace.problem)
        for part, draw in (
            ("steps", self._draw_steps),
            ("markers", self._draw_markers),
            ("controls", self._draw_controls),
            ("progress", self._draw_progress),
            ("titles", self._draw_titles),
            ("holes", self._holes.draw_list),
            ("rims", self._holes.draw_rims),
            ("note", self._draw_note),
        ):
            if part in parts:
                draw()

    # -- meshes and colours -------------------------------------------------------------------------------------------

    def _draw_policy(self) -> None:
        workspace, window = self._workspace, self._window
        policy = workspace.coloring
        window.color_bar.set_policy(policy.quantity, policy.range, policy.unit)
        window.named_actions[policy.quantity].setChecked(True)
        window.named_actions["edges"].setChecked(workspace.edges)
        window.named_actions["link"].setChecked(workspace.linked)
        window.panes.set_color_table(color_table(policy.quantity))
        window.panes.set_linked(workspace.linked)
        window.panes.set_edges(workspace.edges)
        window.named_actions["z_up"].setChecked(workspace.up == "z")
        window.panes.set_up(workspace.up)

    def _draw_meshes(self, problem: Problem) -> None:
        panes, workspace = self._window.panes, self._workspace
        known, source = self._drawn, workspace.source
        if (
            known is None
            or not (known.mesh is problem.mesh or known.mesh.same_connectivity(problem.mesh))
            or not np.array_equal(known.target, problem.target)
        ):
            input_faces = source.mesh.faces if source is not None and problem.task == "complete" else None
            panes.set_mesh(problem.target, problem.mesh.faces, input_faces)
            self._holes.draw_seam(problem)
            self.mark("rims")
            panes.set_positions(INPUT, problem.target)
            panes.reset_view()
        self._drawn = problem
        panes.set_positions(SMOOTHED, problem.base)
        # The smoothed mesh is what displacements are measured from: its own is 0 everywhere, so it stays bare.
        panes.set_values(SMOOTHED, None)
        plain = workspace.coloring.quantity == "plain"
        panes.set_values(INPUT, None if plain else workspace.values_of(problem.target))

    def _draw_prediction(self, problem: Problem) -> None:
        workspace, panes = self._workspace, self._window.panes
        try:
            positions = workspace.shown_positions()
            limits = workspace.limits()
        except DmpError as error:
            self._window.banners.show_message(Message("error", str(error)))
            panes.set_positions(PREDICTED, None)
            return
        panes.set_positions(PREDICTED, positions)
        policy = workspace.coloring
        if positions is not None:
            panes.set_values(PREDICTED, None if policy.quantity == "plain" else workspace.values_of(positions))
        panes.set_limits(limits)
        factor, unit = (1.0 / problem.edge_length, "edge lengths") if policy.unit == "edges" else (1.0, "file units")
        self._window.color_bar.gradient.set_scale(color_table(policy.quantity), limits, factor, unit)

    def _draw_titles(self) -> None:
        workspace, panes = self._workspace, self._window.panes
        problem, source = workspace.problem, workspace.source
        if problem is None or source is None:
            return
        # The mesh as it was opened: what hole filling inserted is no part of the input.
        mesh = source.mesh if problem.task == "complete" else problem.mesh
        name = source.path.name if source.path is not None else source.name
        facts, smoothed = [_shortened(name)], ["base of the displacements"]
        for texts, positions in ((facts, problem.target), (smoothed, problem.base)):
            mad = workspace.mad_of(positions)
            if mad is not None:
                texts.append(f"MAD {mad:.2f}°")
        facts += [f"{mesh.n_vertices:,} vertices", f"{mesh.n_faces:,} faces"]
        whole = f"{source.path or name}\n{mesh.n_vertices:,} vertices, {mesh.n_faces:,} faces"
        explained = "The input after Laplacian smoothing. The network learns displacements from here."
        panes.set_title(INPUT, PANE_NAMES[INPUT], facts, whole)
        panes.set_title(SMOOTHED, PANE_NAMES[SMOOTHED], smoothed, explained)
        self._draw_prediction_title()
        self._window.setWindowTitle(f"{source.name} – dmp-viewer")
        status = [f"{mesh.n_vertices:,} vertices", f"{mesh.n_faces:,} faces", f"mean edge length {problem.edge_length:.4g}"]
        if problem.ground_truth is not None:
            path = source.ground_truth_path
            status.append(f"ground truth: {_shortened(path.name)}" if path is not None else "with ground truth")
        self._window.set_facts(_SEPARATOR.join(status))

    def _draw_prediction_title(self) -> None:
        workspace = self._workspace
        step = workspace.shown_step
        if workspace.is_completion and workspace.filling_only:
            facts = [*self._holes.facts(), "nothing is learnt"]
            self._window.panes.set_title(PREDICTED, "Hole filling alone", facts)
            return
        if step is None:
            waiting = workspace.state in (RunnerState.PREPARING, RunnerState.RUNNING)
            hint = "The first prediction comes in a moment" if waiting else "Press Start to train the network on this mesh"
            self._window.panes.set_title(PREDICTED, PANE_NAMES[PREDICTED], [hint])
            return
        facts = []
        try:
            snapshot = workspace.snapshot(step)
        except DmpError:
            snapshot = None
        mad = workspace.mad_at(snapshot) if snapshot is not None else None
        if mad is not None:
            facts.append(f"MAD {mad:.2f}°")
        facts += self._holes.facts()
        if step == 0:
            facts.append("the untrained network")
        if step == workspace.kept_step:
            facts.append("kept")
        suggestion = None if notes.is_judged_by_rest(workspace) else workspace.suggestion
        if suggestion is not None and step == suggestion.step and step != 0:
            facts.append("suggested")
        if step == workspace.best_step:
            facts.append(f"{_BEST[workspace.quality]} so far" if workspace.state.is_active else _BEST[workspace.quality])
        if not facts and step == workspace.latest_step:
            facts.append("latest")
        name = "Completion" if workspace.is_completion else PANE_NAMES[PREDICTED]
        self._window.panes.set_title(PREDICTED, f"{name} @ step {step:,}", facts)

    # -- steps --------------------------------------------------------------------------------------------------------

    def _draw_steps(self) -> None:
        workspace, window = self._workspace, self._window
        window.timeline.set_steps(workspace.snapshot_steps)
        window.timeline.set_shown_step(workspace.shown_step, max(workspace.total_steps, workspace.latest_step or 0))
        window.curve.set_shown_step(workspace.shown_step)

    def _draw_markers(self) -> None:
        workspace, window = self._workspace, self._window
        suggestion = workspace.suggestion if workspace.latest_step and not notes.is_judged_by_rest(workspace) else None
        suggested = suggestion.step if suggestion is not None else None
        best = workspace.best_step
        window.timeline.set_markers(workspace.kept_step, suggested, best)
        reason = suggestion.reason if suggestion is not None else ""
        window.curve.set_markers(workspace.kept_step, suggested, reason, best, _BEST[workspace.quality])

    def _on_curve_changed(self) -> None:
        if not self._curve_timer.isActive():
            self._curve_timer.start()

    def _draw_curve(self) -> None:
        workspace = self._workspace
        settings: Settings | None = workspace.run.settings if workspace.run is not None else None
        self._window.curve.set_curve(workspace.curve, settings)
        self._draw_note()

    # -- controls -----------------------------------------------------------------------------------------------------

    def _draw_controls(self) -> None:
        workspace, actions = self._workspace, self._window.named_actions
        controls = workspace.controls
        steps, shown, kept = workspace.snapshot_steps, workspace.shown_step, workspace.kept_step
        for name, enabled in (
            ("start", controls.start), ("pause", controls.pause), ("resume", controls.resume), ("stop", controls.stop),
            ("proceed", controls.proceed), ("open_ground_truth", controls.edit and workspace.problem is not None),
            ("save", shown is not None), ("save_shown", shown is not None), ("keep", shown is not None and shown != kept),
            ("forget_kept", kept is not None), ("show_suggested", workspace.suggestion is not None),
            ("play", len(steps) > 1), ("follow", bool(steps)),
            ("first_step", len(steps) > 1 and shown != steps[0]), ("previous_step", len(steps) > 1 and shown != steps[0]),
            ("next_step", len(steps) > 1 and shown != steps[-1]), ("last_step", len(steps) > 1 and shown != steps[-1]),
            ("reset_view", workspace.problem is not None), ("edges", workspace.problem is not None),
            ("link", workspace.problem is not None), ("filling_only", workspace.is_completion),
            ("z_up", workspace.problem is not None), ("magnitude", workspace.problem is not None),
            ("signed", workspace.problem is not None), ("plain", workspace.problem is not None),
        ):  # fmt: skip
            actions[name].setEnabled(enabled)
        actions["follow"].setChecked(workspace.follow_latest)
        actions["keep"].setText("&Kept" if kept is not None and shown == kept else "&Keep this step")
        actions["save"].setText(f"&Save kept step {kept:,}…" if kept is not None else "&Save mesh…")
        actions["start"].setText("&Start" if workspace.run is None else "&Start a new run")
        actions["filling_only"].setVisible(workspace.is_completion)
        actions["filling_only"].setChecked(workspace.filling_only)
        until, run = workspace.continue_until, workspace.run
        raised = until is not None and run is not None and until > run.settings.steps
        actions["proceed"].setText(f"&Continue to {until:,} steps" if raised else "&Continue")
        self._window.panel.set_controls(controls, workspace.state)

    def _draw_progress(self) -> None:
        workspace = self._workspace
        self._window.panel.set_status(
            Status(
                state=workspace.state,
                step=workspace.current_step,
                total=workspace.total_steps,
                speed=self._speed,
                seconds=workspace.seconds,
                device=workspace.device,
                run_state=self._run_state(),
            )
        )

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


def _shortened(name: str, most: int = 26) -> str:
    """Return a file name with its middle left out when it is long; beginning and suffix tell most."""
    return name if len(name) <= most else f"{name[: most - 11]}…{name[-10:]}"
