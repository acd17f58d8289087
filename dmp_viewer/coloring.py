"""The colours of the open mesh: what is measured, over which range, and how it is spread. No widgets."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from psygnal import Signal

from dmp.vertex_measures import extent
from dmp_viewer.colors import (
    QUANTITIES,
    ColorPolicy,
    Histogram,
    Limits,
    Quantity,
    QuantitySpec,
    Values,
    histogram,
    limits_for,
    unit_of,
)
from dmp_viewer.ruler import MeshState, Ruler, StateKey, can_measure

if TYPE_CHECKING:
    from dmp_viewer.model import Workspace

# The panes show three states, of which the lens may add a fourth; a few more make flipping back and forth free.
_MOST_VALUES = 6


class Coloring:
    """What the colours of the workspace's meshes mean.

    Signals:
        changed: the policy, or something that gives every colour another meaning.
        extents_changed: the range of the whole run is better known than before.

    Attributes:
        policy: the wishes of the user.
        locked: the ranges that were locked, by quantity.
    """

    changed = Signal()
    extents_changed = Signal()

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self.policy = ColorPolicy()
        self.locked: dict[Quantity, Limits] = {}
        self._ruler: Ruler | None = None
        self._values: OrderedDict[StateKey, Values] = OrderedDict()
        self._extents: dict[StateKey, float] = {}

    # -- what is coloured -------------------------------------------------------------------------------------------

    def set(self, **changes: Any) -> None:
        """Change some of the wishes, named as in :class:`dmp_viewer.colors.ColorPolicy`."""
        policy = replace(self.policy, **changes)
        if policy == self.policy:
            return
        if policy.range == "locked" and self.policy.range != "locked":
            self.locked.clear()
        # The range that is seen now is the one to lock.
        limits = self.limits() if policy.range == "locked" and self._workspace.problem is not None else None
        quantity = self.quantity
        previous, self.policy = self.policy, policy
        if limits is not None and quantity == self.quantity:
            self.locked.setdefault(quantity, limits)
        if (previous.quantity, previous.outliers) != (policy.quantity, policy.outliers):
            self._forget_measured()
        self.changed.emit()

    def lock(self, limits: Limits) -> None:
        """Use these limits, in file units or degrees, for the present quantity until the range is chosen anew."""
        self.locked[self.quantity] = limits
        self.policy = replace(self.policy, range="locked")
        self.changed.emit()

    @property
    def quantity(self) -> Quantity:
        """What is shown: the wanted quantity, or the displacement where that is not possible."""
        wanted = self.policy.quantity
        return wanted if self.can_show(wanted) else "magnitude"

    @property
    def spec(self) -> QuantitySpec:
        """What the shown quantity is."""
        return QUANTITIES[self.quantity]

    @property
    def has_values(self) -> bool:
        """Whether colours stand for numbers."""
        return self.spec.kind not in ("none", "direction")

    def can_show(self, quantity: Quantity) -> bool:
        """Tell whether a quantity can be shown for what is open."""
        problem = self._workspace.problem
        return problem is None or can_measure(quantity, problem, self._workspace.comparison.reference_positions)

    @property
    def unit(self) -> tuple[float, str]:
        """By what values are multiplied for the colour bar, and the name of the unit."""
        problem, surface = self._workspace.problem, self._workspace.surface
        if problem is None or surface is None:
            return 1.0, ""
        return unit_of(self.spec.kind, self.policy.unit, problem.edge_length, surface.diagonal)

    # -- values -----------------------------------------------------------------------------------------------------

    def ruler(self) -> Ruler:
        """Return what measures the present quantity; it may be used in any thread."""
        surface = self._workspace.surface
        assert surface is not None
        quantity = self.quantity
        if self._ruler is None or self._ruler.quantity != quantity or self._ruler.surface is not surface:
            self._forget_measured()
            self._ruler = Ruler(quantity, surface, self._workspace.comparison.reference_positions)
        return self._ruler

    def counting_ruler(self) -> Ruler:
        """Return what gives numbers: the ruler of the present quantity, or of the displacement where colours are no numbers."""
        if self.has_values:
            return self.ruler()
        surface = self._workspace.surface
        assert surface is not None
        return Ruler("magnitude", surface)

    def values(self, state: MeshState) -> Values | None:
        """Return the value of each vertex of a state, (V,), file units or degrees; None where it is to be shown bare."""
        if not self.has_values:
            return None
        ruler = self.ruler()
        if ruler.is_zero_for(state, self._workspace.comparison.reference_step):
            return None
        found = self._values.get(state.key)
        if found is None:
            found = ruler.values(state.positions)
            self._values[state.key] = found
            while len(self._values) > _MOST_VALUES:
                self._values.popitem(last=False)
        else:
            self._values.move_to_end(state.key)
        return found

    def forget(self, *keys: StateKey) -> None:
        """Measure these states anew; all of them without arguments, because what is measured from has changed."""
        for key in keys:
            self._values.pop(key, None)
            self._extents.pop(key, None)
        if not keys:
            self._ruler = None
            self._forget_measured()

    def forget_kind(self, kind: str) -> None:
        """Measure the states of one kind anew."""
        self.forget(*(key for key in {*self._values, *self._extents} if key[0] == kind))

    def _forget_measured(self) -> None:
        self._values.clear()
        self._extents.clear()

    # -- range ------------------------------------------------------------------------------------------------------

    def limits(self) -> Limits:
        """Return the range shared by all panes, in file units or degrees, as the policy wants it."""
        workspace, quantity = self._workspace, self.quantity
        if workspace.problem is None or not self.has_values:
            return limits_for(quantity, [])
        self.ruler()
        if self.policy.range == "locked" and quantity in self.locked:
            return self.locked[quantity]
        sizes = [self._extent_of(state) for state in workspace.judged_states()]
        if self.policy.range == "run":
            # Only the present state is measured here; the others are as they come in from another thread.
            sizes += [size for key, size in self._extents.items() if key[0] == "step" and key[1] > 0]
        limits = limits_for(quantity, sizes)
        if self.policy.range == "locked":
            self.locked[quantity] = limits
        return limits

    def _extent_of(self, state: MeshState) -> float:
        if state.key not in self._extents:
            values = self.values(state)
            if values is None:
                return 0.0
            problem = self._workspace.problem
            if problem is not None and state.kind == "input":
                values = values[problem.known]
            self._extents[state.key] = extent(values, self.policy.percentile)
        return self._extents[state.key]

    def steps_to_measure(self) -> list[int]:
        """Return the steps whose extent the range of the run still lacks."""
        if self.policy.range != "run" or not self.has_values or self._workspace.problem is None:
            return []
        # The untrained network's output is no part of what is judged.
        return [step for step in self._workspace.snapshot_steps if step > 0 and ("step", step) not in self._extents]

    def set_extent(self, ruler: Ruler, percentile: float, step: int, size: float) -> None:
        """Take in the extent of a step that was measured elsewhere; it is dropped when something else is shown by now."""
        if ruler is self._ruler and percentile == self.policy.percentile:
            self._extents["step", step] = size
            self.extents_changed.emit()

    def histogram(self, states: Sequence[MeshState]) -> Histogram | None:
        """Return how the values of the last of some states are spread, beside those of the first; None without values."""
        found = [values for state in states if (values := self.values(state)) is not None]
        if not found:
            return None
        return histogram(found[-1], found[0] if len(found) > 1 else None, self.limits())
