"""S(y): the smoothed copy of the input from which the network predicts displacements (paper, section 3)."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dmp.mesh import FloatArray, TriangleMesh
from dmp.settings import Smoothing
from dmp.topology import adjacency


def laplacian_smoothing(mesh: TriangleMesh, steps: int = 30) -> FloatArray:
    """Smooth with uniform weights, all vertices at once.

    Each step moves p_i to (p_i + 2 * sum of its neighbours) / (1 + 2 * |N(i)|). The authors' base meshes were made so
    (30 steps); the factor 2 arises in their tool because it meets each edge from both of its faces. A vertex without
    neighbours stays where it is.

    Args:
        mesh: the input.
        steps: number of steps.

    Returns:
        Smoothed positions, (V, 3) float64.
    """
    neighbours = adjacency(mesh.faces, mesh.n_vertices)
    weights = 1.0 + 2.0 * neighbours.sum(axis=1)
    step = sparse.csr_array(sparse.diags_array(1.0 / weights) @ (sparse.eye_array(mesh.n_vertices) + 2.0 * neighbours))
    # Around the centre, so that a mesh far from the origin loses no digits.
    centre = mesh.vertices.mean(axis=0)
    positions = mesh.vertices - centre
    for _ in range(steps):
        positions = step @ positions
    return np.asarray(positions + centre)


def smooth(mesh: TriangleMesh, kind: Smoothing = "laplacian", steps: int = 30) -> FloatArray:
    """Return the base of the displacements, (V, 3) float64: smoothed as ``kind`` says, or the input itself."""
    return laplacian_smoothing(mesh, steps) if kind == "laplacian" else mesh.vertices
