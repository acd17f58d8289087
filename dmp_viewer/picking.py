"""One vertex that is looked at closely: its values in all panes, and how they changed over the steps. No widgets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from psygnal import Signal

from dmp_viewer.ruler import MeshState

if TYPE_CHECKING:
    from dmp_viewer.model import Workspace


class Picking:
    """The picked vertex.

    Signals:
        changed: another vertex, or none.
        history_changed: more or other steps are known.

    Attributes:
        vertex: its index, or None.
        history: its value by step, in file units or degrees.
    """

    changed = Signal()
    history_changed = Signal()

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self.vertex: int | None = None
        self.history: dict[int, float] = {}

    def pick(self, vertex: int | None) -> None:
        """Look at another vertex, or at none; one that the mesh does not have counts as none."""
        mesh = self._workspace.mesh
        if vertex is not None and (mesh is None or not 0 <= vertex < mesh.n_vertices):
            vertex = None
        if vertex != self.vertex:
            self.vertex = vertex
            self.history = {}
            self.changed.emit()

    def value_in(self, state: MeshState) -> float | None:
        """Return the coloured value of the picked vertex in a state; None where it has none."""
        if self.vertex is None:
            return None
        colors = self._workspace.colors
        values = colors.values(state)
        if values is not None:
            return float(values[self.vertex])
        ruler = colors.counting_ruler()
        if ruler.is_zero_for(state, self._workspace.comparison.reference_step):
            return 0.0
        return float(ruler.values(state.positions)[self.vertex])

    def forget_history(self) -> None:
        """Measure all steps anew."""
        self.history = {}
        self.history_changed.emit()

    def missing_steps(self) -> list[int]:
        """Return the steps that the history still lacks."""
        return [step for step in self._workspace.snapshot_steps if step not in self.history] if self.vertex is not None else []

    def set_value(self, vertex: int, step: int, value: float) -> None:
        """Take in the value of a vertex at a step that was measured elsewhere."""
        if vertex == self.vertex:
            self.history[step] = value
            self.history_changed.emit()
