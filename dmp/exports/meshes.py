"""The mesh of a step with everything that is known of its vertices, for other programs to look at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dmp.exports.color_tables import color_table
from dmp.mesh import FloatArray, TriangleMesh
from dmp.problem import Problem
from dmp.quantities import QUANTITIES, Quantity, limits_for
from dmp.ruler import Ruler, Surface, can_measure, direction_colors
from dmp.runs import Run
from dmp.vertex_measures import distances, extent


def annotated_mesh(run: Run, step: int, color_by: Quantity | None = None) -> TriangleMesh:
    """Return the predicted mesh at a step of a run with what is known of each vertex, see :func:`annotated`.

    Raises:
        RunError: when the snapshot is missing or damaged.
    """
    return annotated(run.mesh_at(step), run.problem(), color_by)


def annotated(mesh: TriangleMesh, problem: Problem, color_by: Quantity | None = None) -> TriangleMesh:
    """Return a predicted mesh with what is known of each vertex.

    Args:
        mesh: as :meth:`dmp.runs.Run.mesh_at` gives it.
        problem: what was trained on.
        color_by: what to show as vertex colours, which also OBJ can hold; None adds none.

    Returns:
        The mesh with its attributes and, all in file units: ``displacement`` (V, 3) from the smoothed mesh and
        ``displacement_length`` (V,); with a ground truth ``error`` (V,), the distance to it; for a completion ``inserted``
        (V,) uint8, 1 for the vertices that hole filling made. Where a vertex has no error, because it is a known one of a
        completion, that is 0.
    """
    mesh = mesh.with_attributes(
        displacement=mesh.vertices - problem.base, displacement_length=distances(mesh.vertices, problem.base)
    )
    surface = Surface(problem)
    if problem.ground_truth is not None:
        error = Ruler("error", surface).values(mesh.vertices)
        mesh = mesh.with_attributes(error=np.nan_to_num(error, nan=0.0).astype(np.float64))
    if color_by is not None and color_by != "plain":
        mesh = mesh.with_attributes(color=vertex_colors(problem, surface, mesh.vertices, color_by))
    return mesh


def vertex_colors(problem: Problem, surface: Surface, positions: FloatArray, quantity: Quantity) -> NDArray[np.uint8]:
    """Return a quantity of positions, (V, 3), as colours, (V, 3) uint8, over the range that it has there.

    Where there is no value the colour is a light grey.
    """
    if quantity == "normals":
        return direction_colors(surface.fans.normals(positions))
    values = Ruler(quantity, surface).values(positions)
    limits = limits_for(quantity, [extent(values)])
    share = np.nan_to_num((values - limits.low) / (limits.high - limits.low), nan=0.0)
    found = color_table(quantity)[np.clip(share * 256, 0, 255).astype(np.int64), :3]
    found[~np.isfinite(values)] = (0xC9, 0xCE, 0xD6)
    return found


def possible_quantities(problem: Problem) -> list[Quantity]:
    """Return what can be shown as colours of a problem, in the order of :data:`dmp.quantities.QUANTITIES`."""
    return [name for name in QUANTITIES if name != "step" and can_measure(name, problem, None)]
