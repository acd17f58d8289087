"""Minimum-weight triangulation of long rims, where looking at all triangles would take too long.

The dynamic programming is that of :mod:`dmp.hole_filling.triangulation`, over a selection of inner edges: those of the
Delaunay tetrahedra of the rim vertices (as M. Zou, T. Ju and N. Carr, "An algorithm for triangulating multiple 3D
polygons", 2013, found, they hold good triangulations of nearly all rims), all edges among about a hundred vertices spread
evenly over the rim, and edges between every second, fourth, eighth vertex. The last two make sure that some triangulation
exists.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial import Delaunay, QhullError

from dmp.hole_filling.patch import pair_keys
from dmp.hole_filling.triangulation import angle_steps, collected, cosines
from dmp.mesh import FloatArray, IntArray

_MOST_COARSE = 100
_IMPOSSIBLE = np.inf


def long_rim_triangulation(corners: FloatArray, outside_normals: FloatArray, forbidden: IntArray) -> IntArray | None:
    """Triangulate a polygon of hundreds or thousands of corners.

    Args:
        corners: positions (n, 3).
        outside_normals: (n, 3), as for :func:`dmp.hole_filling.triangulation.minimum_weight_triangulation`.
        forbidden: pairs of corners (k, 2) that no inner edge may join.

    Returns:
        triangles (n - 2, 3) of corner numbers, or None when all triangulations of the selection need a forbidden edge.
    """
    n = len(corners)
    # All edges as lower * n + higher corner number, sorted; among them the sides.
    edges = np.setdiff1d(_candidates(corners), pair_keys(forbidden, n))
    sides = np.append(np.arange(n - 1) * n + np.arange(1, n), n - 1)
    edges = np.union1d(edges, sides)
    first, middle, last = _triangles(edges, n)
    left, right, over = (np.searchsorted(edges, a * n + b) for a, b in ((first, middle), (middle, last), (first, last)))

    area_vector = np.cross(corners[middle] - corners[first], corners[last] - corners[first])
    double_area = np.linalg.norm(area_vector, axis=1)
    normal = np.divide(area_vector, double_area[:, None], out=np.zeros_like(area_vector), where=double_area[:, None] > 0)
    # Below 1 for any triangulation, so that angle steps and area fit into one number.
    area = double_area / 2 / (n * np.linalg.norm(np.diff(corners, axis=0), axis=1).sum() ** 2)

    weight = np.full(len(edges), _IMPOSSIBLE)
    at_edge = np.zeros((len(edges), 3))
    place = np.searchsorted(edges, sides[:-1])
    weight[place] = 0.0
    at_edge[place] = outside_normals[:-1]
    best = np.full(len(edges), -1, dtype=np.int64)

    # Triangles are sorted by the length of the interval that they close, and within it by their long edge.
    bounds = np.flatnonzero(np.diff(last - first, prepend=0, append=n))
    for begin, end in itertools.pairwise(bounds):
        rows = np.s_[begin:end]
        cosine = np.minimum(cosines(normal[rows], at_edge[left[rows]]), cosines(normal[rows], at_edge[right[rows]]))
        if last[begin] - first[begin] == n - 1:
            cosine = np.minimum(cosine, cosines(normal[rows], outside_normals[n - 1]))
        step = angle_steps(np.where(double_area[rows] > 0, cosine, -1.0)).astype(np.float64)
        parts = weight[left[rows]], weight[right[rows]]
        possible = np.isfinite(parts[0]) & np.isfinite(parts[1])
        steps_of = [np.floor(np.where(possible, part, 0.0)) for part in parts]
        areas = sum(np.where(possible, part, 0.0) - steps for part, steps in zip(parts, steps_of, strict=True))
        total = np.maximum(step, np.maximum(*steps_of)) + areas + area[rows]
        total = np.where(possible, total, _IMPOSSIBLE)
        groups = np.flatnonzero(np.diff(over[rows], prepend=-1))
        lowest = np.minimum.reduceat(total, groups)
        target = over[rows][groups]
        is_lowest = total == np.repeat(lowest, np.diff(groups, append=end - begin))
        winners = np.flatnonzero(is_lowest)
        winners = winners[np.flatnonzero(np.diff(over[rows][winners], prepend=-1))] + begin
        weight[target] = lowest
        at_edge[target] = normal[winners]
        best[target] = middle[winners]

    closing = int(np.searchsorted(edges, n - 1))
    if not np.isfinite(weight[closing]):
        return None
    return collected(lambda i, j: int(best[np.searchsorted(edges, i * n + j)]), n)


def _candidates(corners: FloatArray) -> IntArray:
    """Return keys lower * n + higher of the edges to choose from."""
    n = len(corners)
    pairs = [_delaunay_edges(corners)]
    coarse = np.unique(np.linspace(0, n - 1, _MOST_COARSE).astype(np.int64))
    low, high = np.triu_indices(len(coarse), 1)
    pairs.append(np.stack([coarse[low], coarse[high]], axis=1))
    # Between neighbouring coarse vertices by halves: each edge of a level lies over two of the level below.
    level = coarse
    while len(level) < n:
        gaps = np.flatnonzero(np.diff(level) > 1)
        middles = (level[gaps] + level[gaps + 1]) // 2
        level = np.union1d(level, middles)
        pairs.append(np.stack([level[:-1], level[1:]], axis=1))
    every = np.concatenate(pairs)
    return np.unique(pair_keys(every, n))


def _delaunay_edges(corners: FloatArray) -> IntArray:
    size = float(np.ptp(corners, axis=0).max())
    if size == 0:
        return np.empty((0, 2), dtype=np.int64)
    # Corners in one plane or on one sphere have no unique tetrahedra; a slight shake settles which to take.
    shaken = corners + 1e-5 * size * np.random.default_rng(0).standard_normal(corners.shape)
    try:
        tetrahedra = Delaunay(shaken).simplices.astype(np.int64)
    except QhullError:
        return np.empty((0, 2), dtype=np.int64)
    return np.concatenate([tetrahedra[:, [a, b]] for a in range(4) for b in range(a + 1, 4)])


def _triangles(edges: IntArray, n: int) -> tuple[IntArray, IntArray, IntArray]:
    """Return all triangles with three given edges as first, middle and last corner, sorted by last - first, then first."""
    low, high = edges // n, edges % n
    # Join each edge (first, middle) with each edge (middle, last): the latter lie in one block, as edges are sorted.
    begin, end = np.searchsorted(low, high), np.searchsorted(low, high, side="right")
    counts = end - begin
    pick = np.repeat(np.arange(len(edges)), counts)
    following = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + begin[pick]
    first, middle, last = low[pick], high[pick], high[following]
    key = first * n + last
    place = np.minimum(np.searchsorted(edges, key), len(edges) - 1)
    closed = edges[place] == key
    first, middle, last = first[closed], middle[closed], last[closed]
    order = np.lexsort((middle, first, last - first))
    return first[order], middle[order], last[order]
