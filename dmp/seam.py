"""Known vertices exactly where they were, and the predicted ones joined to them without a step."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from dmp.mesh import BoolArray, FloatArray, TriangleMesh
from dmp.topology import adjacency


class Seam:
    """Puts known vertices back in place and lets the correction fade out over the inserted ones.

    The correction at a known vertex is its input position minus the predicted one. Over the inserted vertices it is
    harmonic on the vertex graph (each value the mean of its neighbours'), with the known ones as boundary values: it takes
    no value outside theirs, so it adds no bulge of its own, and it meets them without a step.
    """

    def __init__(self, mesh: TriangleMesh, known: BoolArray) -> None:
        """Prepare for a mesh and its known vertices, (V,) bool; the linear system is factorised once."""
        neighbours = adjacency(mesh.faces, mesh.n_vertices)
        laplacian = sparse.csr_array(sparse.diags_array(neighbours.sum(axis=1)) - neighbours)
        self._target = mesh.vertices
        self._known = np.flatnonzero(known)
        self._inserted = np.flatnonzero(~known)
        rows = laplacian[self._inserted]
        self._to_known = rows[:, self._known]
        self._solve = linalg.splu(sparse.csc_matrix(rows[:, self._inserted])).solve if len(self._inserted) else None

    def apply(self, predicted: FloatArray) -> FloatArray:
        """Return the joined positions, (V, 3), for predicted ones, (V, 3), in file units."""
        joined = predicted.copy()
        correction = self._target[self._known] - predicted[self._known]
        joined[self._known] = self._target[self._known]
        if self._solve is not None:
            joined[self._inserted] += self._solve(-(self._to_known @ correction))
        return joined
