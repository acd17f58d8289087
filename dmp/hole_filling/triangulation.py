"""Close a rim without new vertices: the minimum-weight triangulation of a closed polygon in space.

After P. Liepa, "Filling holes in meshes", Symposium on Geometry Processing 2003, section 3: among all triangulations of
the polygon, dynamic programming finds the one whose worst angle between neighbouring triangles, the faces outside the
rim included, is smallest, and of several such ones the one with the smallest area. Corners of a polygon are numbered
0..n-1, and all triangles run through them in ascending order.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dmp.geometry import normalised
from dmp.mesh import BoolArray, FloatArray, IntArray

# Time grows with the cube of the number of corners: 300 take half a second, 500 two.
MAX_CORNERS = 300

# Angles within one step count as equal, so that area decides between them. With exact angles it would never be asked.
_ANGLE_STEP = np.radians(3.0)


def triangulated(corners: FloatArray, outside_normals: FloatArray, forbidden: IntArray) -> IntArray | None:
    """Triangulate a polygon of any length: its corners are cut off until :data:`MAX_CORNERS` are left, then the rest at once.

    Args:
        corners: positions (n, 3), n >= 3.
        outside_normals: as for :func:`minimum_weight_triangulation`.
        forbidden: pairs of corner numbers (k, 2) that no inner edge may join.

    Returns:
        triangles (n - 2, 3) of corner numbers, or None when none was found without a forbidden edge.
    """
    n = len(corners)
    ears, left = np.empty((0, 3), dtype=np.int64), np.arange(n)
    taken = np.sort(forbidden, axis=1) @ np.array([n, 1])
    if n > MAX_CORNERS:
        ears, left, outside_normals = reduced_polygon(corners, outside_normals, taken, MAX_CORNERS)
        if len(left) > MAX_CORNERS:
            return None
        taken = np.concatenate([taken, np.sort(ears[:, [0, 2]], axis=1) @ np.array([n, 1])])
    low, high = np.minimum(left[:, None], left), np.maximum(left[:, None], left)
    rest = minimum_weight_triangulation(corners[left], outside_normals, np.isin(low * n + high, taken))
    return None if rest is None else np.concatenate([ears, left[rest]])


def minimum_weight_triangulation(corners: FloatArray, outside_normals: FloatArray, forbidden: BoolArray) -> IntArray | None:
    """Triangulate a polygon, at best with flat angles and a small area.

    Args:
        corners: positions (n, 3), n >= 3.
        outside_normals: unit normal (n, 3) of the face beyond the side from corner i to corner i + 1, oriented as the
            triangles to be found; 0 where it has none, which fits to everything.
        forbidden: (n, n) symmetric; pairs of corners that no inner edge may join, because an edge of the mesh outside
            already does.

    Returns:
        triangles (n - 2, 3) of corner numbers, or None when every triangulation needs a forbidden edge.
    """
    n = len(corners)
    # Tables over intervals of corners. `by_start[length, i]` belongs to corners i..i+length, `by_end[length, j]` to
    # j-length..j: both are needed, so that one slice of each holds all parts of all intervals of one length.
    by_start = _Table(n)
    by_end = _Table(n)
    for table in (by_start, by_end):
        table.angle[1] = 0
        table.area[1] = 0.0
    by_start.normal[1, : n - 1] = outside_normals[: n - 1]
    by_end.normal[1, 1:] = outside_normals[: n - 1]
    middle = np.zeros((n, n), dtype=np.int64)

    for length in range(2, n):
        count = n - length
        first, last = corners[:count], corners[length:]
        between = np.moveaxis(sliding_window_view(corners, count, axis=0), 2, 1)[1:length]  # (length - 1, count, 3)
        area_vector = np.cross(between - first, last - first)
        double_area = np.sqrt(np.einsum("tic,tic->ti", area_vector, area_vector))
        normal = np.divide(
            area_vector, double_area[..., None], out=np.zeros_like(area_vector), where=double_area[..., None] > 0
        )

        left, right = np.s_[1:length, :count], np.s_[length - 1 : 0 : -1, length:]
        cosine = np.minimum(_cosines(normal, by_start.normal[left]), _cosines(normal, by_end.normal[right]))
        if length == n - 1:
            cosine = np.minimum(cosine, _cosines(normal, outside_normals[n - 1]))
        # A triangle without area meets every neighbour as badly as one folded back.
        cosine = np.where(double_area > 0, cosine, -1.0)
        angle = np.round(np.arccos(np.clip(cosine, -1.0, 1.0)) / _ANGLE_STEP).astype(np.int16)
        angle = np.maximum(angle, np.maximum(by_start.angle[left], by_end.angle[right]))
        area = by_start.area[left] + by_end.area[right] + double_area / 2

        candidate = np.where(angle == angle.min(axis=0), area, np.inf)
        best = np.argmin(candidate, axis=0)
        column = np.arange(count)
        best_area = candidate[best, column]
        if length < n - 1:
            best_area = np.where(forbidden[column, column + length], np.inf, best_area)
        best_angle = np.where(np.isfinite(best_area), angle[best, column], _IMPOSSIBLE)
        for table, place in ((by_start, np.s_[length, :count]), (by_end, np.s_[length, length:])):
            table.angle[place] = best_angle
            table.area[place] = best_area
            table.normal[place] = normal[best, column]
        middle[column, column + length] = column + 1 + best

    if not np.isfinite(by_start.area[n - 1, 0]):
        return None
    return _collected(middle)


def reduced_polygon(
    corners: FloatArray, outside_normals: FloatArray, taken: IntArray, target: int
) -> tuple[IntArray, IntArray, FloatArray]:
    """Cut triangles off the corners of a long polygon until at most ``target`` corners are left.

    A corner is cut off where the triangle of it and its two neighbours bends least against the faces beyond its two
    sides and is the most pointed; in each pass no two neighbouring corners go. Stops early when every corner would
    need an edge that exists: ``taken`` holds these as lower * n + higher corner number.

    Returns:
        the triangles cut off (k, 3) of corner numbers, the corners left (m,) in order, and the outside normals (m, 3)
        that belong to them.
    """
    n = len(corners)
    left = np.arange(n)
    normals = outside_normals.copy()
    triangles: list[IntArray] = []
    while len(left) > target:
        before, after = np.roll(left, 1), np.roll(left, -1)
        area_vector = np.cross(corners[left] - corners[before], corners[after] - corners[before])
        normal = normalised(area_vector)
        bend = np.minimum(_cosines(normal, np.roll(normals, 1, axis=0)), _cosines(normal, normals))
        chord = np.linalg.norm(corners[after] - corners[before], axis=1)
        sides = np.linalg.norm(corners[left] - corners[before], axis=1) + np.linalg.norm(corners[after] - corners[left], axis=1)
        # From 1 for two sides folded together to 0 for a straight line; below 0 where the triangle folds back.
        score = np.where(bend > 0.5, 1 - chord / np.maximum(sides, np.finfo(float).tiny), bend - 1.5)
        chord_key = np.minimum(before, after) * n + np.maximum(before, after)
        score[np.isin(chord_key, taken)] = -np.inf
        chosen = _local_best(score, len(left) - target)
        if not chosen.any():
            break
        triangles.append(np.stack([before, left, after], axis=1)[chosen])
        # The side before a corner that goes is now the chord, and beyond it lies the new triangle.
        normals[np.roll(chosen, -1)] = normal[chosen]
        left, normals = left[~chosen], normals[~chosen]
        taken = np.concatenate([taken, chord_key[chosen]])
    return np.concatenate(triangles) if triangles else np.empty((0, 3), dtype=np.int64), left, normals


_IMPOSSIBLE = np.iinfo(np.int16).max


class _Table:
    """Worst angle in steps, area, and the normal of the outermost triangle, for intervals of corners."""

    def __init__(self, n: int) -> None:
        self.angle = np.full((n, n), _IMPOSSIBLE, dtype=np.int16)
        self.area = np.full((n, n), np.inf)
        self.normal = np.zeros((n, n, 3))


def _cosines(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the cosine between unit vectors (..., 3); 1 where the second is 0 and says nothing."""
    cosine = np.einsum("...c,...c->...", first, second)
    silent = ~second.any(axis=-1)
    return np.where(silent, 1.0, cosine)


def _local_best(score: FloatArray, most: int) -> BoolArray:
    """Choose up to ``most`` of the best entries of a ring, no two of them neighbours."""
    chosen = np.zeros(len(score), dtype=bool)
    # A quarter a pass keeps the choice close to one by one, without n passes.
    most = min(most, max(len(score) // 4, 1))
    for index in np.argsort(-score, kind="stable"):
        if most == 0 or score[index] == -np.inf:
            break
        if not chosen[index - 1] and not chosen[(index + 1) % len(score)]:
            chosen[index] = True
            most -= 1
    return chosen


def _collected(middle: IntArray) -> IntArray:
    triangles = []
    waiting = [(0, len(middle) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        between = int(middle[first, last])
        triangles.append((first, between, last))
        waiting += [(first, between), (between, last)]
    return np.array(triangles, dtype=np.int64)
