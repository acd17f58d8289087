"""Which faces are neighbours, as symmetric pairs whose weights become a sparse matrix in one step.

Any triangles will do: at a boundary a face has fewer neighbours, and at a non-manifold edge all faces of the edge are
neighbours of each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from dmp.mesh import FloatArray, IntArray

# The number of pairs around a vertex or an edge grows with the square of its faces. Beyond this many faces, as at the tip
# of a cone of thin triangles, those of a vertex are neighbours over their edges only.
MOST_FACES = 40


@dataclass(frozen=True, eq=False)
class FacePairs:
    """Unordered pairs of different faces, each pair once.

    Attributes:
        first: (P,) int64.
        second: (P,) int64, larger than ``first``.
        n_faces: number of faces, F.
    """

    first: IntArray
    second: IntArray
    n_faces: int

    @cached_property
    def _layout(self) -> tuple[IntArray, IntArray, IntArray]:
        rows, columns = np.concatenate([self.first, self.second]), np.concatenate([self.second, self.first])
        order = np.lexsort((columns, rows))
        starts = np.searchsorted(rows[order], np.arange(self.n_faces + 1))
        return starts, columns[order], order % max(len(self.first), 1)

    def matrix(self, weights: FloatArray) -> sparse.csr_array:
        """Return the symmetric (F, F) matrix with ``weights`` (P,) at the pairs and 0 elsewhere."""
        starts, columns, pair = self._layout
        return sparse.csr_array((weights[pair], columns, starts), shape=(self.n_faces, self.n_faces))

    def members(self) -> sparse.csr_array:
        """Return the (F, F) matrix of ones whose row f holds face f and its neighbours, columns sorted."""
        matrix = sparse.csr_array(self.matrix(np.ones(len(self.first))) + sparse.eye_array(self.n_faces))
        matrix.sort_indices()
        return matrix

    def nearer_than(self, distance: float, points: FloatArray) -> FacePairs:
        """Return those pairs whose ``points`` (F, 3) lie at most ``distance`` apart."""
        near = np.linalg.norm(points[self.first] - points[self.second], axis=1) <= distance
        return FacePairs(self.first[near], self.second[near], self.n_faces)


def over_edges(faces: IntArray) -> FacePairs:
    """Return the pairs of ``faces`` (F, 3) that share an edge."""
    starts, ends = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    owner = np.repeat(np.arange(len(faces)), 3)[low != high]
    keys = (low * (int(faces.max()) + 1 if faces.size else 1) + high)[low != high]
    edges, edge = np.unique(keys, return_inverse=True)
    return _sharing(owner, edge, len(faces), len(edges))


def around_vertices(faces: IntArray) -> FacePairs:
    """Return the pairs of ``faces`` (F, 3) that share a vertex (with at most :data:`MOST_FACES` faces) or an edge."""
    corners = _sharing(
        np.repeat(np.arange(len(faces)), 3), faces.ravel(), len(faces), int(faces.max()) + 1 if faces.size else 0
    )
    edges = over_edges(faces)
    keys = np.concatenate([corners.first * len(faces) + corners.second, edges.first * len(faces) + edges.second])
    return _of_keys(np.unique(keys), len(faces))


def second_ring(pairs: FacePairs) -> FacePairs:
    """Return ``pairs`` and all pairs of faces with a common neighbour in them."""
    members = pairs.members()
    return _upper(sparse.csr_array(members @ members))


def _sharing(owner: IntArray, shared: IntArray, n_owners: int, n_shared: int) -> FacePairs:
    """Return the pairs of owners of a common ``shared`` thing, from a list of (owner, shared thing)."""
    kept = np.bincount(shared, minlength=n_shared)[shared] <= MOST_FACES
    ones = np.ones(np.count_nonzero(kept))
    incidence = sparse.csr_array((ones, (owner[kept], shared[kept])), shape=(n_owners, n_shared))
    return _upper(sparse.csr_array(incidence @ incidence.T))


def _upper(matrix: sparse.csr_array) -> FacePairs:
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    upper = matrix.indices > rows
    return _of_keys(np.sort(rows[upper] * matrix.shape[0] + matrix.indices[upper]), matrix.shape[0])


def _of_keys(keys: IntArray, n_faces: int) -> FacePairs:
    return FacePairs(keys // max(n_faces, 1), keys % max(n_faces, 1), n_faces)
