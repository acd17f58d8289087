"""Guided filtering of face normals (Zhang, Deng, Zhang, Bouaziz and Liu 2015, "Guided Mesh Normal Filtering")."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import sparse

from dmp.filters.bilateral import centroid_distance, gaussian, kept_where_zero, squared_lengths
from dmp.filters.following import VertexUpdate
from dmp.filters.neighbours import FacePairs, around_vertices, over_edges, second_ring
from dmp.geometry import face_areas, face_normals, normalised
from dmp.mesh import FloatArray, IntArray, TriangleMesh

_EPSILON = 1e-9  # of the paper: keeps the relative saliency of a flat patch finite
_MOST_PRODUCTS = 4_000_000  # scalar products of normals that are held together: 32 MB


def guided_normal(
    mesh: TriangleMesh, counts: Sequence[int], *, sigma: float, radius: float, vertex_steps: int
) -> Iterator[FloatArray]:
    """Yield the vertices (V, 3) after each number of iterations in ``counts`` (ascending).

    An iteration takes normals n, areas a and centroids c of the present mesh, the guidance g of :class:`Guidance`, and
    n_i <- normalised sum over j of a_j exp(-|c_i - c_j|^2 / (2 s^2)) exp(-|g_i - g_j|^2 / (2 sigma^2)) n_j, with s
    the mean distance of the centroids of faces that share an edge; then the vertices follow. The sum runs over the face
    itself and those of the two rings around it whose centroids in the input are near.

    Args:
        mesh: the input.
        counts: numbers of iterations.
        sigma: deviation of the differences of guidance normals, above 0.
        radius: how near, in mean distances of the centroids of faces that share an edge.
        vertex_steps: steps of :class:`VertexUpdate` in each iteration.
    """
    update = VertexUpdate(mesh.faces, mesh.n_vertices)
    edge_pairs, patches = over_edges(mesh.faces), around_vertices(mesh.faces)
    guidance = Guidance(patches, edge_pairs)
    centroids = update.centroids(mesh.vertices)
    pairs = second_ring(patches).nearer_than(radius * centroid_distance(centroids, edge_pairs), centroids)
    positions, done = mesh.vertices, 0
    for count in counts:
        for _ in range(count - done):
            areas, normals = face_areas(positions, mesh.faces), face_normals(positions, mesh.faces)
            centroids = update.centroids(positions)
            guides = guidance.normals(normals, areas)
            weights = gaussian(squared_lengths(centroids, pairs), centroid_distance(centroids, edge_pairs))
            weights *= gaussian(squared_lengths(guides, pairs), sigma)
            weighted = areas[:, None] * normals
            target = kept_where_zero(pairs.matrix(weights) @ weighted + weighted, normals)
            positions = update.apply(positions, target, vertex_steps)
        done = count
        yield positions


class Guidance:
    """For each face the mean normal of the most consistent patch around it, as the paper defines it.

    There is one patch a face: the face and all that share a vertex with it. The candidates of a face are the patches that
    contain it. The measure is H = D * R: D the largest difference |n_j - n_k| of two normals in the patch, R = largest
    difference over an edge inside the patch / (epsilon + sum of the differences over all of them). The smallest H wins. A
    face without a normal (0) counts neither in D nor in R.

    Args:
        patches: which faces share a vertex.
        edge_pairs: which faces share an edge.
    """

    def __init__(self, patches: FacePairs, edge_pairs: FacePairs) -> None:
        self._members = patches.members()
        self._edge_pairs = edge_pairs
        # Row: patch, column: edge. An edge lies inside a patch when both its faces do.
        inside = self._members[edge_pairs.first].multiply(self._members[edge_pairs.second])
        self._edges_inside = sparse.csr_array(sparse.csr_array(inside).T)
        self._by_size = _patches_by_size(self._members)

    def normals(self, normals: FloatArray, areas: FloatArray) -> FloatArray:
        """Return the guidance normals (F, 3) for face ``normals`` (F, 3) and ``areas`` (F,)."""
        means = normalised(self._members @ (areas[:, None] * normals))
        inconsistency = self.inconsistency(normals)
        values = inconsistency[self._members.indices]
        starts = self._members.indptr
        smallest = np.repeat(np.minimum.reduceat(values, starts[:-1]), np.diff(starts))
        # Of equal patches the one with the lowest index is taken.
        candidates = np.where(values == smallest, self._members.indices, len(normals))
        return means[np.minimum.reduceat(candidates, starts[:-1])]

    def inconsistency(self, normals: FloatArray) -> FloatArray:
        """Return H of each patch, (F,); the smaller, the more consistent are its ``normals`` (F, 3)."""
        # With the length l as a fourth coordinate, l_j l_k - n_j . n_k is half the squared difference of two unit
        # normals, and 0 where one of them is missing.
        extended = np.column_stack([normals, np.linalg.norm(normals, axis=1)])
        mirrored = extended * [-1.0, -1.0, -1.0, 1.0]
        spread = np.empty(len(normals))
        for patches, members in self._by_size:
            products = extended[members] @ mirrored[members].transpose(0, 2, 1)
            spread[patches] = products.max(axis=(1, 2))
        over_edges = np.einsum("pc,pc->p", extended[self._edge_pairs.first], mirrored[self._edge_pairs.second])
        differences, spread = _difference(over_edges), _difference(spread)
        largest = np.zeros(len(normals))
        starts = self._edges_inside.indptr
        filled = np.diff(starts) > 0
        if filled.any():
            largest[filled] = np.maximum.reduceat(differences[self._edges_inside.indices], starts[:-1][filled])
        return spread * largest / (_EPSILON + self._edges_inside @ differences)


def _difference(half_squared: FloatArray) -> FloatArray:
    return np.sqrt(np.maximum(2.0 * half_squared, 0.0))


def _patches_by_size(members: sparse.csr_array) -> list[tuple[IntArray, IntArray]]:
    """Return the patches of equal size together: their indices (N,) and faces (N, size), in groups of limited size."""
    sizes = np.diff(members.indptr)
    starts, faces = members.indptr.astype(np.int64), members.indices.astype(np.int64)
    groups: list[tuple[IntArray, IntArray]] = []
    for size in np.unique(sizes):
        patches = np.flatnonzero(sizes == size)
        parts = np.array_split(patches, -(-len(patches) * int(size) ** 2 // _MOST_PRODUCTS))
        groups += [(part, faces[starts[part][:, None] + np.arange(size)]) for part in parts]
    return groups
