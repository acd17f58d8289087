"""What is done to pieces of the trained parameters and of their gradients, inlined into the kernels."""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.pointers import floats, row_function

# Addresses of a piece: parameter, gradient, both running means, count of steps; and its number of values.
PIECE_WORDS = 6
PIECE_BYTES = 8 * PIECE_WORDS
# The exponent of a float32 that is infinite or no number, as a whole number with all below it.
_NOT_FINITE = np.int32(0x7F800000)
_MAGNITUDE = np.int32(0x7FFFFFFF)


@row_function
def _step(parameter, gradient, mean, square, count, fresh, keep_square, fresh_square, step_size, root, epsilon):
    for i in range(count):
        g = gradient[i]
        m = mean[i] + fresh * (g - mean[i])
        v = square[i] * keep_square + fresh_square * g * g
        mean[i], square[i] = m, v
        parameter[i] += step_size * m / (np.sqrt(v) / root + epsilon)


@row_function
def adam_piece(piece, settings):
    """Do a step of Adam (Kingma & Ba 2015, algorithm 1) with a piece; settings are rate, both decays, epsilon."""
    steps = np.float64(floats(piece[4])[0])
    step_size, root = -settings[0] / (1 - settings[1] ** steps), np.sqrt(1 - settings[2] ** steps)
    _step(
        floats(piece[0]), floats(piece[1]), floats(piece[2]), floats(piece[3]), piece[5], np.float32(1 - settings[1]),
        np.float32(settings[2]), np.float32(1 - settings[2]), np.float32(step_size), np.float32(root), np.float32(settings[3]),
    )  # fmt: skip


@row_function
def has_a_bad_value(values, first, last):
    """Return whether any float32 from ``first`` to ``last`` is infinite or no number; ``values`` points to them as int32."""
    largest = np.int32(0)
    for i in range(first, last):
        largest = max(largest, values[i] & _MAGNITUDE)
    return largest >= _NOT_FINITE
