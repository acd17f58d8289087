"""Filters that MeshLab applies, in its own process (see :mod:`dmp.meshlab`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dmp import meshlab
from dmp.mesh import FloatArray, TriangleMesh


def hc_laplacian(mesh: TriangleMesh, counts: Sequence[int]) -> Iterator[FloatArray]:
    """Yield the vertices (V, 3) after each number of steps in ``counts`` (ascending) of MeshLab's HC Laplacian.

    Each step averages and then pushes back towards where the vertices were (Vollmer, Mencl and Müller 1999, "Improved
    Laplacian Smoothing of Noisy Surface Meshes").

    Raises:
        MeshError: as for :func:`dmp.meshlab.run_filters`.
    """
    positions, done = mesh.vertices, 0
    for count in counts:
        if count > done:
            steps: list[meshlab.Filter] = [("apply_coord_hc_laplacian_smoothing", {})] * (count - done)
            positions = meshlab.run_filters(mesh.with_vertices(positions), steps)[0]
        done = count
        yield positions


def two_step(
    mesh: TriangleMesh, counts: Sequence[int], *, threshold: float, normal_steps: int, vertex_steps: int
) -> Iterator[FloatArray]:
    """Yield the vertices (V, 3) for each number of steps in ``counts`` of MeshLab's two-step smoothing.

    In a step normals are averaged with those neighbours that differ by less than ``threshold`` degrees, ``normal_steps``
    times, and then the vertices are fitted to them, ``vertex_steps`` times (Belyaev and Ohtake 2003, "A Comparison of Mesh
    Smoothing Methods").

    Raises:
        MeshError: as for :func:`dmp.meshlab.run_filters`.
    """
    for count in counts:
        values = {"stepsmoothnum": count, "normalthr": threshold, "stepnormalnum": normal_steps, "stepfitnum": vertex_steps}
        yield meshlab.run_filters(mesh, [("apply_coord_two_steps_smoothing", values)])[0] if count else mesh.vertices
