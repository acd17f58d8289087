"""The workspace: what is open, what has been learnt, what is shown. Plain Python with signals; no widget is known here.

The GUI thread owns it. What comes from the training thread arrives as frozen records through the controller.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from psygnal import Signal

from dmp.errors import DmpError
from dmp.mesh import TriangleMesh
from dmp.metrics import GroundTruth
from dmp.problem import Problem
from dmp.settings import Settings
from dmp.snapshot import Snapshot, StepRecord
from dmp.stopping import Suggestion, suggest
from dmp_viewer.bookmarks import Bookmarks
from dmp_viewer.coloring import Coloring
from dmp_viewer.colors import UpAxis
from dmp_viewer.comparison import Comparison
from dmp_viewer.curve import Curve
from dmp_viewer.holes import HoleChoice, Holes
from dmp_viewer.look import Look
from dmp_viewer.picking import Picking
from dmp_viewer.ruler import MeshState, StateKey, Surface
from dmp_viewer.snapshot_cache import SnapshotCache
from dmp_viewer.states import Controls, RunnerState, controls_for


class RunLike(Protocol):
    """What the workspace needs of a :class:`dmp.runs.Run`."""

    settings: Settings
    warnings: list[str]

    @property
    def run_id(self) -> str: ...  # noqa: D102
    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def folder(self) -> Path | None: ...  # noqa: D102
    @property
    def state(self) -> str: ...  # noqa: D102
    @property
    def kept_step(self) -> int | None: ...  # noqa: D102
    def curve(self) -> list[dict[str, float]]: ...  # noqa: D102
    def snapshot_steps(self) -> list[int]: ...  # noqa: D102
    def snapshot(self, step: int) -> Snapshot: ...  # noqa: D102
    def keep(self, step: int | None) -> None: ...  # noqa: D102
    def mesh_at(self, step: int) -> TriangleMesh: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class Source:
    """Where the open meshes came from.

    Attributes:
        name: what to call the mesh; the stem of exported files.
        mesh: the mesh as it was opened, its holes still open.
        ground_truth: the ground truth as it was opened, if there is one.
        path: the file of the input, or None when only a run's copy of it is known.
        ground_truth_path: the file of the ground truth, if there is one.
        up: the axis that points up, where that is known.
        holes: the boundaries of the mesh.
    """

    name: str
    mesh: TriangleMesh
    ground_truth: TriangleMesh | None = None
    path: Path | None = None
    ground_truth_path: Path | None = None
    up: UpAxis | None = None
    holes: Holes = field(default_factory=Holes)

    @property
    def folder(self) -> Path | None:
        """The folder to save results in, when it is still there."""
        return self.path.parent if self.path is not None and self.path.parent.is_dir() else None


class Workspace:
    """Everything the window shows.

    Signals carry nothing; whoever listens reads the attributes, so that several changes in one turn cost one update.
    """

    problem_changed = Signal()
    run_changed = Signal()
    curve_changed = Signal()
    snapshots_changed = Signal()
    shown_step_changed = Signal()
    kept_step_changed = Signal()
    suggestion_changed = Signal()
    follow_latest_changed = Signal()
    state_changed = Signal()
    progress_changed = Signal()
    wanted_changed = Signal()
    filling_only_changed = Signal()
    hole_measures_changed = Signal()

    def __init__(self) -> None:
        self.source: Source | None = None
        self.problem: Problem | None = None
        self.run: RunLike | None = None
        self.curve = Curve()
        self.snapshot_steps: list[int] = []
        self.shown_step: int | None = None
        self.kept_step: int | None = None
        self.suggestion: Suggestion | None = None
        self.follow_latest = True
        self.look = Look()
        self.comparison = Comparison(self)
        self.colors = Coloring(self)
        self.picking = Picking(self)
        self.bookmarks = Bookmarks()
        self.surface: Surface | None = None
        self.state = RunnerState.IDLE
        self.current_step = 0
        self.seconds = 0.0
        self.device = ""
        self.holes = HoleChoice()
        self.wanted: Settings | None = None
        self.filling_only = False
        self._hole_measures: dict[int | None, Mapping[str, float]] = {}
        self._cache = SnapshotCache()
        self._mads: dict[StateKey, float] = {}

    # -- meshes -----------------------------------------------------------------------------------------------------

    @property
    def mesh(self) -> TriangleMesh | None:
        """The input mesh."""
        return None if self.problem is None else self.problem.mesh

    def open_problem(self, problem: Problem, source: Source) -> None:
        """Take in another mesh; the run of the previous one is let go (it is safe in its folder)."""
        self.comparison.forget_mesh()
        self.picking.pick(None)
        self._set_problem(problem)
        self._set_source(source)
        self._set_run(None)
        self.state = RunnerState.IDLE
        self.problem_changed.emit()
        self._emit_run()

    def replace_problem(self, problem: Problem, source: Source) -> None:
        """Take in the same mesh with another base or ground truth; the run stays."""
        self._set_problem(problem)
        self._set_source(source)
        self.problem_changed.emit()
        self.shown_step_changed.emit()

    def _set_problem(self, problem: Problem) -> None:
        if self.problem is not None and not self.problem.mesh.same_connectivity(problem.mesh):
            self.comparison.forget_mesh()
            self.picking.pick(None)
        self.problem = problem
        self.surface = Surface(problem)
        self.colors.forget()
        self._mads.clear()
        self._hole_measures.clear()

    def _set_source(self, source: Source) -> None:
        if source is not self.source:
            self.set_filling_only(False)
        self.source = source
        self.holes.set_found(source.holes)

    # -- run --------------------------------------------------------------------------------------------------------

    def begin_run(self, run: RunLike, problem: Problem, device: str) -> None:
        """A training has been set up: show its base and wait for its steps, keeping those it had before."""
        same_run = self.run is not None and self.run.run_id == run.run_id
        self._set_problem(problem)
        if same_run:
            self.run = run
        else:
            self._set_run(run)
        self.device = device
        self.set_follow_latest(True)
        self.set_filling_only(False)
        self.problem_changed.emit()
        self._emit_run()

    def open_run(self, run: RunLike, problem: Problem, source: Source, suggestion: Suggestion | None) -> None:
        """Show a run from its folder: its meshes, curve and snapshots, at the step to look at first."""
        self.comparison.forget_mesh()
        self.picking.pick(None)
        self._set_problem(problem)
        self._set_source(source)
        self._set_run(run)
        self.suggestion = suggestion
        self.state = RunnerState.IDLE
        if self.kept_step is not None:
            self.shown_step, self.follow_latest = self.kept_step, False
        self.problem_changed.emit()
        self._emit_run()

    def _set_run(self, run: RunLike | None) -> None:
        self.run = run
        self._cache.clear()
        self.comparison.forget_run()
        self.bookmarks.open(None if run is None else run.folder)
        self.colors.forget()
        self._mads.clear()
        self.curve = Curve(run.curve() if run is not None else ())
        self.snapshot_steps = run.snapshot_steps() if run is not None else []
        self.kept_step = run.kept_step if run is not None else None
        self.suggestion = None
        self.follow_latest = True
        self.shown_step = self.latest_step
        last = self.curve.rows[-1] if len(self.curve) else {}
        self.current_step = max(int(last.get("step", 0)), self.latest_step or 0)
        self.seconds = last.get("seconds", 0.0)
        self.device = ""

    def _emit_run(self) -> None:
        for signal in (
            self.run_changed, self.curve_changed, self.snapshots_changed, self.kept_step_changed, self.suggestion_changed,
            self.follow_latest_changed, self.shown_step_changed, self.progress_changed, self.state_changed,
        ):  # fmt: skip
            signal.emit()

    def refresh_from_run(self) -> None:
        """Read again what the run folder holds; the training adds a last snapshot after its last record."""
        if self.run is None:
            return
        self.curve = Curve(self.run.curve() or self.curve.rows)
        self.snapshot_steps = self.run.snapshot_steps()
        self._update_suggestion()
        self.curve_changed.emit()
        self.snapshots_changed.emit()
        self._show_latest()

    @property
    def came_to_rest(self) -> bool:
        """Whether the run on show ended before its last step, because its inserted vertices moved no more."""
        run = self.run
        if run is None or self.state.is_active or run.state != "finished" or run.settings.task != "complete":
            return False
        return self.current_step < run.settings.steps

    @property
    def continue_until(self) -> int | None:
        """The step until which the run on show can be trained further, or None when it cannot."""
        run = self.run
        if run is None or self.state.is_active or self.came_to_rest:
            return None
        if run.state not in ("stopped", "interrupted", "failed", "finished"):
            return None
        last = run.settings.steps
        # A number of steps that was raised belongs to this run only as long as nothing else was changed.
        if self.wanted is not None and run.settings == replace(self.wanted, **_free_settings(run.settings)):
            last = max(last, self.wanted.steps)
        return last if self.current_step < last else None

    @property
    def controls(self) -> Controls:
        """The controls that can be used now."""
        return controls_for(self.state, has_mesh=self.problem is not None, can_continue=self.continue_until is not None)

    @property
    def total_steps(self) -> int:
        """The last step of the run on show, or 0."""
        return self.run.settings.steps if self.run is not None else 0

    def set_state(self, state: RunnerState) -> None:
        """Take over the state of the training thread."""
        if state is not self.state:
            self.state = state
            self.state_changed.emit()

    def set_wanted(self, settings: Settings) -> None:
        """Take over what the run panel says about the next training."""
        if settings != self.wanted:
            self.wanted = settings
            self.wanted_changed.emit()

    # -- steps ------------------------------------------------------------------------------------------------------

    @property
    def latest_step(self) -> int | None:
        """The newest snapshot's step."""
        return self.snapshot_steps[-1] if self.snapshot_steps else None

    def add_records(self, records: Sequence[StepRecord]) -> None:
        """Take in steps in the order they were made; snapshots come through :meth:`add_snapshot`."""
        if not records:
            return
        self.current_step, self.seconds = records[-1].step, records[-1].seconds
        rows = [{"step": item.step, "seconds": item.seconds, **item.metrics} for item in records if item.metrics]
        if rows:
            self.curve.extend(rows)
            self.curve_changed.emit()
        self.progress_changed.emit()

    def add_snapshot(self, snapshot: Snapshot) -> None:
        """Take in a snapshot of the run on show."""
        self._cache.put(snapshot)
        self.colors.forget(("step", snapshot.step))
        self._mads.pop(("step", snapshot.step), None)
        if snapshot.step not in self.snapshot_steps:
            self.snapshot_steps = sorted([*self.snapshot_steps, snapshot.step])
        self._update_suggestion()
        self.snapshots_changed.emit()
        self._show_latest()

    def _show_latest(self) -> None:
        if self.follow_latest or self.shown_step not in self.snapshot_steps:
            self.shown_step = self.latest_step
            self.shown_step_changed.emit()

    def _update_suggestion(self) -> None:
        suggestion = suggest(self.curve.rows, self.snapshot_steps)
        if suggestion != self.suggestion:
            self.suggestion = suggestion
            self.suggestion_changed.emit()

    def show_step(self, step: int) -> None:
        """Show the snapshot nearest to ``step``: going back in time stops following the latest."""
        nearest = self.nearest_snapshot(step)
        if nearest is None:
            return
        if nearest != self.latest_step:
            self.set_follow_latest(False)
        if nearest != self.shown_step:
            self.shown_step = nearest
            self.shown_step_changed.emit()

    def nearest_snapshot(self, step: float) -> int | None:
        """Return the snapshot step nearest to ``step``."""
        return min(self.snapshot_steps, key=lambda candidate: abs(candidate - step)) if self.snapshot_steps else None

    def set_follow_latest(self, follow: bool) -> None:
        """Follow the training, or stay at the shown step."""
        if follow != self.follow_latest:
            self.follow_latest = follow
            self.follow_latest_changed.emit()
        if follow and self.latest_step is not None and self.shown_step != self.latest_step:
            self.shown_step = self.latest_step
            self.shown_step_changed.emit()

    def keep(self, step: int | None) -> None:
        """Keep a step for good (None forgets it); raises :class:`dmp.errors.RunError` when that cannot be written."""
        if self.run is None:
            return
        self.run.keep(step)
        self.kept_step = step
        self.kept_step_changed.emit()

    @property
    def best_step(self) -> int | None:
        """The snapshot that is closest to the ground truth, when there is one."""
        return self.curve.best(self.quality, [step for step in self.snapshot_steps if step > 0])

    @property
    def quality(self) -> str:
        """The measure that the best step has the lowest value of: MAD, or for a completion the distance in the holes."""
        return "hole_distance" if self.problem is not None and self.problem.task == "complete" else "mad"

    def snapshot(self, step: int) -> Snapshot | None:
        """Return a snapshot, from memory or from the run folder (raises :class:`dmp.errors.RunError` when it is damaged)."""
        found = self._cache.get(step)
        if found is None and self.run is not None and step in self.snapshot_steps:
            found = self.run.snapshot(step)
            self._cache.put(found)
        return found

    def snapshot_in_memory(self, step: int) -> Snapshot | None:
        """Return a snapshot when it need not be read."""
        return self._cache.get(step)

    # -- what the panes show ------------------------------------------------------------------------------------------

    def input_state(self) -> MeshState | None:
        """Return what the input pane shows."""
        return None if self.problem is None else MeshState("input", 0, self.problem.target)

    def predicted_state(self) -> MeshState | None:
        """Return what the predicted pane shows, None for nothing (raises :class:`dmp.errors.RunError`)."""
        if self.problem is not None and self.is_completion and self.filling_only:
            return self.input_state()
        return self._step_state()

    def judged_states(self) -> list[MeshState]:
        """Return what the range of the colours is made for: the input, the shown step, and a result in the middle pane.

        A flip to hole filling alone changes nothing in it, so that the colours can be compared. What cannot be read is left
        out; that is told where it is drawn.
        """
        found = [self.input_state()]
        for state in (self.comparison.state, self._step_state):
            try:
                found.append(state())
            except DmpError:
                continue
        # The smoothed mesh and the truth are no results; what is far off on them must not fade what is judged.
        return [state for state in found if state is not None and state.kind not in ("smoothed", "truth")]

    def _step_state(self) -> MeshState | None:
        snapshot = self.snapshot(self.shown_step) if self.shown_step is not None else None
        return None if snapshot is None else MeshState("step", snapshot.step, snapshot.vertices)

    # -- holes ------------------------------------------------------------------------------------------------------

    @property
    def is_completion(self) -> bool:
        """Whether the mesh on show had holes that were filled."""
        return self.problem is not None and self.problem.task == "complete"

    def set_filling_only(self, filling_only: bool) -> None:
        """Show hole filling alone in place of the prediction, or not."""
        if filling_only != self.filling_only:
            self.filling_only = filling_only
            self.filling_only_changed.emit()

    def hole_measures(self, step: int | None) -> Mapping[str, float]:
        """Return what was measured in the holes at a step, or of hole filling alone (None); empty while unknown."""
        if step in self._hole_measures:
            return self._hole_measures[step]
        snapshot = self._cache.get(step) if step is not None else None
        return snapshot.metrics if snapshot is not None and "hole_distance" in snapshot.metrics else {}

    def set_hole_measures(self, problem: Problem, step: int | None, measures: Mapping[str, float]) -> None:
        """Take in what was measured on ``problem``; too late when another one is open by now."""
        if problem is self.problem:
            self._hole_measures[step] = measures
            self.hole_measures_changed.emit()

    # -- ground truth -----------------------------------------------------------------------------------------------

    def mad_of(self, state: MeshState) -> float | None:
        """Return the mean angular difference of a state to the ground truth in degrees, when there is one.

        What was logged during the training is taken where it is there; the rest is measured once.
        """
        truth = self.problem.ground_truth if self.problem is not None else None
        if not isinstance(truth, GroundTruth):
            return None
        if state.key not in self._mads:
            snapshot = self._cache.get(state.number) if state.kind == "step" else None
            logged = snapshot.metrics.get("mad") if snapshot is not None else None
            self._mads[state.key] = truth.mad(state.positions) if logged is None else logged
        return self._mads[state.key]


def _free_settings(settings: Settings) -> dict[str, Any]:
    """Return the settings that may differ when a run is continued, with their values in the run."""
    return {name: getattr(settings, name) for name in ("steps", "snapshot_every", "log_every", "device", "threads")}
