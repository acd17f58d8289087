"""Close a rim without new vertices: the minimum-weight triangulation of a closed polygon in space.

After P. Liepa, "Filling holes in meshes", Symposium on Geometry Processing 2003, section 3: among all triangulations of
the polygon, dynamic programming finds the one whose worst angle between neighbouring triangles, the faces outside the
rim included, is smallest, and of several such ones the one with the smallest area. Corners of a polygon are numbered
0..n-1, and all triangles run through them in ascending order.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dmp.mesh import BoolArray, FloatArray, IntArray

# Angles within one step count as equal, so that area decides between them. With exact angles it would never be asked.
_ANGLE_STEP = np.radians(3.0)


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
        cosine = np.minimum(cosines(normal, by_start.normal[left]), cosines(normal, by_end.normal[right]))
        if length == n - 1:
            cosine = np.minimum(cosine, cosines(normal, outside_normals[n - 1]))
        # A triangle without area meets every neighbour as badly as one folded back.
        cosine = np.where(double_area > 0, cosine, -1.0)
        angle = np.maximum(angle_steps(cosine), np.maximum(by_start.angle[left], by_end.angle[right]))
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
    return collected(lambda first, last: int(middle[first, last]), n)


_IMPOSSIBLE = np.iinfo(np.int16).max


class _Table:
    """Worst angle in steps, area, and the normal of the outermost triangle, for intervals of corners."""

    def __init__(self, n: int) -> None:
        self.angle = np.full((n, n), _IMPOSSIBLE, dtype=np.int16)
        self.area = np.full((n, n), np.inf)
        self.normal = np.zeros((n, n, 3))


def cosines(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the cosine between unit vectors (..., 3); 1 where the second is 0 and says nothing."""
    cosine = np.einsum("...c,...c->...", first, second)
    silent = ~second.any(axis=-1)
    return np.where(silent, 1.0, cosine)


def angle_steps(cosine: FloatArray) -> NDArray[np.int16]:
    """Return the angles with the given cosines as multiples of the step below which angles count as equal."""
    return np.round(np.arccos(np.clip(cosine, -1.0, 1.0)) / _ANGLE_STEP).astype(np.int16)


def collected(middle_of: Callable[[int, int], int], n: int) -> IntArray:
    """Return the triangles (n - 2, 3) of a polygon, given the corner between the ends of each interval."""
    triangles = []
    waiting = [(0, n - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        between = middle_of(first, last)
        triangles.append((first, between, last))
        waiting += [(first, between), (between, last)]
    return np.array(triangles, dtype=np.int64)
