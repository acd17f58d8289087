"""Solids described by functions that are negative inside, and the operations that combine them.

A :class:`Solid` is built from smooth *pieces*; its surface consists of parts of their zero sets, and where two of
them cross it has a sharp edge. Intersection is the maximum of two functions, union the minimum. All functions take
points (N, 3) and return values (N,) that are about the signed distance near the surface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

from dmp.mesh import FloatArray

Piece = Callable[[FloatArray], FloatArray]

# Differences along the four diagonals of a cube that span a tetrahedron: for shapes of size 1 exact to about 1e-5,
# enough for Newton's method, and a third cheaper than central differences.
_DIFFERENCE = 1e-6
_STENCIL = np.array([[1.0, -1.0, -1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, 1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Solid:
    """A region of space, ``value(points) < 0``, bounded by parts of the zero sets of its smooth ``pieces``."""

    value: Piece
    pieces: tuple[Piece, ...]

    @classmethod
    def smooth(cls, piece: Piece) -> Solid:
        """Return the solid bounded by one smooth surface."""
        return cls(piece, (piece,))

    def __and__(self, other: Solid) -> Solid:
        return Solid(lambda points: np.maximum(self.value(points), other.value(points)), _merged(self.pieces, other.pieces))

    def __or__(self, other: Solid) -> Solid:
        return Solid(lambda points: np.minimum(self.value(points), other.value(points)), _merged(self.pieces, other.pieces))

    def __sub__(self, other: Solid) -> Solid:
        return Solid(lambda points: np.maximum(self.value(points), -other.value(points)), _merged(self.pieces, other.pieces))


def _merged(first: tuple[Piece, ...], second: tuple[Piece, ...]) -> tuple[Piece, ...]:
    return tuple(dict.fromkeys(first + second))


def gradient(piece: Piece, points: FloatArray) -> FloatArray:
    """Return the gradient of ``piece`` at ``points``, (N, 3), by finite differences."""
    values = piece((points[None] + _DIFFERENCE * _STENCIL[:, None]).reshape(-1, 3)).reshape(4, -1)
    return np.stack([(_STENCIL[:, i, None] * values).sum(axis=0) for i in range(3)], axis=1) / (4 * _DIFFERENCE)


def _row_norms(vectors: FloatArray) -> FloatArray:
    # Written out, because np.linalg.norm may sum in another order on another processor.
    return np.sqrt(vectors[..., 0] ** 2 + vectors[..., 1] ** 2 + vectors[..., 2] ** 2)


def half_space(normal: ArrayLike, offset: float) -> Solid:
    """Return the points with ``normal . p <= offset`` (``normal`` is brought to length 1 first)."""
    direction = np.asarray(normal, dtype=np.float64)
    direction = direction / np.sqrt((direction**2).sum())
    return Solid.smooth(lambda p: p[:, 0] * direction[0] + p[:, 1] * direction[1] + p[:, 2] * direction[2] - offset)


def box(low: ArrayLike, high: ArrayLike) -> Solid:
    """Return the axis-parallel box between the corners ``low`` and ``high``: six pieces."""
    lows, highs = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    sides = [half_space(axis, highs[i]) for i, axis in enumerate(np.eye(3))]
    sides += [half_space(-axis, -lows[i]) for i, axis in enumerate(np.eye(3))]
    return intersection(sides)


def ball(centre: ArrayLike, radius: float) -> Solid:
    """Return the ball around ``centre``."""
    middle = np.asarray(centre, dtype=np.float64)
    return Solid.smooth(lambda p: _row_norms(p - middle) - radius)


def ellipsoid(centre: ArrayLike, radii: ArrayLike) -> Solid:
    """Return the axis-parallel ellipsoid with three radii (distance to first order)."""
    middle, axes = np.asarray(centre, dtype=np.float64), np.asarray(radii, dtype=np.float64)

    def value(p: FloatArray) -> FloatArray:
        scaled = _row_norms((p - middle) / axes)
        slope = np.maximum(_row_norms((p - middle) / axes**2), 1e-12)
        return scaled * (scaled - 1.0) / slope

    return Solid.smooth(value)


def cylinder(point: ArrayLike, axis: int, radius: float) -> Solid:
    """Return the endless cylinder around the line through ``point`` along coordinate ``axis`` (0, 1 or 2)."""
    middle = np.asarray(point, dtype=np.float64)
    first, second = (i for i in range(3) if i != axis)
    return Solid.smooth(lambda p: np.hypot(p[:, first] - middle[first], p[:, second] - middle[second]) - radius)


def cone(apex: ArrayLike, axis: int, half_angle: float) -> Solid:
    """Return the endless cone that opens from ``apex`` towards smaller coordinates along ``axis``; angle in radians."""
    tip = np.asarray(apex, dtype=np.float64)
    first, second = (i for i in range(3) if i != axis)
    sine, cosine = np.sin(half_angle), np.cos(half_angle)

    def value(p: FloatArray) -> FloatArray:
        across = np.hypot(p[:, first] - tip[first], p[:, second] - tip[second])
        return across * cosine + (p[:, axis] - tip[axis]) * sine

    return Solid.smooth(value)


def torus(centre: ArrayLike, axis: int, ring_radius: float, tube_radius: float) -> Solid:
    """Return the torus around ``centre`` whose ring lies across coordinate ``axis``."""
    middle = np.asarray(centre, dtype=np.float64)
    first, second = (i for i in range(3) if i != axis)

    def value(p: FloatArray) -> FloatArray:
        across = np.hypot(p[:, first] - middle[first], p[:, second] - middle[second]) - ring_radius
        return np.hypot(across, p[:, axis] - middle[axis]) - tube_radius

    return Solid.smooth(value)


def round_cone(start: ArrayLike, end: ArrayLike, start_radius: float, end_radius: float) -> Solid:
    """Return a limb: the balls of linearly changing radius along the segment from ``start`` to ``end``."""
    first = np.asarray(start, dtype=np.float64)
    along = np.asarray(end, dtype=np.float64) - first
    length_squared = float((along**2).sum())

    def value(p: FloatArray) -> FloatArray:
        q = p - first
        position = np.clip((q[:, 0] * along[0] + q[:, 1] * along[1] + q[:, 2] * along[2]) / length_squared, 0.0, 1.0)
        # A smooth step keeps the radius differentiable at both ends of the segment.
        radius = start_radius + (end_radius - start_radius) * position**2 * (3.0 - 2.0 * position)
        return _row_norms(q - position[:, None] * along) - radius

    return Solid.smooth(value)


def tube(course: FloatArray, radius: float) -> Solid:
    """Return the points within ``radius`` of the closed polygon ``course`` (N, 3), smooth where its bends are gentle."""
    ends = np.roll(course, -1, axis=0)

    def value(p: FloatArray) -> FloatArray:
        nearest = np.full(len(p), np.inf)
        for start, end in zip(course, ends, strict=True):
            along, q = end - start, p - start
            position = np.clip(
                (q[:, 0] * along[0] + q[:, 1] * along[1] + q[:, 2] * along[2]) / float((along**2).sum()), 0.0, 1.0
            )
            nearest = np.minimum(nearest, ((q - position[:, None] * along) ** 2).sum(axis=1))
        return np.sqrt(nearest) - radius

    return Solid.smooth(value)


def intersection(solids: Sequence[Solid]) -> Solid:
    """Return what all ``solids`` have in common."""
    return reduce(lambda a, b: a & b, solids)


def union(solids: Sequence[Solid]) -> Solid:
    """Return all ``solids`` together, with sharp seams."""
    return reduce(lambda a, b: a | b, solids)


def blend(solids: Sequence[Solid], width: float) -> Solid:
    """Return all ``solids`` together as one smooth piece, seams rounded over about ``width``.

    The smooth minimum of two values is min(a, b) - w k^3 / 6 with k = max(1 - |a - b| / w, 0): twice continuously
    differentiable, and exact where the values differ by more than ``width``. Applied from first to last.
    """

    def value(p: FloatArray) -> FloatArray:
        total = solids[0].value(p)
        for solid in solids[1:]:
            other = solid.value(p)
            overlap = np.maximum(1.0 - np.abs(total - other) / width, 0.0)
            total = np.minimum(total, other) - width * overlap**3 / 6.0
        return total

    return Solid.smooth(value)


def rounded_intersection(solids: Sequence[Solid], width: float) -> Solid:
    """Return what all ``solids`` have in common as one smooth piece, edges rounded over about ``width``."""
    outside = blend([complement(solid) for solid in solids], width)
    return Solid.smooth(lambda p: -outside.value(p))


def complement(solid: Solid) -> Solid:
    """Return everything that is not in ``solid``."""
    return Solid(lambda p: -solid.value(p), solid.pieces)


def turned(solid: Solid, centre: ArrayLike, axis: int, angle: float) -> Solid:
    """Return ``solid`` turned by ``angle`` (radians, right-handed) around coordinate ``axis`` through ``centre``."""
    middle = np.asarray(centre, dtype=np.float64)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = np.cos(angle), np.sin(angle)

    def back(p: FloatArray) -> FloatArray:
        q = p - middle
        source = q.copy()
        source[:, first] = cosine * q[:, first] + sine * q[:, second]
        source[:, second] = cosine * q[:, second] - sine * q[:, first]
        return source + middle

    def moved(piece: Piece) -> Piece:
        return lambda p: piece(back(p))

    return Solid(moved(solid.value), tuple(moved(piece) for piece in solid.pieces))
