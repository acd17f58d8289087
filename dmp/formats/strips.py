"""Triangle strips and fans, as several formats have them, unrolled into triangles."""

from __future__ import annotations

import numpy as np

from dmp.mesh import IntArray


def unroll_strips(indices: IntArray, counts: IntArray, *, separators: bool = False) -> tuple[IntArray, IntArray]:
    """Return the triangles of triangle strips.

    Every other triangle of a strip is turned round, so that all look the same way. Triangles that use an index twice only
    stitch strips together and are no part of the surface.

    Args:
        indices: vertex indices of all strips one after the other, (K,) int64.
        counts: indices of each strip, (S,) int64, with the sum K.
        separators: whether an index of -1 ends a strip and begins another one.

    Returns:
        The triangles (F, 3) int64, and for each of them the strip that it comes from, (F,) int64.
    """
    starts = np.zeros(len(indices), dtype=bool)
    starts[(np.cumsum(counts) - counts)[counts > 0]] = True
    is_separator = indices == -1 if separators else np.zeros(len(indices), dtype=bool)
    starts[1:] |= is_separator[:-1]
    position = np.arange(len(indices))
    since_start = position - np.maximum.accumulate(np.where(starts, position, 0))
    # A triangle ends at each index that is the third or later of its strip.
    last = np.flatnonzero((since_start >= 2) & ~is_separator)
    first, second = last - 2 + (since_start[last] % 2), last - 1 - (since_start[last] % 2)
    triangles = np.stack([indices[first], indices[second], indices[last]], axis=1)
    kept = ~_repeats(triangles)
    return triangles[kept], np.searchsorted(np.cumsum(counts), last[kept], side="right")


def unroll_fan(indices: IntArray) -> IntArray:
    """Return the triangles (F, 3) of one fan, (K,) indices with K > 1, all of which share the first index."""
    triangles = np.stack([np.full(max(len(indices) - 2, 0), indices[0]), indices[1:-1], indices[2:]], axis=1)
    return triangles[~_repeats(triangles)]


def _repeats(triangles: IntArray) -> np.ndarray:
    a, b, c = triangles.T
    return (a == b) | (b == c) | (c == a)
