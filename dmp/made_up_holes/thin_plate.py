"""The neutral shape of a hole: the surface that bends least, given the vertices around it."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from dmp.hole_filling.fairing import cotangent_laplacian
from dmp.mesh import BoolArray, FloatArray, IntArray

# Each pass takes its weights from the surface of the one before; after the second hardly anything changes.
_PASSES = 2
# A trace of the present position makes a piece without any fixed vertex solvable, and changes nothing else.
_TRACE = 1e-10


class ThinPlate:
    """Moves free vertices to where the surface bends least: to the minimum of the sum of |L q|^2 over all vertices.

    First with uniform weights, L q = q - mean of its neighbours, then with cotangent weights of the surface so found, which
    know the shape of the triangles. Nothing but the connectivity and the fixed positions decides: a made-up hole and a
    real one are filled by the same rule, although the true positions are known in the one and not in the other.
    """

    def __init__(self, adjacency: sparse.csr_array, faces: IntArray) -> None:
        """Prepare for a mesh with the symmetric 0/1 ``adjacency`` (V, V) and ``faces`` (F, 3)."""
        valence = np.maximum(adjacency.sum(axis=1), 1.0)
        laplacian = sparse.csr_array(sparse.eye_array(adjacency.shape[0]) - sparse.diags_array(1.0 / valence) @ adjacency)
        self._uniform = sparse.csr_array(laplacian.T @ laplacian)
        self._faces = faces

    def fill(self, positions: FloatArray, free: BoolArray) -> FloatArray:
        """Return ``positions`` (V, 3), in mean edge lengths, with the ``free`` vertices (V,) moved to the thin plate.

        A free vertex that no fixed one holds, directly or through others, keeps its position.
        """
        inner, fixed = np.flatnonzero(free), np.flatnonzero(~free)
        if not len(inner) or not len(fixed):
            return positions.copy()
        filled = _solve(self._uniform, positions, inner, fixed)
        for _ in range(_PASSES):
            laplacian, areas = cotangent_laplacian(filled, self._faces)
            # A vertex of faces without area would weigh more than all others together.
            weights = sparse.diags_array(1.0 / np.maximum(areas, 1e-3 * np.median(areas)))
            filled = _solve(sparse.csr_array(laplacian.T @ weights @ laplacian), filled, inner, fixed)
        return filled


def _solve(energy: sparse.csr_array, positions: FloatArray, inner: IntArray, fixed: IntArray) -> FloatArray:
    rows = energy[inner]
    between = rows[:, inner]
    scale = _TRACE * float(between.diagonal().max())
    system = sparse.csc_matrix(between + scale * sparse.eye_array(len(inner)))
    right = -(rows[:, fixed] @ positions[fixed]) + scale * positions[inner]
    filled = positions.copy()
    filled[inner] = linalg.splu(system).solve(right)
    return filled
