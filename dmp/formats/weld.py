"""Joining positions that are exactly equal, for formats that repeat a vertex in each triangle or along seams."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dmp.mesh import IntArray

# An odd number without a pattern: 2^64 divided by the golden ratio, as in Knuth's multiplicative hashing.
_MIXER = np.uint64(0x9E3779B97F4A7C15)


def join_equal(positions: NDArray) -> tuple[IntArray, IntArray]:
    """Find rows that are exactly equal.

    Args:
        positions: (N, 3) float32 or float64, finite; 0 and -0 are equal.

    Returns:
        The first row of each kind in the order of their first appearance, (U,) int64, and for each row the number of
        its kind, (N,) int64, so that ``positions[first][kinds] == positions``.
    """
    if not len(positions):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    rows = positions + positions.dtype.type(0)  # -0 becomes 0, so that equal numbers have equal bytes
    order = _order_of_equals(rows)
    ordered = rows[order]
    is_first = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))
    representatives = np.minimum.reduceat(order, np.flatnonzero(is_first))
    ranks = np.empty(len(representatives), dtype=np.int64)
    ranks[np.argsort(representatives)] = np.arange(len(representatives))
    kinds = np.empty(len(rows), dtype=np.int64)
    kinds[order] = ranks[np.cumsum(is_first) - 1]
    return np.sort(representatives), kinds


def _order_of_equals(rows: NDArray) -> IntArray:
    """Return an order of the rows (N, 3) in which equal ones stand side by side."""
    bits = rows.view(np.uint32 if rows.dtype.itemsize == 4 else np.uint64)
    key = np.zeros(len(rows), dtype=np.uint64)
    for axis in range(3):  # sorting one number that mixes the coordinates is several times faster than sorting rows
        key = (key + bits[:, axis].astype(np.uint64)) * _MIXER
        key ^= key >> np.uint64(29)
    order = np.argsort(key)
    same_key = key[order][1:] == key[order][:-1]
    ordered = rows[order]
    if (same_key & (ordered[1:] != ordered[:-1]).any(axis=1)).any():
        order = np.lexsort(rows.T)
    return order
