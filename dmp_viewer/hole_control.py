"""Answers what the user does with holes: choose which to fill, look at one, and measure what fills them."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from qtpy.QtCore import QTimer

from dmp.boundary import BoundaryLoop
from dmp.errors import DmpError
from dmp.hole_metrics import HoleTruth
from dmp.problem import Problem
from dmp.settings import Settings, settings_for
from dmp_viewer.control_part import ControlPart
from dmp_viewer.holes import outward
from dmp_viewer.views.banner import Message

if TYPE_CHECKING:
    from dmp_viewer.controller import Controller

_LOG = logging.getLogger(__name__)
# Several boxes are often ticked one after the other; the holes are filled anew when the hand rests.
_REST_MS = 350


class HoleControl(ControlPart):
    """The part of the controller that is about holes.

    Args:
        controller: whose window and workspace it works on.
    """

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self._measured: Problem | None = None
        self._measuring: set[int | None] = set()
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(_REST_MS)
        self._timer.timeout.connect(controller.opener.change_task)
        workspace, listed = self._workspace, controller.window.panel.hole_section.holes
        listed.switched.connect(self._on_list_switched)
        listed.allRequested.connect(lambda: self._choose(workspace.holes.found.usual_choice))
        listed.noneRequested.connect(lambda: self._choose(frozenset()))
        listed.pointed.connect(self.look_at)
        controller.window.panel.settingsChanged.connect(self._on_panel_settings_changed)
        workspace.problem_changed.connect(self._measure)
        workspace.shown_step_changed.connect(self._measure)

    def loops_to_fill(self) -> tuple[BoundaryLoop, ...] | None:
        """Return the holes that the next training fills, or None for the usual choice."""
        return self._workspace.holes.loops_to_fill()

    def look_at(self, index: int) -> None:
        """Turn the view to a hole and mark it."""
        workspace = self._workspace
        if workspace.source is None or index >= len(workspace.holes.found.loops):
            return
        loop = workspace.holes.found.loops[index]
        direction = outward(workspace.source.mesh.vertices, loop, is_rim=index in workspace.holes.found.rims)
        workspace.holes.point_at(index)
        self._controller.window.panes.look_at(loop.center, direction, loop.size)

    def offer_filling(self) -> None:
        """Say quietly that the open mesh has holes, when something else is going to be done with it."""
        workspace = self._workspace
        count = len(workspace.holes.found.usual_choice)
        if count and not workspace.is_completion:
            text = f"{count:,} {'hole' if count == 1 else 'holes'} found: fill {'it' if count == 1 else 'them'}?"
            self._controller.say(Message("info", text, action=("Fill holes", self.choose_filling)))

    def choose_filling(self) -> None:
        """Switch to filling holes."""
        panel = self._controller.window.panel
        try:
            before = panel.settings()
        except DmpError:  # a number that is being typed is given up with its task
            before = Settings()
        panel.set_settings(settings_for("complete", seed=before.seed, device=before.device))
        self._controller.opener.change_task()

    def _on_list_switched(self, index: int, filled: bool) -> None:
        holes = self._workspace.holes
        self._choose(holes.chosen | {index} if filled else holes.chosen - {index})

    def _choose(self, indices: frozenset[int]) -> None:
        self._workspace.holes.choose(indices)
        self._timer.start()

    def _on_panel_settings_changed(self, settings: Settings) -> None:
        if self._workspace.holes.set_limit(settings.max_hole_edges) and settings.task == "complete":
            self._timer.start()

    def _measure(self) -> None:
        """Measure hole filling alone and the shown step by the ground truth, unless that is known."""
        workspace = self._workspace
        problem = workspace.problem
        if problem is None or not isinstance(problem.ground_truth, HoleTruth):
            return
        if problem is not self._measured:
            self._measured = problem
            self._measuring.clear()
        truth = problem.ground_truth
        for step in {None, workspace.shown_step}:
            if workspace.hole_measures(step) or step in self._measuring:
                continue
            try:
                snapshot = workspace.snapshot(step) if step is not None else None
            except DmpError:  # told where it is drawn
                continue
            if step is not None and (snapshot is None or workspace.hole_measures(step)):
                continue
            positions = problem.target if snapshot is None else snapshot.vertices
            self._measuring.add(step)
            self._controller.background.submit(
                "",
                lambda positions=positions: truth.measures(positions),  # type: ignore[misc]
                lambda measures, step=step: workspace.set_hole_measures(problem, step, measures),  # type: ignore[misc]
                lambda error: _LOG.warning("The holes cannot be measured: %s", error),
            )
