"""Set up the completion of a mesh with holes: fill them, smooth, and mark what was inserted (paper, section 4.2)."""

from __future__ import annotations

from collections.abc import Sequence

from dmp.boundary import BoundaryLoop
from dmp.errors import NoHolesError, SettingsError
from dmp.holes import fill_holes
from dmp.mesh import TriangleMesh
from dmp.problem import Problem, check_trainable, denoising
from dmp.settings import Settings
from dmp.smoothing import smooth


def completion(
    mesh: TriangleMesh,
    settings: Settings,
    ground_truth: TriangleMesh | None = None,
    loops: Sequence[BoundaryLoop] | None = None,
) -> Problem:
    """Set up the completion of ``mesh``: the data term sees the known vertices, the Laplacian term all of them.

    Args:
        mesh: the mesh with holes.
        settings: smoothing, scaling, the size of the largest hole, and what happens to known vertices.
        ground_truth: the complete mesh in the same place, with any connectivity; only for measuring.
        loops: which holes to fill, from :func:`dmp.boundary.boundary_loops`; by default all but the outer rims of open
            surfaces.

    Returns:
        The problem; its notes say what was filled and what was left open.

    Raises:
        NoHolesError: when nothing was filled; the text says why.
        MeshError: when the mesh cannot be trained on.
        SettingsError: when the settings are for another task.
    """
    if settings.task != "complete":
        raise SettingsError("These settings are for denoising. Make them with settings_for('complete').")
    check_trainable(mesh)
    filled = fill_holes(mesh, loops, settings.max_hole_edges or None)
    if not filled.patches:
        why = " ".join(filled.notes)
        raise NoHolesError(
            f"There is no hole to fill. {why}" if why else "The mesh has no holes: there is nothing to complete."
        )
    return Problem.from_base(
        filled.mesh,
        settings,
        base=smooth(filled.mesh, settings.smoothing, settings.smoothing_steps),
        known=~filled.inserted_vertices,
        ground_truth=ground_truth,
        notes=filled.notes,
        n_input_faces=mesh.n_faces,
    )


def problem_for(mesh: TriangleMesh, settings: Settings, ground_truth: TriangleMesh | None = None) -> Problem:
    """Return the problem that ``settings.task`` names; see :func:`dmp.problem.denoising` and :func:`completion`."""
    return completion(mesh, settings, ground_truth) if settings.task == "complete" else denoising(mesh, settings, ground_truth)
