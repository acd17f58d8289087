"""What is done to some rows of a layer's arrays, inlined into the kernels.

A layer is z = P x W, u = gamma (z - mean) / deviation + beta, y = LeakyReLU(u); see :mod:`dmp.layers.gcn_stack`. Arrays are
pointers to float32 or bfloat16; ``first`` and ``last`` are the first row and the one after the last.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.pointers import load, row_function, store

# Rows in a block. Sums over vertices are kept block by block and added up in a fixed order, so that no result depends on how
# many threads there are.
ROWS = 64
SLOPE = 0.01
EPSILON = 1e-5

_SLOPE, _ONE, _ZERO = np.float32(SLOPE), np.float32(1), np.float32(0)


@row_function
def activate_rows(z, y, mean, scale, beta, first, last, channels):
    """Write y for z."""
    for at in range(first * channels, last * channels, channels):
        for c in range(channels):
            u = (load(z, at + c) - mean[c]) * scale[c] + beta[c]
            store(y, at + c, u if u > _ZERO else _SLOPE * u)


@row_function
def derive_rows(g, z, mean, scale, beta, slope, constant, first, last, channels):
    """Write the gradient of z over that of y."""
    for at in range(first * channels, last * channels, channels):
        for c in range(channels):
            centred = load(z, at + c) - mean[c]
            of_y = load(g, at + c)
            of_u = of_y if centred * scale[c] + beta[c] > _ZERO else _SLOPE * of_y
            store(g, at + c, of_u * scale[c] + (centred * slope[c] + constant[c]))


@row_function
def _sum_of_four(y, at, x, a, b, c, d, p, q, r, s, channels):
    for i in range(channels):
        store(y, at + i, (p * load(x, a + i) + q * load(x, b + i)) + (r * load(x, c + i) + s * load(x, d + i)))


@row_function
def _four_more(y, at, x, a, b, c, d, p, q, r, s, channels):
    for i in range(channels):
        more = (p * load(x, a + i) + q * load(x, b + i)) + (r * load(x, c + i) + s * load(x, d + i))
        store(y, at + i, load(y, at + i) + more)


@row_function
def _sum_of_seven(y, at, x, a, b, c, d, e, f, g, p, q, r, s, t, u, v, channels):
    for i in range(channels):
        former = (p * load(x, a + i) + q * load(x, b + i)) + (r * load(x, c + i) + s * load(x, d + i))
        store(y, at + i, former + ((t * load(x, e + i) + u * load(x, f + i)) + v * load(x, g + i)))


@row_function
def gather_rows(starts, columns, values, x, y, first, last, channels):
    """Write rows ``first`` to ``last`` of P x to y."""
    for row in range(first, last):
        k, end = starts[row], starts[row + 1]
        at = row * channels
        # Itself and six neighbours, as most vertices have.
        if end - k == 7:
            _sum_of_seven(
                y, at, x,
                columns[k] * channels, columns[k + 1] * channels, columns[k + 2] * channels, columns[k + 3] * channels,
                columns[k + 4] * channels, columns[k + 5] * channels, columns[k + 6] * channels,
                values[k], values[k + 1], values[k + 2], values[k + 3], values[k + 4], values[k + 5], values[k + 6],
                channels,
            )  # fmt: skip
            continue
        is_first = True
        while k < end:
            a, p = columns[k] * channels, values[k]
            # What is missing to four counts nothing.
            b, q, c, r, d, s = a, _ZERO, a, _ZERO, a, _ZERO
            if k + 1 < end:
                b, q = columns[k + 1] * channels, values[k + 1]
            if k + 2 < end:
                c, r = columns[k + 2] * channels, values[k + 2]
            if k + 3 < end:
                d, s = columns[k + 3] * channels, values[k + 3]
            if is_first:
                _sum_of_four(y, at, x, a, b, c, d, p, q, r, s, channels)
                is_first = False
            else:
                _four_more(y, at, x, a, b, c, d, p, q, r, s, channels)
            k += 4


@row_function
def moments_rows(z, mean, squares, first, last, channels):
    """Write the mean of rows and the sum of their squared distances from it, (C,) both."""
    for c in range(channels):
        mean[c], squares[c] = _ZERO, _ZERO
    for at in range(first * channels, last * channels, channels):
        for c in range(channels):
            mean[c] += load(z, at + c)
    share = _ONE / np.float32(last - first)
    for c in range(channels):
        mean[c] *= share
    for at in range(first * channels, last * channels, channels):
        for c in range(channels):
            distance = load(z, at + c) - mean[c]
            squares[c] += distance * distance


@row_function
def sums_rows(g, z, mean, scale, beta, plain, weighted, first, last, channels):
    """Write the sums over rows of the gradient of u, and of that times z - mean, (C,) both, for that of y."""
    for c in range(channels):
        plain[c], weighted[c] = _ZERO, _ZERO
    for at in range(first * channels, last * channels, channels):
        for c in range(channels):
            centred = load(z, at + c) - mean[c]
            of_y = load(g, at + c)
            of_u = of_y if centred * scale[c] + beta[c] > _ZERO else _SLOPE * of_y
            plain[c] += of_u
            weighted[c] += of_u * centred
