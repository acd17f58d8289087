"""Kernel of what faces tell their neighbours in a bilateral layer; see :mod:`dmp.recorrupted.bilateral`.

Of a face are kept, in two fours: its normal and the length of its area vector; its centroid and the logarithm of that length +
0.1. What it sees of the neighbour in a slot are five numbers: the cosine of the normals, the distance of the centroids, their
difference along its own normal and along the neighbour's, over the level of the noise, and the neighbour's logarithm. The
message from there is m = silu(S + T + G these), with S of the neighbour and T of its own; the neighbour's weight is softplus(w
. m + b) exp(kappa (cosine - 1)) times its area and the sign of its orientation.

Memory is laid out for whole fours of faces. The signs of those that are none are 0, and the last face's rows are read for them.

Every kernel takes a pointer to int64, see :mod:`dmp.compiled.phases`; its arguments are what its name says.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.face_rows import (
    cross,
    inner,
    position,
    scaled,
    store_pairs,
    store_rows,
    store_some,
    vector_difference,
    vector_sum,
)
from dmp.compiled.kernel import kernel
from dmp.compiled.lanes import (
    ROW,
    all4,
    all12,
    exponential,
    folded,
    inlined,
    larger,
    load4,
    load12,
    logarithm,
    logistic,
    number_at,
    softplus,
    square_root,
    store4,
    store12,
    turned,
)
from dmp.compiled.phases import next_part, part_is_done, share
from dmp.compiled.pointers import floats, numbers

# Channels of a message, and numbers that a face sees of a neighbour.
CHANNELS, SEEN = ROW, 5
# Shorter area vectors make shorter normals, whose gradients stay bounded.
LEAST_AREA_VECTOR = 0.02

_LEAST, _ONE, _ZERO, _THIRD = np.float32(LEAST_AREA_VECTOR), np.float32(1), np.float32(0), np.float32(1 / 3)
_A_TENTH, _TINY = np.float32(0.1), np.float32(1e-12)


@inlined
def kept(values, a, b, c, d):
    """Return normals, lengths of area vectors, centroids and logarithms of four faces, whose numbers begin at a, b, c, d."""
    x, y, z, area = turned(load4(values, a), load4(values, b), load4(values, c), load4(values, d))
    p, q, r, log = turned(load4(values, a + 4), load4(values, b + 4), load4(values, c + 4), load4(values, d + 4))
    return (x, y, z), area, (p, q, r), log


@inlined
def neighbours(around, at, slot):
    """Return the faces in a slot of the four faces whose own fours begin at ``at``."""
    k = at + 1 + slot
    return (
        np.int64(around[k]) // 4, np.int64(around[k + 4]) // 4, np.int64(around[k + 8]) // 4, np.int64(around[k + 12]) // 4
    )  # fmt: skip


@inlined
def sees(normal, centre, other_normal, other_centre, other_log, turned_by, over_level):
    """Return five fours that four faces see of their neighbours, and vectors: the neighbours' normals, and the way to them."""
    there, away = scaled(other_normal, turned_by), vector_difference(other_centre, centre)
    seen = (
        inner(there, normal),
        square_root(inner(away, away) + all4(_TINY)),
        inner(away, normal) * over_level,
        inner(away, there) * over_level,
        other_log,
    )
    return seen, there, away


@inlined
def seen_by(k, seen):
    """Return the five numbers that face ``k`` of four sees."""
    return (
        number_at(seen[0], k),
        number_at(seen[1], k),
        number_at(seen[2], k),
        number_at(seen[3], k),
        number_at(seen[4], k),
    )


@inlined
def before_silu(both, geometry, row, other, seen):
    """Return S + T + G seen for one face and its neighbour."""
    one = load12(both, 2 * CHANNELS * other) + load12(both, 2 * CHANNELS * row + CHANNELS)
    two = all12(seen[0]) * load12(geometry, 0) + all12(seen[1]) * load12(geometry, CHANNELS)
    three = all12(seen[2]) * load12(geometry, 2 * CHANNELS) + all12(seen[3]) * load12(geometry, 3 * CHANNELS)
    return (one + all12(seen[4]) * load12(geometry, 4 * CHANNELS)) + (two + three)


@inlined
def _faces(positions, corners, own, normals, areas, n_faces, first, last):
    """Write what is kept of each face, its normal (F, 3), and the length of its area vector (F,)."""
    for face in range(first, last, 4):
        at = 4 * face
        a, b, c = position(positions, 0, corners, at), position(positions, 1, corners, at), position(positions, 2, corners, at)
        one, other = vector_difference(b, a), vector_difference(c, a)
        vector = cross(one, other)
        area = larger(square_root(inner(vector, vector)), all4(_LEAST))
        normal = scaled(vector, all4(_ONE) / area)
        centre = vector_sum(a, scaled(vector_sum(one, other), all4(_THIRD)))
        rows = turned(normal[0], normal[1], normal[2], area)
        store_pairs(own, 8 * face, 8, rows, turned(centre[0], centre[1], centre[2], logarithm(area + all4(_A_TENTH))))
        store_rows(normals, 3, 3 * face, rows, n_faces - face)
        store_some(areas, face, area, n_faces - face)


@inlined
def _tell(both, geometry, weight, total, face, row, other, seen, counts, is_first):
    """Add a message, ``counts`` times, to the sum of those for the face; return its products with w, which want adding up."""
    message = before_silu(both, geometry, row, other, seen)
    message = message * logistic(message)
    counted = all12(counts) * message
    store12(total, CHANNELS * face, counted if is_first else load12(total, CHANNELS * face) + counted)
    return folded(load12(weight, 0) * message)


@inlined
def _messages(own, around, both, geometry, weight, bias, kappa, over_level, job, n_faces, n_padded, first, last):
    signs, turns, logits, weights, total = floats(job[13]), floats(job[14]), floats(job[15]), floats(job[16]), floats(job[17])
    end = n_faces - 1
    for face in range(first, last, 4):
        normal, _, centre, _ = kept(own, 8 * face, 8 * face + 8, 8 * face + 16, 8 * face + 24)
        for slot in range(3):
            at, is_first = slot * n_padded + face, slot == 0
            a, b, c, d = neighbours(around, 4 * face, slot)
            other_normal, area, other_centre, other_log = kept(own, 8 * a, 8 * b, 8 * c, 8 * d)
            seen, _, _ = sees(normal, centre, other_normal, other_centre, other_log, load4(turns, at), over_level)
            sign = load4(signs, at)
            counts = larger(sign, all4(_ZERO) - sign)
            p, q, r, s = seen_by(0, seen), seen_by(1, seen), seen_by(2, seen), seen_by(3, seen)
            row, number = min(face + 1, end), number_at(counts, 1)
            one = _tell(both, geometry, weight, total, face + 1, row, b, q, number, is_first)
            row, number = min(face + 2, end), number_at(counts, 2)
            two = _tell(both, geometry, weight, total, face + 2, row, c, r, number, is_first)
            row, number = min(face + 3, end), number_at(counts, 3)
            three = _tell(both, geometry, weight, total, face + 3, row, d, s, number, is_first)
            zero = _tell(both, geometry, weight, total, face, face, a, p, number_at(counts, 0), is_first)
            x, y, z, w = turned(zero, one, two, three)
            logit = ((x + y) + (z + w)) + bias
            store4(logits, at, logit)
            value = softplus(logit) * exponential(kappa * (seen[0] - all4(_ONE))) * area * sign
            store_some(weights, slot * n_faces + face, value, n_faces - face)


@kernel
def tell(job):
    """Find normals and areas, then messages and weights.

    Arguments: positions (V, 3), corners in fours of faces, fours around; S and T in a row (F, 24), G (5, 12), w (12,), three
    numbers: b, kappa and 1 / level; place for what is kept of faces (8 each); signs (3, n), signs that turn normals (3, n),
    place for logits (3, n), n the faces made up to fours; outputs: weights (3, F), sums of messages (n, 12), normals (F, 3),
    areas (F,); F, n. Two phases.
    """
    positions, corners, around, both = floats(job[5]), numbers(job[6]), numbers(job[7]), floats(job[8])
    geometry, weight, three, own = floats(job[9]), floats(job[10]), floats(job[11]), floats(job[12])
    bias, kappa, over_level = all4(three[0]), all4(three[1]), all4(three[2])
    n_faces, n_padded = job[20], job[21]
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        first, last = share(part, job[1], n_faces)
        if phase == 0:
            _faces(positions, corners, own, floats(job[18]), floats(job[19]), n_faces, first, last)
        else:
            _messages(own, around, both, geometry, weight, bias, kappa, over_level, job, n_faces, n_padded, first, last)
        part_is_done(job)
