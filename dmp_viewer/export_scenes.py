"""What the window shows, as descriptions that can be drawn at any size by another process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dmp.exports.layout import Layout
from dmp.exports.of_runs import open_faces, seam_edges
from dmp.exports.scenes import Cut, Frame, Paper, Scale, Sheet, Shown
from dmp.exports.viewpoints import UP, Place, Viewpoint
from dmp.mesh import FloatArray, IntArray
from dmp.ruler import MeshState, Ruler, direction_colors
from dmp.vertex_measures import extent
from dmp_viewer.colors import Limits, Quantity, color_table, limits_for
from dmp_viewer.model import Workspace
from dmp_viewer.theme import Theme
from dmp_viewer.views.main_window import MainWindow
from dmp_viewer.views.mesh_panes import INPUT, MIDDLE, PREDICTED

PaneChoice = Literal["all", "input", "middle", "predicted", "outer"]
PANES_OF: dict[PaneChoice, tuple[int, ...]] = {
    "all": (INPUT, MIDDLE, PREDICTED), "input": (INPUT,), "middle": (MIDDLE,), "predicted": (PREDICTED,),
    "outer": (INPUT, PREDICTED),
}  # fmt: skip
_MEASURED_STEPS = 12


@dataclass(frozen=True)
class PictureWish:
    """How a picture of the panes is to be.

    Attributes:
        panes: which.
        width, height: pixels of the whole picture.
        is_transparent: whether the ground can be seen through.
        has_titles, has_scale: whether names and colours are written.
        has_white_ground: white paper instead of the colours of the theme.
    """

    panes: PaneChoice = "all"
    width: int = 3840
    height: int = 1600
    is_transparent: bool = False
    has_titles: bool = True
    has_scale: bool = True
    has_white_ground: bool = False


def paper_of(theme: Theme, *, white: bool = False) -> Paper:
    """Return the colours of pictures in a theme, or on white paper."""
    if white:
        return Paper(bottom="#ffffff")
    return Paper(
        theme.view_top, theme.view_bottom, theme.text, theme.subtle, theme.line, theme.mesh, theme.mesh_edges, theme.hole,
        theme.halo,
    )  # fmt: skip


class Scenery:
    """The panes of the window as they are at this moment. Made in the window's thread, used in any.

    Args:
        window: whose cameras and titles count.
        workspace: what is shown.
        wish: size, panes and what is written.
    """

    def __init__(self, window: MainWindow, workspace: Workspace, wish: PictureWish) -> None:
        problem, surface = workspace.problem, workspace.surface
        assert problem is not None
        assert surface is not None
        self._problem, self._surface, self._wish = problem, surface, wish
        self._place = Place.of(problem.target)
        self._indices = PANES_OF[wish.panes]
        panes, colors = window.panes, workspace.colors
        self._seen_aspect = panes.pane_aspect
        self._viewpoints = panes.viewpoints()
        self._up = UP[workspace.look.policy.up]
        self._is_smooth = workspace.look.policy.shading == "smooth"
        self._titles = [title.texts for title in panes.titles]
        self._quantity: Quantity = colors.quantity
        self._has_values = colors.has_values
        self._limits, self._percentile = colors.limits(), colors.policy.percentile
        self._is_locked = colors.policy.range == "locked"
        self._factor, self._unit = colors.unit
        self._label = colors.spec.label
        self._ruler = colors.ruler() if colors.has_values else None
        self._reference = workspace.comparison.reference_step
        self._seam = seam_edges(problem)
        self._states: list[MeshState | None] = [
            workspace.input_state(), workspace.comparison.state(), workspace.predicted_state()
        ]  # fmt: skip
        if workspace.comparison.flipped:
            self._states[PREDICTED] = workspace.comparison.compared_state()
        self._cut = self._cut_of(window, workspace)
        source = workspace.source
        input_faces = source.mesh.faces if source is not None and problem.task == "complete" else open_faces(problem)
        faces: tuple[IntArray, ...] = (input_faces, problem.mesh.faces)
        self.sheet = Sheet(
            wish.width, wish.height, faces, None, paper_of(window.theme, white=wish.has_white_ground), wish.is_transparent,
            wish.has_titles, wish.has_scale, workspace.look.policy.edges,
        )  # fmt: skip
        self.sheet = replace(self.sheet, scale=self._scale(self._limits))

    def picture(self) -> tuple[Sheet, Frame]:
        """Return what the window shows."""
        cut = None
        if self._cut is not None and self._indices[-1] == PREDICTED:
            state, mode, (x, y, radius) = self._cut
            # The middle of the pane stays its middle, whatever its aspect.
            shrunk = max(1.0, self._seen_aspect / self._aspect)
            x = 0.5 + (x - 0.5) * self._seen_aspect / (self._aspect * shrunk)
            shown = self._shown(PREDICTED, state, self._viewpoint(PREDICTED))
            cut = Cut(shown, mode, x, 0.5 + (y - 0.5) / shrunk, radius / shrunk)
        panes = tuple(self._shown(index, self._states[index], self._viewpoint(index)) for index in self._indices)
        return self.sheet, Frame(panes, cut)

    def animation(
        self,
        steps: Sequence[int],
        read: Callable[[int], FloatArray],
        titles: Callable[[int], str],
        *,
        turn: float,
        has_prediction: bool = True,
    ) -> tuple[Sheet, Iterator[Frame]]:
        """Return frames of the prediction at some steps, the other panes as they are.

        Args:
            steps: in the order of the frames.
            read: returns the positions of a step, (V, 3); called in the thread that draws.
            titles: name of the predicted pane at a step.
            turn: by how much the meshes turn in all, degrees.
            has_prediction: whether there are steps at all; otherwise only the other panes show something.
        """
        points = self._place.seen(self._problem.target)
        start = {
            index: self._viewpoints[index].fitted_all_around(points, self._aspect, self._up) if turn else self._viewpoint(index)
            for index in self._indices
        }
        limits = self._limits_of(steps, read) if has_prediction else self._limits
        sheet = replace(self.sheet, scale=self._scale(limits))

        def frames() -> Iterator[Frame]:
            still = {index: self._shown(index, self._states[index], start[index]) for index in self._indices}
            known: tuple[int, FloatArray] | None = None
            for number, step in enumerate(steps):
                if has_prediction and (known is None or known[0] != step):
                    known = step, read(step)
                shown = []
                for index in self._indices:
                    view = start[index].turned(turn * number / len(steps), self._up) if turn else start[index]
                    if index == PREDICTED and known is not None:
                        made = self._shown(index, MeshState("step", step, known[1]), view)
                        shown.append(replace(made, title=titles(step), facts=self._mad(known[1])))
                    elif turn:
                        shown.append(replace(still[index], viewpoint=view))
                    else:
                        shown.append(still[index])
                yield Frame(tuple(shown))

        return sheet, frames()

    # -- parts --------------------------------------------------------------------------------------------------------

    @property
    def _aspect(self) -> float:
        return Layout(self.sheet, len(self._indices)).pane_aspect

    def _viewpoint(self, index: int) -> Viewpoint:
        return self._viewpoints[index].for_picture(self._seen_aspect, self._aspect)

    def _scale(self, limits: Limits) -> Scale | None:
        if not self._has_values:
            return None
        return Scale(self._label, self._unit, color_table(self._quantity), limits.low, limits.high, self._factor)

    def _limits_of(self, steps: Sequence[int], read: Callable[[int], FloatArray]) -> Limits:
        """Return one range for all steps; a locked one stays."""
        ruler = self._ruler
        if ruler is None or self._is_locked:
            return self._limits
        judged = sorted(set(steps) - {0}) or [steps[0]]
        chosen = np.unique(np.linspace(0, len(judged) - 1, _MEASURED_STEPS).round().astype(int))
        sizes = [extent(ruler.values(read(judged[place])), self._percentile) for place in chosen]
        sizes.append(extent(ruler.values(self._problem.target)[self._problem.known], self._percentile))
        return limits_for(self._quantity, sizes)

    def _shown(self, index: int, state: MeshState | None, viewpoint: Viewpoint) -> Shown:
        title, facts = self._titles[index]
        if state is None:
            return Shown(np.zeros((0, 3), dtype=np.float32), 0, viewpoint, title, facts)
        positions = state.positions
        is_directions = self._quantity == "normals"
        normals = self._surface.fans.normals(positions) if self._is_smooth or is_directions else None
        rims = None
        if len(self._seam) and state.kind in ("input", "step", "run") and index != MIDDLE:
            rims = self._place.seen(positions[self._seam])
        return Shown(
            self._place.seen(positions), 0 if state.kind == "input" and index == INPUT else 1, viewpoint, title, facts,
            self._values(state), direction_colors(normals) if normals is not None and is_directions else None,
            np.asarray(normals, dtype=np.float32) if normals is not None and self._is_smooth else None, rims,
        )  # fmt: skip

    def _values(self, state: MeshState) -> np.ndarray | None:
        ruler: Ruler | None = self._ruler
        if ruler is None or ruler.is_zero_for(state, self._reference):
            return None
        return ruler.values(state.positions)

    def _mad(self, positions: FloatArray) -> str:
        from dmp.metrics import GroundTruth

        truth = self._problem.ground_truth
        return f"MAD {truth.mad(positions):.2f}°" if isinstance(truth, GroundTruth) else ""

    def _cut_of(self, window: MainWindow, workspace: Workspace) -> tuple[MeshState, str, tuple[float, float, float]] | None:
        comparison = workspace.comparison
        state = comparison.compared_state()
        if comparison.mode == "off" or comparison.flipped or state is None or self._states[PREDICTED] is None:
            return None
        return state, comparison.mode, window.panes.cut_share()
