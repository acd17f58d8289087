"""Points on the surface of a solid: found on a grid, moved onto the surface, thinned to even spacing."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from dmp.mesh import FloatArray, IntArray
from dmp.shapes.solids import Piece, Solid, gradient

# Positions are rounded to this grid between steps. Otherwise the last bits, which differ between processors, grow
# over many steps until they change which points are joined, and a mesh could not be made twice.
_GRID = 2.0**-22


def snapped(points: FloatArray) -> FloatArray:
    """Return ``points`` rounded to a grid of 2^-22, so that last-bit differences between machines vanish."""
    return np.round(points / _GRID) * _GRID


def towards_surface(piece: Piece, points: FloatArray) -> FloatArray:
    """Return ``points`` after one Newton step along the gradient towards the zero set of ``piece``."""
    slope = gradient(piece, points)
    squared = np.maximum(slope[:, 0] ** 2 + slope[:, 1] ** 2 + slope[:, 2] ** 2, 1e-12)
    return points - slope * (piece(points) / squared)[:, None]


def active_pieces(solid: Solid, points: FloatArray) -> IntArray:
    """Return for each point the index of the piece that bounds the solid there, (N,): its value is that of the solid."""
    if len(solid.pieces) == 1:
        return np.zeros(len(points), dtype=np.int64)
    magnitude = np.abs(solid.value(points))
    misfit = np.stack([np.abs(np.abs(piece(points)) - magnitude) for piece in solid.pieces])
    return np.argmin(misfit, axis=0)


def project(solid: Solid, points: FloatArray, steps: int = 4) -> FloatArray:
    """Return ``points`` (N, 3) moved onto the surface of ``solid``, each along the gradient of the piece nearest to it."""
    for _ in range(steps):
        piece_index = active_pieces(solid, points)
        moved = points.copy()
        for index in np.unique(piece_index):
            rows = piece_index == index
            moved[rows] = towards_surface(solid.pieces[index], points[rows])
        points = moved
    return points


def grid_crossings(solid: Solid, extent: float, spacing: float) -> FloatArray:
    """Return where the lines of a grid cross the surface inside the cube [-extent, extent]^3, (N, 3).

    Only blocks of four cells whose centre is near the surface are looked into, so the cost grows with the surface.
    The offsets keep the grid off the faces of axis-parallel shapes.
    """
    block = 4 * spacing
    axis = np.arange(-extent + 0.137 * spacing, extent, block)
    centres = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3) + block / 2
    near = np.concatenate(
        [np.abs(solid.value(part)) < 1.5 * block for part in np.array_split(centres, len(centres) // 200_000 + 1)]
    )
    corner_offsets = np.stack(np.meshgrid(*[np.arange(5) * spacing - block / 2] * 3, indexing="ij"), axis=-1)
    found: list[FloatArray] = []
    near_centres = centres[near]
    for part in np.array_split(near_centres, len(near_centres) // 2_000 + 1):
        corners = part[:, None, None, None] + corner_offsets
        values = solid.value(corners.reshape(-1, 3)).reshape(corners.shape[:4])
        for direction in range(3):
            start = tuple(slice(None) if i == 0 else slice(0, 4) for i in range(4))
            end = tuple(slice(1, 5) if i == direction + 1 else s for i, s in enumerate(start))
            crossing = (values[start] < 0) != (values[end] < 0)
            low, high = values[start][crossing], values[end][crossing]
            share = (low / (low - high))[:, None]
            found.append(corners[start][crossing] * (1 - share) + corners[end][crossing] * share)
    return np.concatenate(found)


def surface_area(solid: Solid, crossings: FloatArray, spacing: float) -> float:
    """Estimate the area of the surface from its crossings with a grid of ``spacing``.

    Grid lines along x meet a patch of area A and unit normal n about A |n_x| / spacing^2 times, and so for y and z;
    each crossing therefore stands for the area spacing^2 / (|n_x| + |n_y| + |n_z|).
    """
    piece_index = active_pieces(solid, crossings)
    normals = np.empty_like(crossings)
    for index in np.unique(piece_index):
        rows = piece_index == index
        normals[rows] = gradient(solid.pieces[index], crossings[rows])
    lengths = np.sqrt((normals**2).sum(axis=1))
    return float((spacing**2 * lengths / np.abs(normals).sum(axis=1)).sum())


def thinned(candidates: FloatArray, radii: FloatArray, fixed: FloatArray, rng: np.random.Generator) -> IntArray:
    """Choose candidates, in random order, that keep their distance from ``fixed`` and from each other.

    Args:
        candidates: (N, 3).
        radii: least distance that each candidate asks for, (N,).
        fixed: points that are kept in any case, (M, 3).
        rng: gives the order.

    Returns:
        Indices of the chosen candidates in the order of choice.
    """
    tree = cKDTree(candidates)
    alive = np.ones(len(candidates), dtype=bool)
    if len(fixed):
        alive = cKDTree(fixed).query(candidates)[0] >= radii
    chosen: list[int] = []
    for index in rng.permutation(len(candidates)):
        if alive[index]:
            chosen.append(int(index))
            alive[tree.query_ball_point(candidates[index], radii[index])] = False
    return np.asarray(chosen, dtype=np.int64)
