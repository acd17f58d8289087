"""Sharp edges and corners of a solid: curves in which two of its pieces meet, traced and divided evenly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from dmp.mesh import FloatArray
from dmp.shapes.solids import Piece, Solid, gradient

_ON_SURFACE = 1e-7
# Two pieces that meet more gently than this, in radians, are taken as one smooth surface.
_LEAST_ANGLE = 0.2


@dataclass(frozen=True, eq=False)
class SharpCurve:
    """A traced sharp edge: ``points`` (N, 3) along it, the two ``pieces`` that meet, and whether it closes on itself."""

    points: FloatArray
    pieces: tuple[Piece, Piece]
    is_loop: bool

    def length(self) -> float:
        """Return the length along the points."""
        closed = np.concatenate([self.points, self.points[:1]]) if self.is_loop else self.points
        return float(np.sqrt((np.diff(closed, axis=0) ** 2).sum(axis=1)).sum())

    def divided(self, spacing: float) -> FloatArray:
        """Return points on the curve about ``spacing`` apart, equally far along it; both ends of an open curve included."""
        closed = np.concatenate([self.points, self.points[:1]]) if self.is_loop else self.points
        along = np.concatenate([[0.0], np.cumsum(np.sqrt((np.diff(closed, axis=0) ** 2).sum(axis=1)))])
        count = max(3 if self.is_loop else 1, round(along[-1] / spacing))
        wanted = np.linspace(0.0, along[-1], count + 1)
        evenly = np.stack([np.interp(wanted, along, closed[:, i]) for i in range(3)], axis=1)
        evenly[1:-1] = onto_pieces(self.pieces, evenly[1:-1])
        return evenly[:-1] if self.is_loop else evenly


def onto_pieces(pieces: tuple[Piece, ...], points: FloatArray, steps: int = 6) -> FloatArray:
    """Return ``points`` (N, 3) moved by Newton's method to where all ``pieces`` (two or three) are zero.

    Each step is the shortest one that solves the linearised equations: J^T (J J^T)^-1 applied to the values.
    """
    for _ in range(steps):
        if not len(points):
            break
        values = np.stack([piece(points) for piece in pieces], axis=1)
        slopes = np.stack([gradient(piece, points) for piece in pieces], axis=1)
        gram = slopes @ slopes.transpose(0, 2, 1) + 1e-12 * np.eye(len(pieces))
        points = points - (slopes.transpose(0, 2, 1) @ np.linalg.solve(gram, values[:, :, None]))[:, :, 0]
    return points


def find_sharp_curves(solid: Solid, near: FloatArray, step: float) -> list[SharpCurve]:
    """Trace every sharp edge of ``solid``.

    Args:
        solid: its pieces are examined in pairs.
        near: points spread densely over the surface, (N, 3), to start from.
        step: distance between traced points; edges shorter than this may be missed.

    Returns:
        The curves. Ends of different curves that meet in a corner agree exactly.
    """
    values = np.stack([np.abs(piece(near)) for piece in solid.pieces])
    curves: list[SharpCurve] = []
    corners = np.empty((0, 3))
    for first in range(len(solid.pieces)):
        for second in range(first + 1, len(solid.pieces)):
            pair = (solid.pieces[first], solid.pieces[second])
            close = np.flatnonzero((values[first] < 2 * step) & (values[second] < 2 * step))
            seeds = onto_pieces(pair, near[close])
            if len(seeds):
                seeds = seeds[
                    (np.sqrt(((seeds - near[close]) ** 2).sum(axis=1)) < 4 * step) & _is_sharp(solid, pair, seeds, 0.3 * step)
                ]
            while len(seeds):
                curve, corners = _traced(solid, pair, seeds[0], step, corners)
                if not any(_same_course(curve, other, step) for other in curves):
                    curves.append(curve)
                seeds = seeds[cKDTree(_densely(curve)).query(seeds)[0] > 1.5 * step]
    return curves


def _densely(curve: SharpCurve) -> FloatArray:
    closed = np.concatenate([curve.points, curve.points[:1]]) if curve.is_loop else curve.points
    middles = (closed[1:] + closed[:-1]) / 2
    return np.concatenate([closed, middles])


def _same_course(curve: SharpCurve, other: SharpCurve, step: float) -> bool:
    """Tell whether ``other`` runs along all of ``curve``, as it does when two pairs of pieces share one edge."""
    middles = (curve.points[1:] + curve.points[:-1]) / 2
    return bool(np.all(cKDTree(_densely(other)).query(middles)[0] < 0.6 * step))


def _frame(pair: tuple[Piece, Piece], points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit normals of both pieces and the cross product of them, each (N, 3)."""
    first, second = gradient(pair[0], points), gradient(pair[1], points)
    first = first / np.maximum(np.sqrt((first**2).sum(axis=1, keepdims=True)), 1e-12)
    second = second / np.maximum(np.sqrt((second**2).sum(axis=1, keepdims=True)), 1e-12)
    return first, second, np.cross(first, second)


def _is_sharp(solid: Solid, pair: tuple[Piece, Piece], points: FloatArray, offset: float) -> FloatArray:
    """Tell for each point on both pieces whether the solid has a sharp edge there, (N,) bool.

    Four half-surfaces leave such a point, two on each piece. The surface has an edge where it continues on one half of
    each piece, and none where it goes straight on along one of them.
    """
    first, second, tangent = _frame(pair, points)
    angle_sine = np.sqrt((tangent**2).sum(axis=1))
    sharp = (np.abs(solid.value(points)) < _ON_SURFACE) & (angle_sine > np.sin(_LEAST_ANGLE))
    tangent = tangent / np.maximum(angle_sine, 1e-12)[:, None]
    halves = []
    for piece, normal in zip(pair, (first, second), strict=True):
        sideways = np.cross(tangent, normal)
        for sign in (1.0, -1.0):
            beside = onto_pieces((piece,), points + sign * offset * sideways, steps=3)
            halves.append(np.abs(solid.value(beside)) < 1e-4 * offset)
    on_first, on_second = halves[0] ^ halves[1], halves[2] ^ halves[3]
    return sharp & on_first & on_second


def _traced(
    solid: Solid, pair: tuple[Piece, Piece], seed: FloatArray, step: float, corners: FloatArray
) -> tuple[SharpCurve, FloatArray]:
    forward, closes = _walk(solid, pair, seed, step, 1.0)
    if closes:
        return SharpCurve(np.stack(forward), pair, True), corners
    backward, _ = _walk(solid, pair, seed, step, -1.0)
    points = np.stack(backward[:0:-1] + forward)
    for end in (0, -1):
        corner = _corner(solid, pair, points[end], step)
        distances = np.sqrt(((corners - corner) ** 2).sum(axis=1))
        if len(corners) and distances.min() < 0.2 * step:
            corner = corners[np.argmin(distances)]
        else:
            corners = np.concatenate([corners, corner[None]])
        if np.sqrt(((points[end] - corner) ** 2).sum()) < 0.3 * step and len(points) > 2:
            points[end] = corner
        else:
            points = np.concatenate([corner[None], points] if end == 0 else [points, corner[None]])
    return SharpCurve(points, pair, False), corners


def _walk(solid: Solid, pair: tuple[Piece, Piece], seed: FloatArray, step: float, sign: float) -> tuple[list[FloatArray], bool]:
    """Follow the curve from ``seed`` until it ends or comes back; return its points and whether it came back."""
    points = [seed]
    heading: FloatArray | None = None
    while len(points) < 100_000:
        tangent = _frame(pair, points[-1][None])[2][0]
        tangent = tangent / np.sqrt((tangent**2).sum())
        tangent = sign * tangent if heading is None or (tangent * heading).sum() >= 0 else -tangent
        if heading is not None and (tangent * heading).sum() < 0:
            tangent = -tangent
        following = onto_pieces(pair, (points[-1] + step * tangent)[None], steps=4)
        if not _is_sharp(solid, pair, following, 0.05 * step)[0]:
            return points, False
        heading = following[0] - points[-1]
        if len(points) > 2 and np.sqrt(((following[0] - seed) ** 2).sum()) < 0.75 * step:
            return points, True
        points.append(following[0])
    return points, False


def _corner(solid: Solid, pair: tuple[Piece, Piece], end: FloatArray, step: float) -> FloatArray:
    """Return where the curve meets a third piece near its last traced point, or that point if it just fades out."""
    best, best_distance = end, 2.0 * step
    for piece in solid.pieces:
        if piece in pair:
            continue
        candidate = onto_pieces((*pair, piece), end[None])[0]
        distance = float(np.sqrt(((candidate - end) ** 2).sum()))
        on_all = max(abs(float(p(candidate[None])[0])) for p in (*pair, piece)) < 1e-9
        if on_all and distance < best_distance and abs(float(solid.value(candidate[None])[0])) < _ON_SURFACE:
            best, best_distance = candidate, distance
    return best
