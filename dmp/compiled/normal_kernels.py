"""Kernels that average the normals of the faces again and again, and their derivatives.

A pass makes s = w_0 x + w_1 x_1 + w_2 x_2 + w_3 x_3 of a face's own normal and those of its neighbours, and y = s / max(|s|, m)
of that. Numbers of a face come in fours: its weights (w_0, w_1, w_2, w_3); where its own four and those of its neighbours
begin; a normal, and behind it 1 / max(|s|, m) of the pass that made it, negative where that is 1 / m. Memory is laid out for
whole fours of faces; those that are none have weights of 0.

Every kernel takes a pointer to int64, see :mod:`dmp.compiled.phases`; its arguments are what its name says.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.kernel import kernel
from dmp.compiled.lanes import (
    all4,
    coordinates,
    inlined,
    larger,
    load4,
    spread,
    square_root,
    store4,
    turned,
    where_larger,
    with_fourth,
)  # fmt: skip
from dmp.compiled.phases import next_part, part_is_done, share
from dmp.compiled.pointers import floats, numbers

# Where the normals around a face point every way, their sum says little; it is divided by at least the first part of the sum of
# the weights, so that neither it nor its gradient grows without bound; and by the second at least.
LEAST_AGREEMENT, EPSILON = 0.1, 1e-8

_LEAST_AGREEMENT, _EPSILON = np.float32(LEAST_AGREEMENT), np.float32(EPSILON)
_ONE, _ZERO = np.float32(1), np.float32(0)


@inlined
def _store_four_fours(out, at, rows):
    a, b, c, d = rows
    store4(out, at, a)
    store4(out, at + 4, b)
    store4(out, at + 8, c)
    store4(out, at + 12, d)


@inlined
def load_threes(values, first, count):
    """Return the coordinates of four rows of an array (count, 3), each as a four; 0 behind its end."""
    zero = all4(_ZERO)
    k = 3 * first
    a, b, c, d = coordinates(values[k], values[k + 1], values[k + 2]), zero, zero, zero
    if first + 1 < count:
        b = coordinates(values[k + 3], values[k + 4], values[k + 5])
    if first + 2 < count:
        c = coordinates(values[k + 6], values[k + 7], values[k + 8])
    if first + 3 < count:
        d = coordinates(values[k + 9], values[k + 10], values[k + 11])
    return turned(a, b, c, d)


@inlined
def _pack_weights(own, weights, slots, packed, n_faces, first, last):
    for face in range(first, last):
        at = 4 * face
        if face < n_faces:
            packed[at], packed[at + 1] = own[face], weights[slots[face]]
            packed[at + 2], packed[at + 3] = weights[slots[n_faces + face]], weights[slots[2 * n_faces + face]]
        else:
            store4(packed, at, all4(_ZERO))


@inlined
def _weighted(values, around, weights, at):
    """Return the weighted sum of a face's own four and those of its neighbours."""
    one = all4(weights[at]) * load4(values, np.int64(around[at]))
    two = all4(weights[at + 1]) * load4(values, np.int64(around[at + 1]))
    three = all4(weights[at + 2]) * load4(values, np.int64(around[at + 2]))
    four = all4(weights[at + 3]) * load4(values, np.int64(around[at + 3]))
    return (one + two) + (three + four)


@inlined
def _four_weighted(values, around, weights, at):
    return (
        _weighted(values, around, weights, at),
        _weighted(values, around, weights, at + 4),
        _weighted(values, around, weights, at + 8),
        _weighted(values, around, weights, at + 12),
    )


@inlined
def _average(x, y, around, weights, least, first, last):
    for face in range(first, last, 4):
        at = 4 * face
        a, b, c, d = _four_weighted(x, around, weights, at)
        p, q, r, _ = turned(a, b, c, d)
        length, bound = square_root(p * p + q * q + r * r), load4(least, face)
        inverse = all4(_ONE) / larger(length, bound)
        e, f, g, h = spread(inverse)
        signed = where_larger(length, bound, inverse, all4(_ZERO) - inverse)
        _store_four_fours(y, at, with_fourth(a * e, b * f, c * g, d * h, signed))


@kernel
def average(job):
    """Go through the passes.

    Arguments: own weights (F,), weights of the neighbours (3, F), their slots in order (3, F) int32, normals (F, 3); places for
    fours of weights, m, stages; fours around; output (F, 3); F, stages there are, bytes of a stage. Phases: passes and 2. Pass
    p makes stage p + 1 of stage p, counted round the stages there are.
    """
    own, weights, slots, normals = floats(job[5]), floats(job[6]), numbers(job[7]), floats(job[8])
    packed, least, around, out = floats(job[9]), floats(job[10]), numbers(job[12]), floats(job[13])
    n_faces, n_stages, stage_bytes = job[14], job[15], job[16]
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        first, last = share(part, job[1], n_faces)
        x = floats(job[11] + (phase - 1) % n_stages * stage_bytes)
        y = floats(job[11] + phase % n_stages * stage_bytes)
        if phase == 0:
            _pack_weights(own, weights, slots, packed, n_faces, first, last)
            for face in range(first, last, 4):
                at = 4 * face
                a, b, c, d = turned(
                    load4(packed, at), load4(packed, at + 4), load4(packed, at + 8), load4(packed, at + 12)
                )  # fmt: skip
                zero = all4(_ZERO)
                sizes = larger(a, zero - a) + (larger(b, zero - b) + larger(c, zero - c) + larger(d, zero - d))
                store4(least, face, larger(all4(_LEAST_AGREEMENT) * sizes, all4(_EPSILON)))
                p, q, r, _ = load_threes(normals, face, n_faces)
                _store_four_fours(y, at, turned(p, q, r, zero))
        elif phase < job[3] - 1:
            _average(x, y, around, packed, least, first, last)
        else:
            for face in range(first, min(last, n_faces)):
                out[3 * face], out[3 * face + 1], out[3 * face + 2] = x[4 * face], x[4 * face + 1], x[4 * face + 2]
        part_is_done(job)


@inlined
def _of_sums(out, stage, gradient, at):
    """Write the gradient of s for that of y, (p, q, r), at four faces, with a 0 behind it."""
    x, y, z, inverse = turned(load4(stage, at), load4(stage, at + 4), load4(stage, at + 8), load4(stage, at + 12))
    p, q, r = gradient
    zero = all4(_ZERO)
    # Where |s| is less than m, this counts as a constant.
    along = where_larger(inverse, zero, x * p + y * q + z * r, zero)
    inverse = larger(inverse, zero - inverse)
    _store_four_fours(out, at, turned((p - x * along) * inverse, (q - y * along) * inverse, (r - z * along) * inverse, zero))


@inlined
def _of_weights(g, x, around, at):
    """Return the inner products of a face's gradient with its own normal and those of its neighbours."""
    own = load4(g, at)
    p, q, r, _ = turned(
        own * load4(x, np.int64(around[at])),
        own * load4(x, np.int64(around[at + 1])),
        own * load4(x, np.int64(around[at + 2])),
        own * load4(x, np.int64(around[at + 3])),
    )
    return p + q + r


@inlined
def _back(number, x, g, out, sums, around, weights, first, last):
    for face in range(first, last, 4):
        at = 4 * face
        for k in range(at, at + 16, 4):
            store4(sums, k, load4(sums, k) + _of_weights(g, x, around, k))
        a, b, c, d = _four_weighted(g, around, weights, at)
        if number == 0:
            _store_four_fours(out, at, (a, b, c, d))
        else:
            p, q, r, _ = turned(a, b, c, d)
            _of_sums(out, x, (p, q, r), at)


@kernel
def average_backward(job):
    """Go back through the passes.

    Arguments: gradient (F, 3), own weights (F,), weights of the neighbours (3, F), slots that lead back (3, F) int32; places
    for fours of weights, sums in fours, two gradients in fours; stages, fours around; outputs: of own weights, of those of the
    neighbours, of normals (F, 3); F, bytes of a stage. Phases: passes and 2.
    """
    gradient, own, weights, back, packed = floats(job[5]), floats(job[6]), floats(job[7]), numbers(job[8]), floats(job[9])
    sums, around = floats(job[10]), numbers(job[14])
    of_own, of_weights, of_normals = floats(job[15]), floats(job[16]), floats(job[17])
    n_faces, stage_bytes, passes = job[18], job[19], job[3] - 2
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        first, last = share(part, job[1], n_faces)
        # The pass that is gone back through; its gradient of s lies in one of two places.
        number = passes - phase
        stage = floats(job[13] + number * stage_bytes)
        g, out = floats(job[11 + phase % 2]), floats(job[12 - phase % 2])
        if phase == 0:
            _pack_weights(own, weights, back, packed, n_faces, first, last)
            for face in range(first, last, 4):
                p, q, r, _ = load_threes(gradient, face, n_faces)
                _of_sums(out, stage, (p, q, r), 4 * face)
                zero = all4(_ZERO)
                _store_four_fours(sums, 4 * face, (zero, zero, zero, zero))
        elif phase <= passes:
            _back(number, stage, g, out, sums, around, packed, first, last)
        else:
            for face in range(first, min(last, n_faces)):
                at = 4 * face
                of_own[face], of_weights[face] = sums[at], sums[at + 1]
                of_weights[n_faces + face], of_weights[2 * n_faces + face] = sums[at + 2], sums[at + 3]
                of_normals[3 * face], of_normals[3 * face + 1], of_normals[3 * face + 2] = g[at], g[at + 1], g[at + 2]
        part_is_done(job)
