"""Kernels of what faces tell their neighbours in a bilateral layer, and its derivatives; see :mod:`dmp.recorrupted.bilateral`.

Of a face are kept: its normal and the length of its area vector, its centroid and the logarithm of that length + 0.1. What it sees of
the neighbour in a slot are five numbers: the cosine of the normals, the distance of the centroids, their difference along its own
normal and along the neighbour's, and the logarithm. The message is silu(S + T + G these), S of the neighbour and T its own; the
neighbour's weight softplus(w . message + b) exp(kappa (cosine - 1)) times its area and the sign of its orientation.

Memory is laid out for whole fours of faces; the signs of those that are none are 0, and rows of the last face stand for theirs.

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
    exponential,
    larger,
    load4,
    logarithm,
    logistic,
    number_at,
    softplus,
    square_root,
    store4,
    turned,
    where_larger,
)
from dmp.compiled.phases import next_part, part_is_done, share
from dmp.compiled.pointers import doubles, floats, numbers, row_function

# Channels of a message, and numbers that a face sees of a neighbour.
CHANNELS, SEEN = 12, 5
# Shorter area vectors make shorter normals, whose gradients stay bounded.
LEAST_AREA_VECTOR = 0.02
# Sums over faces are kept block by block and added up in a fixed order, so that no result depends on how many threads there are.
BLOCK = 256
# Of the gradients of G, w, b, kappa; the last two in fours.
SUMS = SEEN * CHANNELS + CHANNELS + 8

_LEAST, _ONE, _ZERO, _THIRD = np.float32(LEAST_AREA_VECTOR), np.float32(1), np.float32(0), np.float32(1 / 3)
_A_TENTH, _TINY = np.float32(0.1), np.float32(1e-12)


@row_function
def _rows_of_four(values, width, a, b, c, d):
    """Return the columns of four rows of fours, each of which begins ``width`` times a number."""
    return turned(load4(values, width * a), load4(values, width * b), load4(values, width * c), load4(values, width * d))


@row_function
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@row_function
def _inner(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@row_function
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@row_function
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@row_function
def _scaled(a, factor):
    return a[0] * factor, a[1] * factor, a[2] * factor


@row_function
def _position(positions, corner, places, at):
    """Return the coordinates of one corner of four faces from positions (V, 3)."""
    k = at + 4 * corner
    a, b, c, d = (
        3 * (np.int64(places[k]) // 4),
        3 * (np.int64(places[k + 1]) // 4),
        3 * (np.int64(places[k + 2]) // 4),
        3 * (np.int64(places[k + 3]) // 4),
    )
    x, y, z, _ = turned(
        _three(positions, a), _three(positions, b), _three(positions, c), _three(positions, d)
    )  # fmt: skip
    return x, y, z


@row_function
def _three(values, at):
    return coordinates(values[at], values[at + 1], values[at + 2])


@row_function
def _store_some(out, at, value, count):
    """Write the first ``count`` of four numbers."""
    if count >= 4:
        store4(out, at, value)
    else:
        for k in range(count):
            out[at + k] = number_at(value, k)


@row_function
def _store_rows(out, width, at, rows, count):
    """Write the first ``width`` numbers of the first ``count`` of four rows."""
    for k in range(min(4, count)):
        row = rows[0] if k == 0 else (rows[1] if k == 1 else (rows[2] if k == 2 else rows[3]))
        for c in range(width):
            out[at + width * k + c] = number_at(row, c)


@row_function
def _store_pairs(out, at, step, rows, others):
    """Write four rows of eight numbers, one every ``step`` numbers."""
    store4(out, at, rows[0])
    store4(out, at + 4, others[0])
    store4(out, at + step, rows[1])
    store4(out, at + step + 4, others[1])
    store4(out, at + 2 * step, rows[2])
    store4(out, at + 2 * step + 4, others[2])
    store4(out, at + 3 * step, rows[3])
    store4(out, at + 3 * step + 4, others[3])


@row_function
def _faces(positions, corners, own, normals, areas, n_faces, first, last):
    """Write what is kept of each face, its normal (F, 3), and the length of its area vector (F,)."""
    for face in range(first, last, 4):
        at = 4 * face
        a, b, c = _position(positions, 0, corners, at), _position(positions, 1, corners, at), _position(positions, 2, corners, at)
        vector = _cross(_minus(b, a), _minus(c, a))
        area = larger(square_root(_inner(vector, vector)), all4(_LEAST))
        normal = _scaled(vector, all4(_ONE) / area)
        # From the first corner on, which lets less be rounded.
        centre = _sum(a, _scaled(_sum(_minus(b, a), _minus(c, a)), all4(_THIRD)))
        rows = turned(normal[0], normal[1], normal[2], area)
        others = turned(centre[0], centre[1], centre[2], logarithm(area + all4(_A_TENTH)))
        _store_pairs(own, 8 * face, 8, rows, others)
        _store_rows(normals, 3, 3 * face, rows, n_faces - face)
        _store_some(areas, face, area, n_faces - face)


@row_function
def _own(own, face):
    """Return normals, lengths of area vectors, centroids and logarithms of four faces."""
    x, y, z, area = _rows_of_four(own, 8, face, face + 1, face + 2, face + 3)
    p, q, r, logarithms = _rows_of_four(floats_behind(own), 8, face, face + 1, face + 2, face + 3)
    return (x, y, z), area, (p, q, r), logarithms


@row_function
def _neighbours(own, around, at, slot):
    """Return the same of the neighbours in a slot of the four faces whose fours begin at ``at``."""
    k = at + 1 + slot
    # Where fours begin is told; of eight numbers it is twice as far.
    a, b, c, d = 2 * np.int64(around[k]), 2 * np.int64(around[k + 4]), 2 * np.int64(around[k + 8]), 2 * np.int64(around[k + 12])
    x, y, z, area = _rows_of_four(own, 1, a, b, c, d)
    p, q, r, logarithms = _rows_of_four(own, 1, a + 4, b + 4, c + 4, d + 4)
    return (x, y, z), area, (p, q, r), logarithms


@row_function
def _message(both, geometry, face, other, seen, c):
    """Return four channels of what goes from a neighbour to a face, before silu."""
    one = load4(both, 2 * CHANNELS * other + c) + load4(both, 2 * CHANNELS * face + CHANNELS + c)
    two = seen[0] * load4(geometry, c) + seen[1] * load4(geometry, CHANNELS + c)
    three = seen[2] * load4(geometry, 2 * CHANNELS + c) + seen[3] * load4(geometry, 3 * CHANNELS + c)
    return (one + seen[4] * load4(geometry, 4 * CHANNELS + c)) + (two + three)


@row_function
def _seen_by(face, a, b, c, d, e):
    """Return the five numbers that one of four faces sees, each four times."""
    return (
        all4(number_at(a, face)), all4(number_at(b, face)), all4(number_at(c, face)), all4(number_at(d, face)), all4(number_at(e, face))
    )  # fmt: skip


@row_function
def _tell(both, geometry, weight, total, face, other, seen, counts, is_first):
    """Add a message to the sum of the face's, ``counts`` times; return products with w, to be added up."""
    products = all4(_ZERO)
    for c in range(0, CHANNELS, 4):
        message = _message(both, geometry, face, other, seen, c)
        message = message * logistic(message)
        products = products + load4(weight, c) * message
        at, counted = CHANNELS * face + c, all4(counts) * message
        store4(total, at, counted if is_first else load4(total, at) + counted)
    return products


@row_function
def _sees(own_normal, own_centre, normal, centre, logarithms, seen_signs, over_level):
    """Return what four faces see of their neighbours in a slot, their difference, and the turned normals of the neighbours."""
    there, away = _scaled(normal, seen_signs), _minus(centre, own_centre)
    cosine, distance = _inner(there, own_normal), square_root(_inner(away, away) + all4(_TINY))
    return (
        cosine, distance, _inner(away, own_normal) * over_level, _inner(away, there) * over_level, logarithms, there, away
    )  # fmt: skip


@row_function
def _messages(own, around, both, parameters, signs, seen_signs, logits, weights, total, n_faces, n_padded, first, last):
    geometry, weight, bias, kappa, over_level = parameters
    for face in range(first, last, 4):
        at = 4 * face
        own_normal, _, own_centre, _ = _own(own, face)
        end = n_faces - 1
        for slot in range(3):
            normal, area, centre, logarithms = _neighbours(own, around, at, slot)
            sign = load4(signs, slot * n_padded + face)
            turned_by = load4(seen_signs, slot * n_padded + face)
            e, f, g, h, i, _, _ = _sees(own_normal, own_centre, normal, centre, logarithms, turned_by, over_level)
            k, is_first = at + 1 + slot, slot == 0
            counts = larger(sign, all4(_ZERO) - sign)
            products = turned(
                _tell(both, geometry, weight, total, face, np.int64(around[k]) // 4, _seen_by(0, e, f, g, h, i), number_at(counts, 0), is_first),
                _tell(both, geometry, weight, total, min(face + 1, end), np.int64(around[k + 4]) // 4, _seen_by(1, e, f, g, h, i), number_at(counts, 1), is_first),
                _tell(both, geometry, weight, total, min(face + 2, end), np.int64(around[k + 8]) // 4, _seen_by(2, e, f, g, h, i), number_at(counts, 2), is_first),
                _tell(both, geometry, weight, total, min(face + 3, end), np.int64(around[k + 12]) // 4, _seen_by(3, e, f, g, h, i), number_at(counts, 3), is_first),
            )
            logit = (products[0] + products[1]) + (products[2] + products[3]) + bias
            store4(logits, slot * n_padded + face, logit)
            value = softplus(logit) * exponential(kappa * (e - all4(_ONE))) * area * sign
            _store_some(weights, slot * n_faces + face, value, n_faces - face)
