"""The triangles that close one hole, together with the faces around it, in a numbering of their own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from dmp.mesh import BoolArray, FloatArray, IntArray


@dataclass
class Patch:
    """The triangles that close a hole; changed in place by every stage of the filling.

    Attributes:
        positions: (N, 3), with the middle of the rim at 0, so that a place far from the origin costs no digits; first the
            ``n_rim`` rim vertices in the order in which the patch runs around them, then the
            other ``n_fixed - n_rim`` vertices of the faces around the rim, then the new ones.
        triangles: (K, 3), the patch, oriented as the mesh.
        collar: (C, 3), the faces of the mesh that touch the rim.
        wanted: (N,), the edge length wanted at each vertex; only that of the rim and of new vertices means something.
        n_rim: number of rim vertices.
        n_fixed: number of vertices that the mesh already has.
        outside_edges: (M, 2), the pairs of rim vertices that an edge of the mesh joins, sides of the rim included.
        origin: (3,), where 0 lies in the mesh.
    """

    positions: FloatArray
    triangles: IntArray
    collar: IntArray
    wanted: FloatArray
    n_rim: int
    n_fixed: int
    outside_edges: IntArray
    origin: FloatArray

    def copy(self) -> Patch:
        """Return a patch that can be changed without changing this one."""
        return replace(self, positions=self.positions.copy(), wanted=self.wanted.copy())

    @property
    def n_vertices(self) -> int:
        """Number of all vertices, N."""
        return len(self.positions)

    @property
    def n_inserted(self) -> int:
        """Number of new vertices."""
        return len(self.positions) - self.n_fixed

    @property
    def inserted(self) -> IntArray:
        """Indices of the new vertices."""
        return np.arange(self.n_fixed, len(self.positions))

    def add_vertices(self, positions: FloatArray, wanted: FloatArray) -> int:
        """Append new vertices and return the index of the first one."""
        first = len(self.positions)
        self.positions = np.concatenate([self.positions, positions])
        self.wanted = np.concatenate([self.wanted, wanted])
        return first

    def lengths(self, edges: IntArray) -> FloatArray:
        """Return the lengths of edges (E, 2)."""
        return np.linalg.norm(self.positions[edges[:, 0]] - self.positions[edges[:, 1]], axis=1)

    def relative_lengths(self, edges: IntArray) -> FloatArray:
        """Return the lengths of edges (E, 2) in units of the length wanted there, the mean of that of both ends."""
        return self.lengths(edges) / self.wanted[edges].mean(axis=1)

    def joined(self) -> sparse.csr_array:
        """Return the 0/1 adjacency (N, N) of the patch together with the edges outside between rim vertices."""
        start, end = half_edges(self.triangles)
        first, second = self.outside_edges.T
        rows, columns = np.concatenate([start, end, first, second]), np.concatenate([end, start, second, first])
        matrix = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(self.n_vertices,) * 2)
        matrix.sum_duplicates()
        matrix.data[:] = 1.0
        return matrix


@dataclass(frozen=True)
class InnerEdges:
    """Edges between two triangles: ends (E, 2), the rows of both triangles (E, 2), and their opposite corners (E, 2).

    The ends are in the order in which the first of the two triangles runs through them.
    """

    ends: IntArray
    triangles: IntArray
    opposite: IntArray


def half_edges(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """Return where the sides 01, 12, 20 of all triangles (K, 3) start and end, each (3 K,), all first sides first."""
    return triangles.T.ravel(), triangles[:, [1, 2, 0]].T.ravel()


def edge_keys(start: IntArray, end: IntArray, n_vertices: int) -> IntArray:
    """Return one integer for each undirected edge."""
    return np.minimum(start, end) * n_vertices + np.maximum(start, end)


def pair_keys(pairs: IntArray, n_vertices: int) -> IntArray:
    """Return :func:`edge_keys` of pairs (E, 2)."""
    return edge_keys(pairs[:, 0], pairs[:, 1], n_vertices)


def inner_edges(triangles: IntArray, n_vertices: int) -> InnerEdges:
    """Find the edges that two of the triangles (K, 3) share; no edge may have more than two."""
    start, end = half_edges(triangles)
    key = edge_keys(start, end, n_vertices)
    order = np.argsort(key, kind="stable")
    sorted_key = key[order]
    first = np.flatnonzero(sorted_key[1:] == sorted_key[:-1])
    one, two = order[first], order[first + 1]
    opposite = triangles[:, [2, 0, 1]].T.ravel()
    owner = np.tile(np.arange(len(triangles)), 3)
    return InnerEdges(
        np.stack([start[one], end[one]], axis=1),
        np.stack([owner[one], owner[two]], axis=1),
        np.stack([opposite[one], opposite[two]], axis=1),
    )


def neighbour_means(triangles: IntArray, n_vertices: int) -> sparse.csr_array:
    """Return the matrix (N, N) that takes the mean over the vertices joined to each vertex; rows without any are empty."""
    start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    rows, columns = np.concatenate([start, end]), np.concatenate([end, start])
    joined = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(n_vertices, n_vertices))
    joined.sum_duplicates()
    valence = np.diff(joined.indptr)
    joined.data = 1.0 / np.repeat(valence, valence)
    return joined


def open_vertices(triangles: IntArray, n_vertices: int) -> BoolArray:
    """Return a mask (N,) of the vertices that lie on an edge with a single triangle."""
    start, end = half_edges(triangles)
    keys, counts = np.unique(edge_keys(start, end, n_vertices), return_counts=True)
    single = keys[counts == 1]
    mask = np.zeros(n_vertices, dtype=bool)
    mask[single // n_vertices] = True
    mask[single % n_vertices] = True
    return mask
