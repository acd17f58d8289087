"""Pictures and animations of a run, as the window shows it: what stands in the panes, its colours and their range."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dmp.errors import DmpError, RunError
from dmp.exports.color_tables import color_table
from dmp.exports.layout import Layout
from dmp.exports.meshes import possible_quantities
from dmp.exports.scenes import SEPARATOR, Frame, Paper, Scale, Sheet, Shown
from dmp.exports.viewpoints import UP, Place, Triple, UpAxis, Viewpoint, front
from dmp.geometry import vertex_normals
from dmp.mesh import FloatArray, IntArray, TriangleMesh
from dmp.metrics import GroundTruth
from dmp.problem import Problem
from dmp.quantities import QUANTITIES, Limits, Quantity, Unit, limits_for, unit_of
from dmp.ruler import Ruler, Surface, direction_colors
from dmp.runs import Run
from dmp.topology import unique_edges
from dmp.vertex_measures import ROBUST_PERCENTILE, extent

PaneName = Literal["input", "smoothed", "filled", "truth", "predicted"]
PANES: dict[PaneName, str] = {
    "input": "Input", "smoothed": "Smoothed", "filled": "Hole filling alone", "truth": "Ground truth", "predicted": "Predicted",
}  # fmt: skip
# The range of an animation is that of so many of its steps; more would only take longer.
_MEASURED_STEPS = 12


@dataclass(frozen=True)
class Wish:
    """How a picture is to look.

    Attributes:
        width, height: pixels.
        panes: from left to right.
        quantity: what the colours show.
        unit: of the numbers beside the colours.
        limits: values of the first and the last colour, in that unit; None takes the range of what is shown.
        outliers: whether that range covers every vertex.
        up: the axis that points up.
        eye: direction from the mesh to the eye; None looks from the front.
        is_smooth, has_edges: how surfaces are drawn.
        paper: colours of the rest.
        is_transparent, has_titles, has_scale: see :class:`dmp.exports.scenes.Sheet`.
    """

    width: int = 2400
    height: int = 1000
    panes: tuple[PaneName, ...] = ("input", "smoothed", "predicted")
    quantity: Quantity = "magnitude"
    unit: Unit = "edges"
    limits: tuple[float, float] | None = None
    outliers: bool = False
    up: UpAxis = "y"
    eye: Triple | None = None
    is_smooth: bool = False
    has_edges: bool = False
    paper: Paper = field(default_factory=Paper)
    is_transparent: bool = False
    has_titles: bool = True
    has_scale: bool = True


class Photographer:
    """Makes sheets and frames of one run.

    Args:
        run: any run.
        wish: how they are to look.

    Raises:
        DmpError: when what is wished cannot be shown of this run.
    """

    def __init__(self, run: Run, wish: Wish) -> None:
        self._run, self._wish = run, wish
        self._problem = run.problem()
        self._surface = Surface(self._problem)
        self._place = Place.of(self._problem.target)
        self._kept: dict[PaneName, Shown] = {}
        self._check()

    def picture(self, step: int) -> tuple[Sheet, Frame]:
        """Return the picture of a step (raises :class:`dmp.errors.RunError` when its snapshot cannot be read)."""
        positions = self._run.snapshot(step).vertices
        sheet = self._sheet([positions])
        viewpoint = self._front().fitted(self._place.seen(self._problem.target), self._aspect(sheet))
        return sheet, self._frame(step, positions, viewpoint)

    def animation(
        self, steps: Sequence[int], *, kind: str, frames_per_second: float, turn: float = 0.0, hold_seconds: float = 0.0
    ) -> tuple[Sheet, Iterator[Frame]]:
        """Return an animation with a frame for each of ``steps``, one or more; the same may be there again and again.

        Args:
            steps: snapshots, in the order of the frames.
            kind: ``gif`` or ``mp4``.
            frames_per_second: how fast.
            turn: by how much the mesh turns from the first frame to the one that would follow the last, degrees.
            hold_seconds: for how long the last frame stays.
        """
        measured = sorted(set(steps) - {0}) or [steps[-1]]
        chosen = [
            measured[index] for index in np.unique(np.linspace(0, len(measured) - 1, _MEASURED_STEPS).round().astype(int))
        ]
        sheet = self._sheet([self._run.snapshot(step).vertices for step in chosen])
        sheet = replace(sheet, kind=kind, frames_per_second=frames_per_second, hold_seconds=hold_seconds)
        seen, axis = self._place.seen(self._problem.target), UP[self._wish.up]
        aspect = self._aspect(sheet)
        start = self._front().fitted_all_around(seen, aspect, axis) if turn else self._front().fitted(seen, aspect)

        def frames() -> Iterator[Frame]:
            shown: tuple[int, FloatArray] | None = None
            for number, step in enumerate(steps):
                if shown is None or shown[0] != step:
                    shown = step, self._run.snapshot(step).vertices
                yield self._frame(step, shown[1], start.turned(turn * number / len(steps), axis) if turn else start)

        return sheet, frames()

    # -- what is shown ------------------------------------------------------------------------------------------------

    def _check(self) -> None:
        wish, problem = self._wish, self._problem
        if wish.quantity not in possible_quantities(problem):
            spec = QUANTITIES[wish.quantity]
            raise DmpError(f"The colours cannot show '{spec.label.lower()}': that needs {spec.needs}, and this run has none.")
        if "truth" in wish.panes and problem.ground_truth is None:
            raise RunError(f"The run in {self._run.folder} has no ground truth to show. Leave it out of --panes.")
        if "filled" in wish.panes and problem.task != "complete":
            raise RunError(f"The run in {self._run.folder} filled no holes, so there is no hole filling to show.")

    def _front(self) -> Viewpoint:
        return front(self._wish.up, self._wish.eye)

    def _aspect(self, sheet: Sheet) -> float:
        return Layout(sheet, len(self._wish.panes)).pane_aspect

    def _sheet(self, states: Sequence[FloatArray]) -> Sheet:
        wish = self._wish
        faces = [self._input_faces, self._problem.mesh.faces]
        if self._problem.ground_truth is not None:
            faces.append(self._problem.ground_truth.mesh.faces)
        return Sheet(
            wish.width, wish.height, tuple(faces), self._scale(states), wish.paper, wish.is_transparent, wish.has_titles,
            wish.has_scale, wish.has_edges,
        )  # fmt: skip

    def _scale(self, states: Sequence[FloatArray]) -> Scale | None:
        wish, problem = self._wish, self._problem
        spec = QUANTITIES[wish.quantity]
        if spec.kind in ("none", "direction"):
            return None
        factor, unit = unit_of(spec.kind, wish.unit, problem.edge_length, self._surface.diagonal)
        if wish.limits is not None:
            limits = Limits(wish.limits[0] / factor, wish.limits[1] / factor)
        else:
            ruler, percentile = Ruler(wish.quantity, self._surface), 100.0 if wish.outliers else ROBUST_PERCENTILE
            sizes = [extent(ruler.values(problem.target)[problem.known], percentile)]
            sizes += [extent(ruler.values(state), percentile) for state in states]
            limits = limits_for(wish.quantity, sizes)
        return Scale(spec.label, unit, color_table(wish.quantity), limits.low, limits.high, factor)

    def _frame(self, step: int, positions: FloatArray, viewpoint: Viewpoint) -> Frame:
        makers: dict[PaneName, Callable[[], Shown]] = {
            "input": lambda: self._shown("input", self._problem.target, 0, viewpoint, self._mad(self._problem.target)),
            "smoothed": lambda: self._shown("smoothed", self._problem.base, 1, viewpoint, self._mad(self._problem.base)),
            "filled": lambda: self._shown("filled", self._problem.target, 1, viewpoint, ""),
            "truth": lambda: self._truth(viewpoint),
        }
        panes = []
        for name in self._wish.panes:
            if name == "predicted":
                shown = self._shown(name, positions, 1, viewpoint, self._facts(step, positions))
                word = "Completion" if self._problem.task == "complete" else "Predicted"
                panes.append(replace(shown, title=f"{word} @ step {step:,}"))
                continue
            known = self._kept.get(name)
            if known is None or known.viewpoint != viewpoint:
                known = self._kept[name] = makers[name]()
            panes.append(known)
        return Frame(tuple(panes))

    def _shown(self, name: PaneName, positions: FloatArray, faces: int, viewpoint: Viewpoint, facts: str) -> Shown:
        wish = self._wish
        # What values are measured from would have none but zeros.
        is_origin = (name == "smoothed" and wish.quantity in ("magnitude", "signed")) or (
            name in ("input", "filled") and wish.quantity == "input_distance"
        )
        spec = QUANTITIES[wish.quantity]
        values = None
        if spec.kind not in ("none", "direction") and not is_origin:
            values = Ruler(wish.quantity, self._surface).values(positions)
        normals = self._surface.fans.normals(positions) if wish.is_smooth or spec.kind == "direction" else None
        return Shown(
            self._place.seen(positions), faces, viewpoint, PANES[name], facts, values,
            direction_colors(normals) if normals is not None and spec.kind == "direction" else None,
            np.asarray(normals, dtype=np.float32) if normals is not None and wish.is_smooth else None,
            self._rims(positions) if name != "smoothed" else None,
        )  # fmt: skip

    def _truth(self, viewpoint: Viewpoint) -> Shown:
        truth = self._problem.ground_truth
        assert truth is not None
        if isinstance(truth, GroundTruth) and QUANTITIES[self._wish.quantity].kind in ("curvature", "direction"):
            return replace(self._shown("truth", truth.mesh.vertices, 1, viewpoint, ""), rims=None)
        normals = vertex_normals(truth.mesh.vertices, truth.mesh.faces).astype(np.float32) if self._wish.is_smooth else None
        return Shown(self._place.seen(truth.mesh.vertices), 2, viewpoint, PANES["truth"], normals=normals)

    def _mad(self, positions: FloatArray) -> str:
        truth = self._problem.ground_truth
        return f"MAD {truth.mad(positions):.2f}°" if isinstance(truth, GroundTruth) else ""

    def _facts(self, step: int, positions: FloatArray) -> str:
        facts = [self._mad(positions)]
        if step == self._run.kept_step:
            facts.append("kept")
        return SEPARATOR.join(fact for fact in facts if fact)

    def _rims(self, positions: FloatArray) -> NDArray[np.float32] | None:
        """Return the edges between what was there and what was inserted, as segments."""
        edges = self._seam
        return self._place.seen(positions[edges]) if len(edges) else None

    @cached_property
    def _seam(self) -> IntArray:
        return seam_edges(self._problem)

    @cached_property
    def _input_faces(self) -> IntArray:
        return open_faces(self._problem)


def open_faces(problem: Problem) -> IntArray:
    """Return the faces of a problem's mesh as it was given, its holes still open, (n, 3)."""
    faces = problem.mesh.faces
    if problem.task != "complete":
        return faces
    # Runs of earlier versions do not say how many faces there were; those that were inserted come last.
    with_inserted = np.flatnonzero(~problem.known[faces].all(axis=1))
    return faces[: problem.n_input_faces or (int(with_inserted[0]) if len(with_inserted) else len(faces))]


def seam_edges(problem: Problem) -> IntArray:
    """Return the edges where what hole filling inserted meets what was there, (n, 2)."""
    before = open_faces(problem)
    if len(before) == len(problem.mesh.faces):
        return np.zeros((0, 2), dtype=np.int64)
    old, new = unique_edges(before), unique_edges(problem.mesh.faces[len(before) :])
    count = problem.mesh.n_vertices
    return old[np.isin(old[:, 0] * count + old[:, 1], new[:, 0] * count + new[:, 1])]


def mesh_picture(mesh: TriangleMesh, name: str, wish: Wish) -> tuple[Sheet, Frame]:
    """Return the picture of one mesh that belongs to no run.

    Args:
        mesh: what to show.
        name: what stands above it.
        wish: its colours can show ``curvature``, ``normals`` or, with anything else, nothing.

    Raises:
        DmpError: when the mesh has no faces.
    """
    from dmp.vertex_fans import VertexFans

    if not mesh.n_faces:
        raise DmpError("The mesh has no faces, so there is nothing to draw.")
    place, quantity = Place.of(mesh.vertices), wish.quantity
    fans = VertexFans(mesh.faces, mesh.n_vertices)
    values, scale = None, None
    if quantity == "curvature":
        from dmp.geometry import mean_edge_length

        values = np.asarray(fans.mean_curvature(mesh.vertices), dtype=np.float32)
        edge_length = mean_edge_length(mesh.vertices, unique_edges(mesh.faces))
        diagonal = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
        factor, unit = unit_of("curvature", wish.unit, edge_length, diagonal)
        limits = limits_for(quantity, [extent(values, 100.0 if wish.outliers else ROBUST_PERCENTILE)])
        if wish.limits is not None:
            limits = Limits(wish.limits[0] / factor, wish.limits[1] / factor)
        scale = Scale(QUANTITIES[quantity].label, unit, color_table(quantity), limits.low, limits.high, factor)
    normals = fans.normals(mesh.vertices) if wish.is_smooth or quantity == "normals" else None
    sheet = Sheet(
        wish.width, wish.height, (mesh.faces,), scale, wish.paper, wish.is_transparent, wish.has_titles, wish.has_scale,
        wish.has_edges,
    )  # fmt: skip
    seen = place.seen(mesh.vertices)
    shown = Shown(
        seen, 0, front(wish.up, wish.eye).fitted(seen, Layout(sheet, 1).pane_aspect), name,
        f"{mesh.n_vertices:,} vertices, {mesh.n_faces:,} faces", values,
        direction_colors(normals) if normals is not None and quantity == "normals" else None,
        np.asarray(normals, dtype=np.float32) if normals is not None and wish.is_smooth else None,
    )  # fmt: skip
    return sheet, Frame((shown,))
