"""What is done to some rows of a layer's arrays, inlined into the kernels.

A layer is z = P x W, u = gamma (z - mean) / deviation + beta, y = LeakyReLU(u); see :mod:`dmp.layers.gcn_stack`. Arrays are
pointers to float32 or bfloat16; ``first`` and ``last`` are the first row and the one after the last.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.pointers import row_function
from dmp.compiled.vectors import LANES, fetch_ahead, load, nothing, store, times, where_positive, wide

# Rows in a block, at most. Sums over vertices are kept block by block and added up in a fixed order, so that no moments depend
# on how many threads there are.
ROWS = 128
# Rows whose values for 16 channels are added up in registers; more would leave the first cache.
_ROWS_AT_ONCE = 8
# Values by which reading from memory is asked for in advance, which processors do within a page only.
_AHEAD = 2048
SLOPE = 0.01
EPSILON = 1e-5

_SLOPE, _ONE, _ZERO = np.float32(SLOPE), np.float32(1), np.float32(0)


@row_function
def _activate(z, y, mean, scale, beta, at, c):
    u = (load(z, at + c) - load(mean, c)) * load(scale, c) + load(beta, c)
    store(y, at + c, where_positive(u, u, _SLOPE))


@row_function
def activate_rows(z, y, mean, scale, beta, first, last, channels):
    """Write y for z."""
    strips = channels // LANES * LANES
    for at in range(first * channels, last * channels, channels):
        for c in range(0, strips, LANES):
            fetch_ahead(wide(z), at + c + _AHEAD)
            _activate(wide(z), wide(y), wide(mean), wide(scale), wide(beta), at, c)
        for c in range(strips, channels):
            _activate(z, y, mean, scale, beta, at, c)


@row_function
def _derive(g, z, out, mean, scale, beta, slope, constant, at, c):
    centred = load(z, at + c) - load(mean, c)
    of_u = where_positive(centred * load(scale, c) + load(beta, c), load(g, at + c), _SLOPE)
    store(out, at + c, of_u * load(scale, c) + (centred * load(slope, c) + load(constant, c)))


@row_function
def derive_rows(g, z, out, mean, scale, beta, slope, constant, first, last, channels):
    """Write the gradient of z to ``out`` for that of y, g; both may be in one place."""
    strips = channels // LANES * LANES
    for at in range(first * channels, last * channels, channels):
        for c in range(0, strips, LANES):
            fetch_ahead(wide(z), at + c + _AHEAD)
            fetch_ahead(wide(g), at + c + _AHEAD)
            _derive(
                wide(g), wide(z), wide(out), wide(mean), wide(scale), wide(beta), wide(slope), wide(constant), at, c
            )  # fmt: skip
        for c in range(strips, channels):
            _derive(g, z, out, mean, scale, beta, slope, constant, at, c)


@row_function
def _sum_of_seven(y, at, x, a, b, c, d, e, f, g, p, q, r, s, t, u, v, i):
    former = (times(p, load(x, a + i)) + times(q, load(x, b + i))) + (times(r, load(x, c + i)) + times(s, load(x, d + i)))
    latter = (times(t, load(x, e + i)) + times(u, load(x, f + i))) + times(v, load(x, g + i))
    store(y, at + i, former + latter)


@row_function
def _sum(columns, values, begin, end, y, at, x, channels, i):
    total = nothing(x)
    for k in range(begin, end):
        total = total + times(values[k], load(x, columns[k] * channels + i))
    store(y, at + i, total)


@row_function
def gather_rows(starts, columns, values, x, y, first, last, channels):
    """Write rows ``first`` to ``last`` of P x to y."""
    strips = channels // LANES * LANES
    for row in range(first, last):
        k, end = starts[row], starts[row + 1]
        at = row * channels
        # Itself and six neighbours, as most vertices have.
        if end - k == 7:
            a, b, c, d = columns[k] * channels, columns[k + 1] * channels, columns[k + 2] * channels, columns[k + 3] * channels
            e, f, g = columns[k + 4] * channels, columns[k + 5] * channels, columns[k + 6] * channels
            p, q, r, s, t, u, v = (
                values[k], values[k + 1], values[k + 2], values[k + 3], values[k + 4], values[k + 5], values[k + 6]
            )  # fmt: skip
            for i in range(0, strips, LANES):
                _sum_of_seven(wide(y), at, wide(x), a, b, c, d, e, f, g, p, q, r, s, t, u, v, i)
            for i in range(strips, channels):
                _sum_of_seven(y, at, x, a, b, c, d, e, f, g, p, q, r, s, t, u, v, i)
        else:
            for i in range(0, strips, LANES):
                _sum(columns, values, k, end, wide(y), at, wide(x), channels, i)
            for i in range(strips, channels):
                _sum(columns, values, k, end, y, at, x, channels, i)


@row_function
def _clear(sums, c):
    store(sums, c, nothing(sums))


@row_function
def _add_rows(z, sums, first, last, channels, c):
    total = load(sums, c)
    for at in range(first * channels, last * channels, channels):
        total = total + load(z, at + c)
    store(sums, c, total)


@row_function
def _add_squares(z, mean, squares, first, last, channels, c):
    middle, total = load(mean, c), load(squares, c)
    for at in range(first * channels, last * channels, channels):
        distance = load(z, at + c) - middle
        total = total + distance * distance
    store(squares, c, total)


@row_function
def moments_rows(z, mean, squares, first, last, channels):
    """Write the mean of rows and the sum of their squared distances from it, (C,) both."""
    strips = channels // LANES * LANES
    for c in range(channels):
        _clear(mean, c)
        _clear(squares, c)
    for begin in range(first, last, _ROWS_AT_ONCE):
        end = min(last, begin + _ROWS_AT_ONCE)
        for c in range(0, strips, LANES):
            _add_rows(wide(z), wide(mean), begin, end, channels, c)
        for c in range(strips, channels):
            _add_rows(z, mean, begin, end, channels, c)
    share = _ONE / np.float32(last - first)
    for c in range(channels):
        mean[c] *= share
    for begin in range(first, last, _ROWS_AT_ONCE):
        end = min(last, begin + _ROWS_AT_ONCE)
        for c in range(0, strips, LANES):
            _add_squares(wide(z), wide(mean), wide(squares), begin, end, channels, c)
        for c in range(strips, channels):
            _add_squares(z, mean, squares, begin, end, channels, c)


@row_function
def _add_sums(g, z, mean, scale, beta, plain, weighted, first, last, channels, c):
    middle, factor, constant = load(mean, c), load(scale, c), load(beta, c)
    total, total_weighted = load(plain, c), load(weighted, c)
    for at in range(first * channels, last * channels, channels):
        fetch_ahead(z, at + c + _ROWS_AT_ONCE * channels)
        centred = load(z, at + c) - middle
        of_u = where_positive(centred * factor + constant, load(g, at + c), _SLOPE)
        total = total + of_u
        total_weighted = total_weighted + of_u * centred
    store(plain, c, total)
    store(weighted, c, total_weighted)


@row_function
def sums_rows(g, z, mean, scale, beta, plain, weighted, first, last, channels):
    """Write the sums over rows of the gradient of u, and of that times z - mean, (C,) both, for that of y."""
    strips = channels // LANES * LANES
    for c in range(channels):
        _clear(plain, c)
        _clear(weighted, c)
    for begin in range(first, last, _ROWS_AT_ONCE):
        end = min(last, begin + _ROWS_AT_ONCE)
        for c in range(0, strips, LANES):
            _add_sums(
                wide(g), wide(z), wide(mean), wide(scale), wide(beta), wide(plain), wide(weighted), begin, end, channels, c
            )  # fmt: skip
        for c in range(strips, channels):
            _add_sums(g, z, mean, scale, beta, plain, weighted, begin, end, channels, c)


@row_function
def join_moments(means, squares, space, mean, over_deviation, n_vertices, rows, channels, first, last):
    """Write mean and 1 / deviation over all vertices of channels ``first`` to ``last``, for those of blocks of ``rows``.

    ``space`` is (2, C) float64.
    """
    for c in range(first, last):
        space[c], space[channels + c] = 0.0, 0.0
    for row in range(0, n_vertices, rows):
        share = np.float64(min(rows, n_vertices - row)) / n_vertices
        place = row // rows * channels
        for c in range(first, last):
            space[c] += share * means[place + c]
    for row in range(0, n_vertices, rows):
        share = np.float64(min(rows, n_vertices - row)) / n_vertices
        place = row // rows * channels
        for c in range(first, last):
            distance = means[place + c] - space[c]
            space[channels + c] += squares[place + c] / np.float64(n_vertices) + share * distance * distance
    for c in range(first, last):
        mean[c] = np.float32(space[c])
        over_deviation[c] = np.float32(1 / np.sqrt(space[channels + c] + EPSILON))


@row_function
def join_sums(
    plain, weighted, space, over_deviation, scale, of_gamma, of_beta, slope, constant, n_vertices, rows, channels, first, last
):
    """Add up the sums of blocks of so many ``rows`` for channels ``first`` to ``last``.

    From the sums come the gradients of gamma and beta, and the numbers with which the gradient of z is
    scale g + slope (z - mean) + constant for that of u, g (Ioffe & Szegedy 2015, section 3).
    """
    for c in range(first, last):
        space[c], space[channels + c] = 0.0, 0.0
    for row in range(0, n_vertices, rows):
        place = row // rows * channels
        for c in range(first, last):
            space[c] += plain[place + c]
            space[channels + c] += weighted[place + c]
    for c in range(first, last):
        with_deviation = space[channels + c] * over_deviation[c]
        of_beta[c], of_gamma[c] = np.float32(space[c]), np.float32(with_deviation)
        slope[c] = np.float32(-scale[c] * over_deviation[c] * with_deviation / n_vertices)
        constant[c] = np.float32(-scale[c] * space[c] / n_vertices)
