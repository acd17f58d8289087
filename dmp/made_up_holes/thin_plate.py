"""The neutral shape of a hole: the surface that bends least, given the vertices around it."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from dmp.mesh import BoolArray, FloatArray


class ThinPlate:
    """Solves for free vertices that minimise the sum of || q_i - mean of its neighbours ||^2 over all vertices.

    Uniform weights, so that nothing but the connectivity and the fixed positions decides: a made-up hole and a real one
    are filled by the same rule, although the true positions are known in the one and not in the other.
    """

    def __init__(self, adjacency: sparse.csr_array) -> None:
        """Prepare for a graph with the symmetric 0/1 ``adjacency`` (V, V)."""
        valence = np.maximum(adjacency.sum(axis=1), 1.0)
        laplacian = sparse.csr_array(sparse.eye_array(adjacency.shape[0]) - sparse.diags_array(1.0 / valence) @ adjacency)
        self._energy = sparse.csr_array(laplacian.T @ laplacian)

    def fill(self, positions: FloatArray, free: BoolArray) -> FloatArray:
        """Return ``positions`` (V, 3) with the ``free`` vertices (V,) moved to the thin plate.

        A free vertex that no fixed one holds, directly or through others, keeps its position.
        """
        inner, fixed = np.flatnonzero(free), np.flatnonzero(~free)
        filled = positions.copy()
        if not len(inner) or not len(fixed):
            return filled
        rows = self._energy[inner]
        # A trace of the present position makes a piece without any fixed vertex solvable, and changes nothing else.
        system = sparse.csc_matrix(rows[:, inner] + 1e-10 * sparse.eye_array(len(inner)))
        right = -(rows[:, fixed] @ positions[fixed]) + 1e-10 * positions[inner]
        filled[inner] = linalg.splu(system).solve(right)
        return filled
