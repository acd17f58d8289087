"""What is done with vectors of four faces at once, inlined into the kernels of a bilateral layer.

A vector is a tuple of three fours: first coordinates, second, third.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.lanes import coordinates, inlined, load4, number_at, store4, turned


@inlined
def cross(a, b):
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def inner(a, b):
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def vector_sum(a, b):
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def vector_difference(a, b):
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def scaled(a, factor):
    """Return a times a four."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@inlined
def position(positions, corner, places, at):
    """Return the coordinates of one corner of four faces from positions (V, 3)."""
    k = at + 4 * corner
    a, b, c, d = (
        3 * (np.int64(places[k]) // 4),
        3 * (np.int64(places[k + 1]) // 4),
        3 * (np.int64(places[k + 2]) // 4),
        3 * (np.int64(places[k + 3]) // 4),
    )
    x, y, z, _ = turned(
        three(positions, a), three(positions, b), three(positions, c), three(positions, d)
    )  # fmt: skip
    return x, y, z


@inlined
def three(values, at):
    """Return the three numbers from ``at`` on, and a 0."""
    return coordinates(values[at], values[at + 1], values[at + 2])


@inlined
def store_some(out, at, value, count):
    """Write the first ``count`` of four numbers."""
    if count >= 4:
        store4(out, at, value)
    else:
        for k in range(count):
            out[at + k] = number_at(value, k)


@inlined
def store_rows(out, width, at, rows, count):
    """Write the first ``width`` numbers of the first ``count`` of four rows."""
    for k in range(min(4, count)):
        row = rows[0] if k == 0 else (rows[1] if k == 1 else (rows[2] if k == 2 else rows[3]))
        for c in range(width):
            out[at + width * k + c] = number_at(row, c)


@inlined
def store_pairs(out, at, step, rows, others):
    """Write four rows of eight numbers, one every ``step`` numbers."""
    store4(out, at, rows[0])
    store4(out, at + 4, others[0])
    store4(out, at + step, rows[1])
    store4(out, at + step + 4, others[1])
    store4(out, at + 2 * step, rows[2])
    store4(out, at + 2 * step + 4, others[2])
    store4(out, at + 3 * step, rows[3])
    store4(out, at + 3 * step + 4, others[3])


@inlined
def fours_at(values, at, count):
    """Return the four numbers from ``at`` on, 0 for those that are not among the ``count`` that there are."""
    if count >= 4:
        return load4(values, at)
    a, b, c = values[at], values[at + 1] if count > 1 else np.float32(0), values[at + 2] if count > 2 else np.float32(0)
    return coordinates(a, b, c)
