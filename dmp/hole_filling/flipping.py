"""Flip edges of a patch until no flip widens the smallest angle nearby."""

from __future__ import annotations

import numpy as np

from dmp.geometry import face_area_vectors, normalised
from dmp.hole_filling.patch import InnerEdges, Patch, edge_keys, half_edges, inner_edges, pair_keys
from dmp.mesh import BoolArray, FloatArray, IntArray

_MOST_PASSES = 60
_LEAST_GAIN = 1e-3  # radians; smaller gains are not worth a pass


def flip_edges(patch: Patch, touched: BoolArray | None = None) -> None:
    """Flip inner edges as long as that makes the smallest angle of the two triangles at one of them larger.

    An edge stays where the new one exists already, in the patch or in the mesh outside, and where a new triangle would
    turn away from the two old ones. Each flip raises the smallest angle around it, so no flip is ever undone.

    Args:
        patch: changed in place.
        touched: (N,) mask of vertices; only edges of triangles at these are looked at first. None stands for all.
    """
    # Triangles far from the last flips need no second look, which makes all passes but the first cheap. The seed only
    # decides which of several competing flips comes first.
    random = np.random.default_rng(0)
    if touched is None:
        touched = np.ones(patch.n_vertices, dtype=bool)
    for _ in range(_MOST_PASSES):
        if not touched.any():
            return
        near = np.flatnonzero(touched[patch.triangles].any(axis=1))
        edges = inner_edges(patch.triangles[near], patch.n_vertices)
        gain = _gain(patch.positions, edges)
        candidates = np.flatnonzero(gain > _LEAST_GAIN)
        if not len(candidates):
            return
        candidates = candidates[~_is_joined(patch, edges.opposite[candidates])]
        rank = random.permutation(len(candidates))
        chosen = candidates[_independent(edges.triangles[candidates], rank, len(near))]
        touched = np.zeros(patch.n_vertices, dtype=bool)
        touched[_flip(patch, edges, near, chosen)] = True


def smallest_angles(positions: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the smallest angle of each triangle (K, 3), (K,), in radians; 0 without area."""
    first, second, third = positions[triangles[:, 0]], positions[triangles[:, 1]], positions[triangles[:, 2]]
    one, two, three = second - first, third - second, first - third
    largest = np.maximum(-np.einsum("kc,kc->k", one, three), -np.einsum("kc,kc->k", two, one))
    largest = np.maximum(largest, -np.einsum("kc,kc->k", three, two))
    area_vectors = _cross(one, two)
    double_area = np.sqrt(np.einsum("kc,kc->k", area_vectors, area_vectors))
    return np.arctan2(double_area, largest)


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Cross product of rows; several times faster than the general one of numpy."""
    x, y, z = first.T
    u, v, w = second.T
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)


def _gain(positions: FloatArray, edges: InnerEdges) -> FloatArray:
    """Return by how much flipping each edge raises the smallest angle of its two triangles, radians; -inf if it cannot."""
    a, b = edges.ends.T
    c, d = edges.opposite.T
    old = np.stack([a, b, c], axis=1), np.stack([b, a, d], axis=1)
    new = np.stack([c, d, b], axis=1), np.stack([d, c, a], axis=1)
    before = np.minimum(smallest_angles(positions, old[0]), smallest_angles(positions, old[1]))
    after = np.minimum(smallest_angles(positions, new[0]), smallest_angles(positions, new[1]))
    gain = np.where(c == d, -np.inf, after - before)

    better = np.flatnonzero(gain > _LEAST_GAIN)
    old_normal = sum(normalised(face_area_vectors(positions, triangles[better])) for triangles in old)
    new_normals = [normalised(face_area_vectors(positions, triangles[better])) for triangles in new]
    turns = np.einsum("ec,ec->e", *new_normals) < 0
    for normal in new_normals:
        turns |= np.einsum("ec,ec->e", normal, old_normal) <= 0
    gain[better[turns]] = -np.inf
    return gain


def _is_joined(patch: Patch, pairs: IntArray) -> BoolArray:
    """Tell which pairs (E, 2) are joined by an edge of the patch or of the mesh outside."""
    n = patch.n_vertices
    asked = np.zeros(n, dtype=bool)
    asked[pairs[:, 0]] = True
    start, end = half_edges(patch.triangles[asked[patch.triangles].any(axis=1)])
    existing = np.concatenate([edge_keys(start, end, n), pair_keys(patch.outside_edges, n)])
    return np.isin(pair_keys(pairs, n), existing)


def _independent(triangles: IntArray, rank: IntArray, n_triangles: int) -> IntArray:
    """Choose rows of ``triangles`` (E, 2), lowest rank first where they compete, so that no triangle occurs twice."""
    best = np.full(n_triangles, len(rank))
    np.minimum.at(best, triangles.ravel(), np.repeat(rank, 2))
    return np.flatnonzero((best[triangles] == rank[:, None]).all(axis=1))


def _flip(patch: Patch, edges: InnerEdges, near: IntArray, chosen: IntArray) -> IntArray:
    """Flip the chosen edges and return the vertices of the triangles around them."""
    # Two flips in different places can ask for the same new edge; only one may have it.
    _, unique = np.unique(pair_keys(edges.opposite[chosen], patch.n_vertices), return_index=True)
    chosen = chosen[unique]
    a, b = edges.ends[chosen].T
    c, d = edges.opposite[chosen].T
    owners = near[edges.triangles[chosen]]
    patch.triangles = patch.triangles.copy()
    patch.triangles[owners[:, 0]] = np.stack([c, d, b], axis=1)
    patch.triangles[owners[:, 1]] = np.stack([d, c, a], axis=1)
    return np.concatenate([a, b, c, d])
