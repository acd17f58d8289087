"""Bilateral filtering of face normals (Zheng, Fu, Au and Tai 2011, "Bilateral Normal Filtering for Mesh Denoising")."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dmp.filters.following import VertexUpdate
from dmp.filters.neighbours import FacePairs, around_vertices, over_edges
from dmp.geometry import face_areas, face_normals, normalised
from dmp.mesh import FloatArray, TriangleMesh


def bilateral_normal(
    mesh: TriangleMesh, counts: Sequence[int], *, sigma: float, neighbourhood: str, vertex_steps: int
) -> Iterator[FloatArray]:
    """Yield the vertices (V, 3) after each number of normal iterations in ``counts`` (ascending): the local scheme.

    An iteration is n_i <- normalised sum over the neighbours j of a_j exp(-|c_i - c_j|^2 / (2 s^2)) exp(-|n_i - n_j|^2 /
    (2 sigma^2)) n_j with areas a, centroids c, and s the mean distance of the centroids of faces that share an edge, all of
    the input. The vertices follow the last normals once, at the end.

    Args:
        mesh: the input.
        counts: numbers of iterations.
        sigma: deviation of the differences of unit normals, above 0.
        neighbourhood: ``"vertex"`` (faces that share a vertex) or ``"edge"``; a face is no neighbour of itself.
        vertex_steps: steps of :class:`VertexUpdate`.
    """
    update = VertexUpdate(mesh.faces, mesh.n_vertices)
    areas, normals = face_areas(mesh.vertices, mesh.faces), face_normals(mesh.vertices, mesh.faces)
    centroids, edge_pairs = update.centroids(mesh.vertices), over_edges(mesh.faces)
    pairs = edge_pairs if neighbourhood == "edge" else around_vertices(mesh.faces)
    nearness = gaussian(squared_lengths(centroids, pairs), centroid_distance(centroids, edge_pairs))
    done = 0
    for count in counts:
        for _ in range(count - done):
            weights = nearness * gaussian(squared_lengths(normals, pairs), sigma)
            normals = kept_where_zero(pairs.matrix(weights) @ (areas[:, None] * normals), normals)
        done = count
        yield update.apply(mesh.vertices, normals, vertex_steps)


def squared_lengths(values: FloatArray, pairs: FacePairs) -> FloatArray:
    """Return |x_i - x_j|^2 for each pair, (P,), of ``values`` x (F, 3)."""
    differences = values[pairs.first] - values[pairs.second]
    return np.asarray(np.einsum("pc,pc->p", differences, differences))


def gaussian(squared: FloatArray, deviation: float) -> FloatArray:
    """Return exp(-squared / (2 deviation^2)); 1 where the deviation is 0, so that a mesh shrunk to a point has weights."""
    return np.exp(-squared / (2.0 * deviation**2)) if deviation > 0 else np.ones_like(squared)


def centroid_distance(centroids: FloatArray, edge_pairs: FacePairs) -> float:
    """Return the mean distance of the ``centroids`` (F, 3) of faces that share an edge; 0 without such faces."""
    return float(np.sqrt(squared_lengths(centroids, edge_pairs)).mean()) if len(edge_pairs.first) else 0.0


def kept_where_zero(sums: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the rows of ``sums`` (F, 3) at length 1; where a face has no neighbour with a weight, its old normal."""
    return np.where(np.any(sums, axis=1, keepdims=True), normalised(sums), normals)
