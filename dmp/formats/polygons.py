"""Splitting planar polygons, also concave ones, into triangles.

A polygon is cut into a fan around its first corner where that covers it exactly; elsewhere ears are clipped (G. H.
Meisters, "Polygons have ears", 1975), many polygons at a time. A polygon that is not quite planar is judged as seen
along its normal.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from dmp.formats.source import FormatError
from dmp.mesh import BoolArray, FloatArray, IntArray

_BATCH_CORNERS = 1 << 18
_CLIPPING_BATCH_CORNERS = 1 << 16
MAXIMUM_CORNERS = 100_000
_MAXIMUM_CONCAVE_CORNERS = 4096
# Clipping takes about 50 ns times the square of the corners of each polygon: this is one to two seconds.
_CLIPPING_BUDGET = 30_000_000
_CLIPPING_BUDGET_PER_CORNER = 20
_SPLIT_FIRST = "Split the large faces into triangles first, for example in MeshLab (Turn into a Pure-Triangular mesh)."


def triangulate(vertices: FloatArray, corners: IntArray, counts: IntArray) -> IntArray:
    """Split polygons into triangles of the same orientation.

    Args:
        vertices: positions, (V, 3) float64.
        corners: vertex indices of all polygons one after the other, (K,) int64, in range; no corner repeats the one before.
        counts: corners of each polygon, (P,) int64, at least 3, with the sum K.

    Returns:
        The triangles in the order of the polygons, n - 2 for one with n corners, (K - 2 P, 3) int64.

    Raises:
        FormatError: when polygons have so many corners that splitting them would take minutes.
    """
    if (counts == 3).all():
        return corners.reshape(-1, 3)
    if counts.max() > MAXIMUM_CORNERS:
        raise FormatError(f"a face has {int(counts.max()):,} corners; at most {MAXIMUM_CORNERS:,} can be read", _SPLIT_FIRST)
    starts = np.cumsum(counts) - counts
    targets = starts - 2 * np.arange(len(counts))
    faces = np.empty((len(corners) - 2 * len(counts), 3), dtype=np.int64)
    concave: list[IntArray] = []
    order = np.argsort(counts, kind="stable")
    bounds = np.flatnonzero(np.diff(counts[order], prepend=0, append=MAXIMUM_CORNERS + 1))
    for first, last in pairwise(bounds):
        n = int(counts[order[first]])
        step = max(1, _BATCH_CORNERS // n)
        for begin in range(first, last, step):
            rows = order[begin : min(begin + step, last)]
            polygons = corners[starts[rows, None] + np.arange(n)]
            fan = np.stack([np.broadcast_to(polygons[:, :1], (len(rows), n - 2)), polygons[:, 1:-1], polygons[:, 2:]], axis=2)
            faces[targets[rows, None] + np.arange(n - 2)] = fan
            if n > 3:
                concave.append(rows[~_fan_covers(vertices[polygons])])
    rows = np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *concave]))
    _check_budget(counts[rows], len(corners))
    for batch, width in _batches(rows, counts):
        columns = np.minimum(np.arange(width), counts[batch, None] - 1)
        polygons = corners[starts[batch, None] + columns]
        ears = _clip_ears(*_flatten(vertices[polygons]), counts[batch])
        chosen = np.arange(width - 2) < counts[batch, None] - 2
        owners = np.broadcast_to(np.arange(len(batch))[:, None], chosen.shape)[chosen]
        faces[(targets[batch, None] + np.arange(width - 2))[chosen]] = polygons[owners[:, None], ears[chosen]]
    return faces


def _padded(sizes: IntArray) -> IntArray:
    """Round up to a power of two, or one and a half times one, so that similar polygons can be handled together."""
    power = 2 ** np.ceil(np.log2(sizes)).astype(np.int64)
    return np.where(sizes <= power * 3 // 4, power * 3 // 4, power)


def _check_budget(sizes: IntArray, n_corners: int) -> None:
    budget = max(_CLIPPING_BUDGET, _CLIPPING_BUDGET_PER_CORNER * n_corners)
    if len(sizes) and (sizes.max() > _MAXIMUM_CONCAVE_CORNERS or float((_padded(sizes).astype(float) ** 2).sum()) > budget):
        raise FormatError(
            f"{len(sizes):,} faces are concave polygons, the largest with {int(sizes.max()):,} corners: too much to split",
            _SPLIT_FIRST,
        )


def _batches(rows: IntArray, counts: IntArray) -> Iterator[tuple[IntArray, int]]:
    """Yield polygons of similar numbers of corners in batches of a bounded extent, with the length to pad them to."""
    padded = _padded(counts[rows])
    for width in np.unique(padded).tolist():
        group = rows[padded == width]
        step = max(1, _CLIPPING_BATCH_CORNERS // width)
        for begin in range(0, len(group), step):
            yield group[begin : begin + step], width


def _normals(points: FloatArray) -> FloatArray:
    """Return the area vectors of polygons (m, n, 3), from their first corner so that a far origin costs no digits."""
    edges = points[:, 1:] - points[:, :1]
    return np.cross(edges[:, :-1], edges[:, 1:]).sum(axis=1)


def _rounding(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the extent of each polygon (m, n, 3), and by how much rounding of its positions may change an area, both (m,)."""
    extent = np.abs(points - points[:, :1]).max(axis=(1, 2))
    return extent, 8 * np.finfo(np.float64).eps * np.abs(points).max(axis=(1, 2)) * extent


def _fan_covers(points: FloatArray) -> BoolArray:
    """Tell for polygons (m, n, 3) whether all fan triangles have an area and look the same way."""
    edges = points[:, 1:] - points[:, :1]
    areas = np.cross(edges[:, :-1], edges[:, 1:])
    total = areas.sum(axis=1, keepdims=True)
    smallest = _rounding(points)[1][:, None] * np.linalg.norm(total, axis=2)
    return ((areas * total).sum(axis=2) > smallest).all(axis=1)


def _flatten(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Project polygons (m, n, 3) along the largest component of their normals.

    The padding, which repeats the last corner, adds no area.

    Returns:
        Positions (m, n, 2), counter-clockwise and of extent 1, and the areas up to which three corners count as lying
        on a line, (m,).
    """
    normals = _normals(points)
    axis = np.abs(normals).argmax(axis=1)
    kept = np.array([[1, 2], [2, 0], [0, 1]])[axis]
    flat = np.take_along_axis(points, kept[:, None, :], axis=2)
    extent, rounding = _rounding(points)
    extent = np.where(extent > 0, extent, 1.0)
    flat = (flat - flat[:, :1]) / extent[:, None, None]
    clockwise = np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] < 0
    flat[clockwise, :, 0] *= -1
    return flat, rounding / extent**2


class _Clipping:
    """Polygons (m, n, 2) from which ears are being cut, as doubly linked rings of their remaining corners.

    Each corner has a score: above 1 for an ear, the more the nearer its triangle is to an equilateral one; from 0 to 1
    for a convex corner that is no ear, below 0 for the others, and lowest for those cut off.
    """

    def __init__(self, points: FloatArray, rounding: FloatArray, counts: IntArray) -> None:
        m, n = points.shape[:2]
        self.x, self.y = np.ascontiguousarray(points[..., 0]), np.ascontiguousarray(points[..., 1])
        self.rounding = rounding
        self.alive = np.arange(n) < counts[:, None]
        self.next = np.where(np.arange(n) + 1 < counts[:, None], np.arange(n) + 1, 0)
        self.previous = np.where(np.arange(n) > 0, np.arange(n) - 1, counts[:, None] - 1)
        self.score = np.full((m, n), -2.0)
        for corner in range(n):
            rows = np.flatnonzero(self.alive[:, corner])
            self.update(rows, np.full(len(rows), corner))

    def update(self, rows: IntArray, corner: IntArray) -> None:
        """Judge one corner of each of the polygons ``rows``: an ear is convex and has no other corner in its triangle."""
        a, c = self.previous[rows, corner], self.next[rows, corner]
        ax, ay = self.x[rows, a, None], self.y[rows, a, None]
        bx, by = self.x[rows, corner, None], self.y[rows, corner, None]
        cx, cy = self.x[rows, c, None], self.y[rows, c, None]
        x, y, rounding = self.x[rows], self.y[rows], self.rounding[rows, None]
        # A corner on the rim of the triangle counts as inside, so that no later triangle is left without an area.
        inside = self.alive[rows]
        inside &= (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= -rounding
        inside &= (cx - bx) * (y - by) - (cy - by) * (x - bx) >= -rounding
        inside &= (ax - cx) * (y - cy) - (ay - cy) * (x - cx) >= -rounding
        # Corners at the same place, such as where a hole is tied to the outline, do not block each other.
        inside &= ~((x == ax) & (y == ay) | (x == bx) & (y == by) | (x == cx) & (y == cy))
        area = ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))[:, 0]
        squares = ((bx - ax) ** 2 + (by - ay) ** 2 + (cx - bx) ** 2 + (cy - by) ** 2 + (ax - cx) ** 2 + (ay - cy) ** 2)[:, 0]
        shape = np.divide(area, squares, out=np.zeros_like(area), where=squares > 0)
        is_ear = (area > self.rounding[rows]) & ~inside.any(axis=1)
        self.score[rows, corner] = shape + is_ear

    def cut(self, rows: IntArray) -> IntArray:
        """Cut the best ear off each of the polygons ``rows`` and return its three corners, (len(rows), 3).

        A polygon that crosses itself, or without any area, may have no ear left; its best corner is cut then.
        """
        corner = self.score[rows].argmax(axis=1)
        a, c = self.previous[rows, corner], self.next[rows, corner]
        self.alive[rows, corner] = False
        self.score[rows, corner] = -2.0
        self.next[rows, a], self.previous[rows, c] = c, a
        self.update(rows, a)
        self.update(rows, c)
        return np.stack([a, corner, c], axis=1)


def _clip_ears(points: FloatArray, rounding: FloatArray, counts: IntArray) -> IntArray:
    """Return the corners of the triangles of flat polygons (m, n, 2), (m, n - 2, 3), without meaning from ``counts - 2`` on."""
    m, n = points.shape[:2]
    clipping = _Clipping(points, rounding, counts)
    triangles = np.zeros((m, n - 2, 3), dtype=np.int64)
    for step in range(n - 2):
        rows = np.flatnonzero(counts - 2 > step)
        triangles[rows, step] = clipping.cut(rows)
    return triangles
