"""S(y): the smoothed copy of the input from which the network predicts displacements (paper, section 3)."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dmp.mesh import FloatArray, TriangleMesh
from dmp.renumbering import inverse_of, locality_order, renumbered
from dmp.settings import Smoothing
from dmp.spherical import spherical_smoothing
from dmp.topology import adjacency, connected_vertices


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
    step = sparse.csr_array(sparse.eye_array(mesh.n_vertices) + 2.0 * neighbours)
    step.data /= np.repeat(weights, np.diff(step.indptr))
    # Around the centre, so that a mesh far from the origin loses no digits.
    used = connected_vertices(mesh.faces, mesh.n_vertices)
    centre = mesh.vertices[used].mean(axis=0) if used.any() else np.zeros(3)
    positions = mesh.vertices - centre
    # In an order with neighbours together: for large meshes whose order is another, this is much faster.
    order = locality_order(neighbours)
    step, positions = renumbered(step, order), positions[order]
    for _ in range(steps):
        positions = step @ positions
    smoothed = np.asarray(positions[inverse_of(order)] + centre)
    # Rounding around the centre must not move what has no neighbours.
    lonely = weights == 1.0
    smoothed[lonely] = mesh.vertices[lonely]
    return smoothed


def smooth(mesh: TriangleMesh, kind: Smoothing = "laplacian", steps: int = 30) -> FloatArray:
    """Return the base of the displacements, (V, 3) float64: smoothed as ``kind`` says, or the input itself.

    Args:
        mesh: the input.
        kind: ``laplacian``; ``spherical``, see :mod:`dmp.spherical`; or ``none``.
        steps: of Laplacian smoothing; without meaning for the others.

    Raises:
        NoSphereError: for ``spherical``, when the mesh is not a closed surface without handles.
    """
    if kind == "spherical":
        return spherical_smoothing(mesh)
    return laplacian_smoothing(mesh, steps) if kind == "laplacian" else mesh.vertices
