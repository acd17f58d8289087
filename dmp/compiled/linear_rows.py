"""What is done beside products to some rows of the linear layers' arrays, inlined into the kernels."""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.pointers import row_function
from dmp.compiled.stack_rows import SLOPE
from dmp.compiled.vectors import LANES, load, nothing, store, where_positive, wide

_SLOPE = np.float32(SLOPE)


@row_function
def _leaky(x, bias, at, c):
    u = load(x, at + c) + load(bias, c)
    store(x, at + c, where_positive(u, u, _SLOPE))


@row_function
def leaky_rows(x, bias, rows, channels):
    """Write LeakyReLU(x + bias) to x."""
    strips = channels // LANES * LANES
    for at in range(0, rows * channels, channels):
        for c in range(0, strips, LANES):
            _leaky(wide(x), wide(bias), at, c)
        for c in range(strips, channels):
            _leaky(x, bias, at, c)


@row_function
def of_leaky_rows(gradient, y, rows, channels):
    """Write the gradient of u to ``gradient``, for that of y = LeakyReLU(u), whose sign is that of u."""
    values = rows * channels
    strips = values // LANES * LANES
    for i in range(0, strips, LANES):
        store(wide(gradient), i, where_positive(load(wide(y), i), load(wide(gradient), i), _SLOPE))
    for i in range(strips, values):
        store(gradient, i, where_positive(load(y, i), load(gradient, i), _SLOPE))


@row_function
def add_to_rows(x, bias, rows, channels):
    """Add ``bias`` to each row."""
    for at in range(0, rows * channels, channels):
        for c in range(channels):
            x[at + c] += bias[c]


@row_function
def _add_rows(x, sums, rows, channels, c):
    # Added up apart: a sum of all vertices' values, one by one, would lose digits.
    total = nothing(x)
    for at in range(0, rows * channels, channels):
        total = total + load(x, at + c)
    store(sums, c, load(sums, c) + total)


@row_function
def add_rows(x, sums, rows, channels):
    """Add the sum of the rows to ``sums``."""
    strips = channels // LANES * LANES
    for c in range(0, strips, LANES):
        _add_rows(wide(x), wide(sums), rows, channels, c)
    for c in range(strips, channels):
        _add_rows(x, sums, rows, channels, c)
