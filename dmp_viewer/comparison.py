"""What the prediction is compared with, and how: beside it, in turns, or in one picture. No widgets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from psygnal import Signal

from dmp.errors import DmpError
from dmp.mesh import FloatArray
from dmp_viewer.other_run import OtherRun
from dmp_viewer.ruler import MeshState

if TYPE_CHECKING:
    from dmp_viewer.model import Workspace

Middle = Literal["smoothed", "truth", "step", "run", "filter"]
Mode = Literal["off", "swipe", "lens"]


@dataclass(frozen=True, eq=False)
class Filtered:
    """What a classical filter made of the input.

    Attributes:
        name: of the filter, for people.
        details: its parameters, for people.
        positions: (V, 3), file units.
        number: tells one result from another.
    """

    name: str
    details: str
    positions: FloatArray
    number: int


class Comparison:
    """The middle pane, and what the predicted pane can be turned into for a moment.

    Signals:
        changed: the middle pane, the reference step, or what the prediction is compared with.
        mode_changed: whether and how both are shown in one pane.

    Attributes:
        middle: what the middle pane is wanted to show.
        reference_step: the step that others are compared with, or None.
        other: a run laid beside the one on show, or None.
        filtered: the result of a filter, or None.
        mode: how the predicted pane shows what it is compared with: ``off``, left of a line (``swipe``), or in a ``lens``.
        flipped: whether the predicted pane shows nothing but what it is compared with.
        against_middle: whether that is what the middle pane shows, instead of the input.
    """

    changed = Signal()
    mode_changed = Signal()

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self.middle: Middle = "smoothed"
        self.reference_step: int | None = None
        self.reference_positions: FloatArray | None = None
        self.other: OtherRun | None = None
        self.filtered: Filtered | None = None
        self.mode: Mode = "off"
        self.flipped = False
        self.against_middle = False
        self._filters = 0

    # -- the middle pane --------------------------------------------------------------------------------------------

    def choices(self) -> list[Middle]:
        """Return what the middle pane can show now."""
        surface = self._workspace.surface
        found: list[Middle] = ["smoothed"]
        if surface is not None and surface.true_positions is not None:
            found.append("truth")
        if self.reference_step is not None:
            found.append("step")
        if self.other is not None:
            found.append("run")
        if self.filtered is not None:
            found.append("filter")
        return found

    @property
    def shown(self) -> Middle:
        """What the middle pane shows: what was wanted, or the smoothed mesh where that is not there."""
        return self.middle if self.middle in self.choices() else "smoothed"

    def show(self, middle: Middle) -> None:
        """Let the middle pane show something else."""
        if middle != self.middle:
            self.middle = middle
            self.changed.emit()

    def show_next(self) -> None:
        """Let the middle pane show the next of what it can."""
        choices = self.choices()
        self.show(choices[(choices.index(self.shown) + 1) % len(choices)])

    def state(self) -> MeshState | None:
        """Return what the middle pane shows; None for nothing (raises :class:`dmp.errors.RunError`)."""
        problem, surface = self._workspace.problem, self._workspace.surface
        if problem is None or surface is None:
            return None
        match self.shown:
            case "truth" if surface.true_positions is not None:
                return MeshState("truth", 0, surface.true_positions)
            case "step" if self.reference_step is not None and self.reference_positions is not None:
                return MeshState("step", self.reference_step, self.reference_positions)
            case "run" if self.other is not None:
                snapshot = self.other.snapshot()
                return None if snapshot is None else MeshState("run", snapshot.step, snapshot.vertices)
            case "filter" if self.filtered is not None:
                return MeshState("filter", self.filtered.number, self.filtered.positions)
        return MeshState("smoothed", 0, problem.base)

    def set_reference(self, step: int | None) -> None:
        """Compare with a step of the run from now on (raises :class:`dmp.errors.RunError`); None forgets it."""
        snapshot = self._workspace.snapshot(step) if step is not None else None
        self.reference_step = None if snapshot is None else step
        self.reference_positions = None if snapshot is None else snapshot.vertices
        self._workspace.colors.forget()
        self.changed.emit()

    def set_filtered(self, name: str, details: str, positions: FloatArray) -> None:
        """Show what a filter made of the input in the middle pane."""
        self._filters += 1
        self.filtered = Filtered(name, details, positions, self._filters)
        self.middle = "filter"
        self.changed.emit()

    def set_other(self, other: OtherRun | None) -> None:
        """Show another run in the middle pane; None lets it go."""
        self.other = other
        self._workspace.colors.forget_kind("run")
        self.middle = "run" if other is not None else "smoothed"
        self.changed.emit()

    def show_other_step(self, step: float) -> None:
        """Show the snapshot of the other run that is nearest to ``step``."""
        if self.other is not None and self.other.show_step(step):
            self.changed.emit()

    def show_other_beside(self, places: int) -> None:
        """Show the snapshot of the other run that is so many places further."""
        if self.other is not None and self.other.show_beside(places):
            self.changed.emit()

    # -- both in one pane -------------------------------------------------------------------------------------------

    def compared_state(self) -> MeshState | None:
        """Return what the prediction is compared with: the input, or what the middle pane shows."""
        problem = self._workspace.problem
        if problem is None:
            return None
        if self.against_middle:
            try:
                return self.state()
            except DmpError:  # told where the middle pane is drawn
                return None
        return MeshState("input", 0, problem.target)

    def set_mode(self, mode: Mode) -> None:
        """Show both in one pane, or the prediction alone."""
        if mode != self.mode:
            self.mode = mode
            self.mode_changed.emit()

    def set_flipped(self, flipped: bool) -> None:
        """Show what the prediction is compared with in its place, or the prediction again."""
        if flipped != self.flipped:
            self.flipped = flipped
            self.mode_changed.emit()

    def set_against_middle(self, against_middle: bool) -> None:
        """Compare with what the middle pane shows, or with the input."""
        if against_middle != self.against_middle:
            self.against_middle = against_middle
            self.mode_changed.emit()

    # -- what is open -----------------------------------------------------------------------------------------------

    def forget_run(self) -> None:
        """Another run is on show: its steps are others."""
        self.reference_step = self.reference_positions = None
        self.flipped = False

    def forget_mesh(self) -> None:
        """Another mesh is open: nothing fits any more."""
        self.forget_run()
        self.other = self.filtered = None
        self.middle = "smoothed"
