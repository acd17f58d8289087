"""What is measured of a mesh, vertex by vertex, to be shown as colours.

A ruler never changes, so that several threads can use the same one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dmp.mesh import FloatArray
from dmp.metrics import GroundTruth
from dmp.problem import Problem
from dmp.quantities import Quantity, Values
from dmp.surface_distance import NearestSurface
from dmp.vertex_fans import VertexFans
from dmp.vertex_measures import distances, normal_angles, signed_distances

StateKind = Literal["input", "smoothed", "truth", "step", "run", "filter"]
StateKey = tuple[StateKind, int]


@dataclass(frozen=True, eq=False)
class MeshState:
    """The open mesh with its vertices in certain places.

    Attributes:
        kind: where they come from: the ``input``, the ``smoothed`` mesh, the ground ``truth``, a ``step`` of the run on show,
            a step of a compared ``run``, or a ``filter``.
        number: the step; of filters, which one.
        positions: (V, 3), file units.
    """

    kind: StateKind
    number: int
    positions: FloatArray

    @property
    def key(self) -> StateKey:
        """Names the state; equal keys mean equal positions as long as the same problem and runs are open."""
        return self.kind, self.number


class Surface:
    """What stays the same for all states of the open mesh; worked out when it is first asked for.

    Args:
        problem: what is open.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    @cached_property
    def fans(self) -> VertexFans:
        """The faces around each vertex."""
        return VertexFans(self.problem.mesh.faces, self.problem.mesh.n_vertices)

    @cached_property
    def base_normals(self) -> FloatArray:
        """Unit normals of the smoothed mesh, (V, 3)."""
        return self.fans.normals(self.problem.base)

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the bounding box of the input, file units."""
        return float(np.linalg.norm(np.ptp(self.problem.mesh.vertices, axis=0)))

    @cached_property
    def true_surface(self) -> NearestSurface:
        """The ground truth to measure distances to; there must be one."""
        assert self.problem.ground_truth is not None
        return NearestSurface(self.problem.ground_truth.mesh)

    @property
    def true_positions(self) -> FloatArray | None:
        """The places of the vertices on the ground truth, (V, 3), where each is known."""
        truth = self.problem.ground_truth
        return truth.mesh.vertices if isinstance(truth, GroundTruth) else None


@dataclass(frozen=True, eq=False)
class Ruler:
    """Gives the coloured value of each vertex.

    Attributes:
        quantity: what is measured; it must be possible, see :func:`can_measure`.
        surface: of the open mesh.
        reference: (V, 3), what distances are measured from when the quantity is ``step``.
    """

    quantity: Quantity
    surface: Surface
    reference: FloatArray | None = None

    def values(self, positions: FloatArray) -> Values:
        """Return the value of each vertex (V, 3): (V,) float32 in file units or degrees; NaN where there is none.

        Not for ``normals`` and ``plain``, which have no values.
        """
        problem, surface = self.surface.problem, self.surface
        match self.quantity:
            case "signed":
                found = signed_distances(positions, problem.base, surface.base_normals)
            case "input_distance":
                found = distances(positions, problem.target)
            case "error":
                found = self._errors(positions)
            case "normal_error":
                assert isinstance(problem.ground_truth, GroundTruth)
                found = normal_angles(positions, problem.ground_truth.normals, surface.fans)
            case "step":
                assert self.reference is not None
                found = distances(positions, self.reference)
            case "curvature":
                found = surface.fans.mean_curvature(positions)
            case _:
                found = distances(positions, problem.base)
        return found.astype(np.float32)

    def _errors(self, positions: FloatArray) -> FloatArray:
        truth, known = self.surface.problem.ground_truth, self.surface.problem.known
        assert truth is not None
        if self.surface.true_positions is not None:
            return distances(positions, self.surface.true_positions)
        # Known vertices of a completion are the scan; only what was inserted can be right or wrong.
        errors = np.full(len(positions), np.nan)
        errors[~known] = self.surface.true_surface.query(positions[~known])[0]
        return errors

    def is_zero_for(self, state: MeshState, reference_step: int | None) -> bool:
        """Tell whether a state is what distances are measured from, so that its values would all be 0."""
        match self.quantity:
            case "magnitude" | "signed":
                return state.kind == "smoothed"
            case "input_distance":
                return state.kind == "input"
            case "error" | "normal_error":
                return state.kind == "truth"
            case "step":
                return state.key == ("step", reference_step)
        return False


def can_measure(quantity: Quantity, problem: Problem, reference: FloatArray | None) -> bool:
    """Tell whether a quantity can be shown for what is open."""
    if quantity == "error":
        return problem.ground_truth is not None
    if quantity == "normal_error":
        return isinstance(problem.ground_truth, GroundTruth)
    return quantity != "step" or reference is not None


def direction_colors(normals: FloatArray) -> NDArray[np.uint8]:
    """Return unit normals (V, 3) as colours, (V, 3) uint8: x red, y green, z blue, each dark for -1 and bright for 1."""
    return np.asarray(np.clip((normals + 1.0) * 127.5, 0, 255), dtype=np.uint8)
