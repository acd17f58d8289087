"""Kernel that multiplies up to four columns by one sparse matrix again and again.

It takes a pointer to int64, see :mod:`dmp.compiled.phases`; its arguments are what its name says.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.kernel import kernel
from dmp.compiled.lanes import all4, inlined, load4, store4
from dmp.compiled.phases import next_part, part_is_done, share
from dmp.compiled.pointers import floats, numbers

_ZERO = np.float32(0)


@inlined
def _multiply(starts, columns, values, x, y, first, last):
    for row in range(first, last):
        one = other = all4(_ZERO)
        k, end = np.int64(starts[row]), np.int64(starts[row + 1])
        # Two sums, neither of which waits for the other.
        while k + 1 < end:
            one = one + all4(values[k]) * load4(x, 4 * np.int64(columns[k]))
            other = other + all4(values[k + 1]) * load4(x, 4 * np.int64(columns[k + 1]))
            k += 2
        if k < end:
            one = one + all4(values[k]) * load4(x, 4 * np.int64(columns[k]))
        store4(y, 4 * row, one + other)


@kernel
def diffuse(job):
    """Write P^k x for some k.

    Arguments: row starts (V + 1,), columns, values of P; x (V, C); two places for fours; for each number of products k from 0
    on where its result goes among the outputs, or -1, int32; outputs (K, V, C); V, C. Phases: the largest k and 1.
    """
    starts, columns, values, given = numbers(job[5]), numbers(job[6]), floats(job[7]), floats(job[8])
    places, out, n_vertices, channels = numbers(job[11]), floats(job[12]), job[13], job[14]
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        first, last = share(part, job[1], n_vertices)
        last = min(last, n_vertices)
        x, y = floats(job[10 - phase % 2]), floats(job[9 + phase % 2])
        if phase == 0:
            for row in range(first, last):
                store4(y, 4 * row, all4(_ZERO))
                for c in range(channels):
                    y[4 * row + c] = given[channels * row + c]
        else:
            _multiply(starts, columns, values, x, y, first, last)
        if places[phase] >= 0:
            at = channels * n_vertices * np.int64(places[phase])
            for row in range(first, last):
                for c in range(channels):
                    out[at + channels * row + c] = y[4 * row + c]
        part_is_done(job)
