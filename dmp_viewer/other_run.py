"""A second run of the open mesh, laid beside the one on show. No widgets."""

from __future__ import annotations

from typing import Protocol

from dmp.settings import Settings
from dmp.snapshot import Snapshot
from dmp.stopping import suggest
from dmp_viewer.curve import Curve
from dmp_viewer.snapshot_cache import SnapshotCache
from dmp_viewer.step_mark import StepMark

# Looked at beside the run on show, which has the larger share of the memory.
_MOST_BYTES = 64 * 1024**2


class ComparedRun(Protocol):
    """What is needed of a :class:`dmp.runs.Run` to lay it beside another."""

    settings: Settings

    @property
    def run_id(self) -> str: ...  # noqa: D102
    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def kept_step(self) -> int | None: ...  # noqa: D102
    def curve(self) -> list[dict[str, float]]: ...  # noqa: D102
    def snapshot_steps(self) -> list[int]: ...  # noqa: D102
    def snapshot(self, step: int) -> Snapshot: ...  # noqa: D102


class OtherRun:
    """A run with its curve, its snapshots, and which of them is shown.

    Args:
        run: from its folder.

    Attributes:
        name: what to call it.
        settings: how it was trained.
        curve: its logged steps.
        steps: steps of its snapshots, ascending.
        kept_step: the one that a person chose, or None.
        suggested_step: the one that the program proposes, or None.
        shown_step: the one in the pane, or None; at first the kept one, else the suggested one.
    """

    def __init__(self, run: ComparedRun) -> None:
        self._run = run
        self._cache = SnapshotCache(_MOST_BYTES)
        rows = run.curve()
        self.name = run.name
        self.settings = run.settings
        self.curve = Curve(rows)
        self.steps = run.snapshot_steps()
        self.kept_step = run.kept_step if run.kept_step in self.steps else None
        suggestion = suggest(rows, self.steps)
        self.suggested_step = None if suggestion is None else suggestion.step
        self.shown_step = self.kept_step if self.kept_step is not None else self.suggested_step

    @property
    def run_id(self) -> str:
        """Identifies the run."""
        return self._run.run_id

    def marks(self) -> list[StepMark]:
        """Return the steps of the run that matter, each with its reason."""
        found = []
        if self.kept_step is not None:
            found.append(StepMark("kept", self.kept_step, "kept", f"Kept: step {self.kept_step:,} was chosen as the result."))
        if self.suggested_step is not None:
            found.append(StepMark("suggested", self.suggested_step, "suggested", f"Suggested: step {self.suggested_step:,}."))
        best = self.curve.best("mad", [step for step in self.steps if step > 0])
        if best is not None:
            value = self.curve.value_at("mad", best)
            found.append(
                StepMark("best", best, "best MAD", f"By the ground truth: MAD is lowest at step {best:,}, {value:.2f}°.")
            )
        return found

    def show_step(self, step: float) -> bool:
        """Show the snapshot nearest to a step; tells whether that is another one."""
        if not self.steps:
            return False
        nearest = min(self.steps, key=lambda candidate: abs(candidate - step))
        changed = nearest != self.shown_step
        self.shown_step = nearest
        return changed

    def show_beside(self, places: int) -> bool:
        """Show the snapshot so many places further; tells whether that is another one."""
        if self.shown_step is None:
            return False
        index = self.steps.index(self.shown_step) + places
        return self.show_step(self.steps[min(max(index, 0), len(self.steps) - 1)])

    def snapshot(self) -> Snapshot | None:
        """Return the shown snapshot (raises :class:`dmp.errors.RunError` when it is damaged)."""
        if self.shown_step is None:
            return None
        found = self._cache.get(self.shown_step)
        if found is None:
            found = self._run.snapshot(self.shown_step)
            self._cache.put(found)
        return found
