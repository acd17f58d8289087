"""Draws what belongs to holes: their list, their rims in the input pane, the seam in the predicted one, and its title."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dmp.problem import Problem
from dmp_viewer.holes import Seam
from dmp_viewer.model import Workspace
from dmp_viewer.views.hole_list import HoleRow
from dmp_viewer.views.main_window import MainWindow

_NO_HOLES = "This mesh has no holes, so there is nothing to fill."


class HolePresenter:
    """The part of the presenter that knows about holes; changes nothing in the workspace."""

    def __init__(self, window: MainWindow, workspace: Workspace) -> None:
        self._window = window
        self._workspace = workspace

    @property
    def is_wanted(self) -> bool:
        """Whether holes are the subject: the panel says so, or what is shown was completed."""
        workspace = self._workspace
        return workspace.is_completion or (workspace.wanted is not None and workspace.wanted.task == "complete")

    def draw_list(self) -> None:
        """List the holes with their states."""
        workspace, holes = self._workspace, self._workspace.holes
        problem = workspace.problem
        if problem is None:
            self._window.panel.hole_section.holes.set_rows([], "")
            return
        in_edges = workspace.colors.policy.unit == "edges"
        factor, unit = (1.0 / problem.edge_length, "edge lengths") if in_edges else (1.0, "file units")
        rows = []
        for index, loop in enumerate(holes.found.loops):
            state = holes.state(index)
            size, perimeter = f"{loop.size * factor:.3g}", f"{loop.perimeter * factor:.3g}"
            details = (
                f"Hole {index + 1:,}: {loop.n_edges:,} edges, perimeter {perimeter}, size {size} {unit}. {state.reason}".strip()
            )
            rows.append(HoleRow(loop.n_edges, size, state.is_filled, state.can_be_filled, state.text, details))
        self._window.panel.hole_section.holes.set_rows(rows, self._summary(len(rows), unit))

    def _summary(self, count: int, unit: str) -> str:
        if not count:
            return _NO_HOLES
        filled = len(self._workspace.holes.filled)
        what = f"{filled:,} of {count:,} {'is' if filled == 1 else 'are'} filled" if filled else "No hole is chosen"
        return f"{what}. Sizes in {unit}."

    def draw_rims(self) -> None:
        """Outline the holes in the input pane."""
        workspace, holes = self._workspace, self._workspace.holes
        if workspace.problem is None or workspace.source is None:
            return
        loops = holes.found.loops if self.is_wanted else ()
        filled = holes.filled
        chosen = [loop.edges for index, loop in enumerate(loops) if index in filled]
        others = [loop.edges for index, loop in enumerate(loops) if index not in filled]
        pointed = [loops[holes.pointed].edges] if holes.pointed is not None and holes.pointed < len(loops) else []
        self._window.panes.set_holes(workspace.problem.target, chosen, others, pointed)

    def draw_seam(self, problem: Problem) -> None:
        """Outline what was inserted in the predicted pane."""
        source = self._workspace.source
        if problem.task == "complete" and source is not None:
            self._window.panes.set_seam(Seam.between(source.mesh, problem.mesh).edges)
        else:
            self._window.panes.set_seam(np.zeros((0, 2), dtype=np.int64))

    def facts(self) -> list[str]:
        """Return what the title of the predicted pane says about the holes: the shown mesh, then the other one."""
        workspace = self._workspace
        if not workspace.is_completion:
            return []
        filling = workspace.hole_measures(None)
        completion = workspace.hole_measures(workspace.shown_step) if workspace.shown_step is not None else {}
        if not filling and not completion and workspace.problem is not None:
            count = int((~workspace.problem.known).sum())
            return [f"{count:,} vertices inserted"]
        if workspace.filling_only:
            return _errors(filling, "completion", completion)
        return _errors(completion, "filling alone", filling)


def _errors(measures: Mapping[str, float], name: str, others: Mapping[str, float]) -> list[str]:
    """Return how far from the truth the shown filling is, with the other one to compare it with; nothing without a truth."""
    facts = []
    for key, fact, other in (
        ("hole_distance", "{:.3f} edges off", f"{name} {{:.3f}}"),
        ("hole_normal_error", "{:.1f}°", "{:.1f}°"),
    ):
        if key in measures:
            compared = f" ({other.format(others[key])})" if key in others else ""
            facts.append(fact.format(measures[key]) + compared)
    return facts
