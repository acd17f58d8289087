"""Kernels for what a bilateral layer does to the features of a face between its dense products, and their derivatives.

With z = hidden W_1 + messages W_2 the first part is silu(z + b). With y the product of that, the second one is
r = hidden + y + c, n = (r - mean) / deviation over the channels, h = gamma n + beta; and of these new features the face's own
weight softplus(w . h + v) times its area and its gate 1 / (1 + exp(-(u . h + t))).

Faces are computed with in fours; behind the last one it stands for those that are none.

Every kernel takes a pointer to int64, see :mod:`dmp.compiled.phases`; its arguments are what its name says.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.face_rows import fours_at, store_some
from dmp.compiled.kernel import kernel
from dmp.compiled.lanes import (
    ROW,
    all4,
    all12,
    folded,
    inlined,
    load4,
    load12,
    logistic,
    number_at,
    softplus,
    square_root,
    store4,
    store12,
    turned,
)
from dmp.compiled.phases import next_part, part_is_done, share
from dmp.compiled.pointers import doubles, floats

# Channels of a face: two rows.
WIDTH = 2 * ROW
# Sums over faces are kept block by block and added up in a fixed order, so that none depends on how many threads there are.
BLOCK = 256
# Of the gradients of c, beta, gamma, w, u, and of v and t, four numbers each that want adding up; and of b alone.
SUMS, SUMS_OF_FIRST = 5 * WIDTH + 8, WIDTH
EPSILON = 1e-5

_ZERO, _ONE, _SHARE, _EPSILON = np.float32(0), np.float32(1), np.float32(1 / WIDTH), np.float32(EPSILON)


@inlined
def _activate(z, bias, out, at, c):
    x = load12(z, at + c) + load12(bias, c)
    store12(out, at + c, x * logistic(x))


@kernel
def activate(job):
    """Z (F, 24), b (24,), output (F, 24); F: write silu(z + b). One phase."""
    z, bias, out, n_faces = floats(job[5]), floats(job[6]), floats(job[7]), job[8]
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        first, last = share(part, job[1], n_faces)
        for face in range(first, min(last, n_faces)):
            _activate(z, bias, out, WIDTH * face, 0)
            _activate(z, bias, out, WIDTH * face, ROW)
        part_is_done(job)


@inlined
def _added_up(a, b, c, d):
    p, q, r, s = turned(a, b, c, d)
    return (p + q) + (r + s)


@inlined
def _residual(hidden, y, bias, at):
    one = load12(hidden, at) + (load12(y, at) + load12(bias, 0))
    return one, load12(hidden, at + ROW) + (load12(y, at + ROW) + load12(bias, ROW))


@inlined
def _folded(row):
    return folded(row[0]) + folded(row[1])


@inlined
def _centred(row, mean):
    return row[0] - all12(mean), row[1] - all12(mean)


@inlined
def _squares(row):
    return folded(row[0] * row[0]) + folded(row[1] * row[1])


@inlined
def _product(row, weights):
    return folded(row[0] * load12(weights, 0)) + folded(row[1] * load12(weights, ROW))


@inlined
def _features(normalised, gamma, beta):
    one = normalised[0] * load12(gamma, 0) + load12(beta, 0)
    return one, normalised[1] * load12(gamma, ROW) + load12(beta, ROW)


@inlined
def _store_row(out, at, row):
    store12(out, at, row[0])
    store12(out, at + ROW, row[1])


@inlined
def _load_row(values, at):
    return load12(values, at), load12(values, at + ROW)


@inlined
def _settle(row, mean, inverse, gamma, beta, normalised, out, at):
    """Write n and h of a face, and return h."""
    one = (row[0] - all12(mean)) * all12(inverse)
    other = (row[1] - all12(mean)) * all12(inverse)
    _store_row(normalised, at, (one, other))
    features = _features((one, other), gamma, beta)
    _store_row(out, at, features)
    return features


@kernel
def settle(job):
    """Find new features, weights and gates.

    Arguments: hidden (F, 24), y (F, 24), areas (F,); c, gamma, beta, w, u, (24,) each, two numbers v and t; places for n (F,
    24), and for 1 / deviation and the two products, (3, F made up to fours); outputs: h (F, 24), own weights (F,), gates (F,);
    F. One phase.
    """
    hidden, y, areas, bias, gamma, beta = (
        floats(job[5]),
        floats(job[6]),
        floats(job[7]),
        floats(job[8]),
        floats(job[9]),
        floats(job[10]),
    )
    w, u, two, normalised, kept = floats(job[11]), floats(job[12]), floats(job[13]), floats(job[14]), floats(job[15])
    out, own, gates, n_faces = floats(job[16]), floats(job[17]), floats(job[18]), job[19]
    end, n_padded = n_faces - 1, (n_faces + 3) // 4 * 4
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        first, last = share(part, job[1], n_faces)
        for face in range(first, last, 4):
            i, j = WIDTH * face, WIDTH * min(face + 1, end)
            k, m = WIDTH * min(face + 2, end), WIDTH * min(face + 3, end)
            a, b = _residual(hidden, y, bias, i), _residual(hidden, y, bias, j)
            c, d = _residual(hidden, y, bias, k), _residual(hidden, y, bias, m)
            mean = _added_up(_folded(a), _folded(b), _folded(c), _folded(d)) * all4(_SHARE)
            e, f, g, h = number_at(mean, 0), number_at(mean, 1), number_at(mean, 2), number_at(mean, 3)
            variance = _added_up(
                _squares(_centred(a, e)), _squares(_centred(b, f)), _squares(_centred(c, g)), _squares(_centred(d, h))
            )
            inverse = all4(_ONE) / square_root(variance * all4(_SHARE) + all4(_EPSILON))
            a = _settle(a, e, number_at(inverse, 0), gamma, beta, normalised, out, i)
            b = _settle(b, f, number_at(inverse, 1), gamma, beta, normalised, out, j)
            c = _settle(c, g, number_at(inverse, 2), gamma, beta, normalised, out, k)
            d = _settle(d, h, number_at(inverse, 3), gamma, beta, normalised, out, m)
            of_own = _added_up(_product(a, w), _product(b, w), _product(c, w), _product(d, w)) + all4(two[0])
            of_gate = _added_up(_product(a, u), _product(b, u), _product(c, u), _product(d, u)) + all4(two[1])
            store4(kept, face, inverse)
            store4(kept, n_padded + face, of_own)
            store4(kept, 2 * n_padded + face, of_gate)
            count = n_faces - face
            store_some(own, face, softplus(of_own) * fours_at(areas, face, count), count)
            store_some(gates, face, logistic(of_gate), count)
        part_is_done(job)


@inlined
def _add(sums, at, row):
    store12(sums, at, load12(sums, at) + row[0])
    store12(sums, at + ROW, load12(sums, at + ROW) + row[1])


@inlined
def _times(row, number):
    return row[0] * all12(number), row[1] * all12(number)


@inlined
def _by(row, other):
    return row[0] * other[0], row[1] * other[1]


@inlined
def _plus(row, other):
    return row[0] + other[0], row[1] + other[1]


@inlined
def _given(gradient, w, u, at, of_own, of_gate, counts):
    """Return the gradient of h of a face, ``counts`` times."""
    one = load12(gradient, at) * all12(counts) + (load12(w, 0) * all12(of_own) + load12(u, 0) * all12(of_gate))
    other = load12(gradient, at + ROW) * all12(counts)
    return one, other + (load12(w, ROW) * all12(of_own) + load12(u, ROW) * all12(of_gate))


@inlined
def _of_residual(of_normalised, normalised, mean, along, inverse):
    one = of_normalised[0] - all12(mean) - normalised[0] * all12(along)
    other = of_normalised[1] - all12(mean) - normalised[1] * all12(along)
    return one * all12(inverse), other * all12(inverse)


@inlined
def _settle_back(job, sums, n_faces, first, last):
    gradient, of_owns, of_gates = floats(job[5]), floats(job[6]), floats(job[7])
    areas, gamma, beta, w, u = floats(job[8]), floats(job[9]), floats(job[10]), floats(job[11]), floats(job[12])
    normalised, kept, out, of_areas = floats(job[13]), floats(job[14]), floats(job[15]), floats(job[16])
    end, n_padded = n_faces - 1, (n_faces + 3) // 4 * 4
    for face in range(first, last, 4):
        count = n_faces - face
        i, j = WIDTH * face, WIDTH * min(face + 1, end)
        k, m = WIDTH * min(face + 2, end), WIDTH * min(face + 3, end)
        inverse, own, gate = load4(kept, face), load4(kept, n_padded + face), logistic(load4(kept, 2 * n_padded + face))
        of_own = fours_at(of_owns, face, count)
        store_some(of_areas, face, of_own * softplus(own), count)
        of_own = of_own * fours_at(areas, face, count) * logistic(own)
        of_gate = fours_at(of_gates, face, count) * gate * (all4(_ONE) - gate)
        store4(sums, 5 * WIDTH, load4(sums, 5 * WIDTH) + of_own)
        store4(sums, 5 * WIDTH + 4, load4(sums, 5 * WIDTH + 4) + of_gate)
        one, two, three = _ONE if count > 1 else _ZERO, _ONE if count > 2 else _ZERO, _ONE if count > 3 else _ZERO
        a = _given(gradient, w, u, i, number_at(of_own, 0), number_at(of_gate, 0), _ONE)
        b = _given(gradient, w, u, j, number_at(of_own, 1), number_at(of_gate, 1), one)
        c = _given(gradient, w, u, k, number_at(of_own, 2), number_at(of_gate, 2), two)
        d = _given(gradient, w, u, m, number_at(of_own, 3), number_at(of_gate, 3), three)
        e, f, g, h = _load_row(normalised, i), _load_row(normalised, j), _load_row(normalised, k), _load_row(normalised, m)
        _add(sums, WIDTH, _plus(_plus(a, b), _plus(c, d)))
        _add(sums, 2 * WIDTH, _plus(_plus(_by(a, e), _by(b, f)), _plus(_by(c, g), _by(d, h))))
        p, q, r, s = _features(e, gamma, beta), _features(f, gamma, beta), _features(g, gamma, beta), _features(h, gamma, beta)
        _add(
            sums,
            3 * WIDTH,
            _plus(
                _plus(_times(p, number_at(of_own, 0)), _times(q, number_at(of_own, 1))),
                _plus(_times(r, number_at(of_own, 2)), _times(s, number_at(of_own, 3))),
            ),
        )
        _add(
            sums,
            4 * WIDTH,
            _plus(
                _plus(_times(p, number_at(of_gate, 0)), _times(q, number_at(of_gate, 1))),
                _plus(_times(r, number_at(of_gate, 2)), _times(s, number_at(of_gate, 3))),
            ),
        )
        scale = _load_row(gamma, 0)
        a, b, c, d = _by(a, scale), _by(b, scale), _by(c, scale), _by(d, scale)
        mean = _added_up(_folded(a), _folded(b), _folded(c), _folded(d)) * all4(_SHARE)
        along = _added_up(_folded(_by(a, e)), _folded(_by(b, f)), _folded(_by(c, g)), _folded(_by(d, h))) * all4(_SHARE)
        a = _of_residual(a, e, number_at(mean, 0), number_at(along, 0), number_at(inverse, 0))
        b = _of_residual(b, f, number_at(mean, 1), number_at(along, 1), number_at(inverse, 1))
        c = _of_residual(c, g, number_at(mean, 2), number_at(along, 2), number_at(inverse, 2))
        d = _of_residual(d, h, number_at(mean, 3), number_at(along, 3), number_at(inverse, 3))
        _add(sums, 0, _plus(_plus(a, b), _plus(c, d)))
        _store_row(out, i, a)
        if count > 1:
            _store_row(out, j, b)
        if count > 2:
            _store_row(out, k, c)
        if count > 3:
            _store_row(out, m, d)


@inlined
def _clear(sums, count):
    for k in range(0, count, 4):
        store4(sums, k, all4(_ZERO))


@inlined
def _join(sums, joined, count, n_blocks):
    """Add up the sums of the blocks in float64."""
    for k in range(count):
        joined[k] = 0.0
    for block in range(n_blocks):
        for k in range(count):
            joined[k] += sums[count * block + k]


@kernel
def settle_backward(job):
    """Go back through :func:`settle`.

    Arguments: gradients of h (F, 24), of own weights (F,), of gates (F,); areas (F,), gamma, beta, w, u; n, and what else was
    kept; outputs: of r (F, 24), of areas (F,); places for sums of blocks, and for them in float64; output: of c, beta, gamma,
    w, u, v, t in a row; F, blocks. Two phases.
    """
    joined, out, n_faces, n_blocks = doubles(job[18]), floats(job[19]), job[20], job[21]
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        if phase == 0:
            for block in range(part * n_blocks // job[1], (part + 1) * n_blocks // job[1]):
                sums = floats(job[17] + 4 * SUMS * block)
                _clear(sums, SUMS)
                _settle_back(job, sums, n_faces, BLOCK * block, min(BLOCK * (block + 1), n_faces))
        elif part == 0:
            _join(floats(job[17]), joined, SUMS, n_blocks)
            for k in range(5 * WIDTH):
                out[k] = joined[k]
            for k in range(2):
                at = 5 * WIDTH + 4 * k
                out[5 * WIDTH + k] = (joined[at] + joined[at + 1]) + (joined[at + 2] + joined[at + 3])
        part_is_done(job)


@inlined
def _activate_back(z, bias, gradient, sums, at, c):
    x = load12(z, at + c) + load12(bias, c)
    part = logistic(x)
    result = load12(gradient, at + c) * (part + x * part * (all12(_ONE) - part))
    store12(gradient, at + c, result)
    store12(sums, c, load12(sums, c) + result)


@kernel
def activate_backward(job):
    """Go back through :func:`activate`.

    Arguments: z (F, 24), b (24,); gradient (F, 24), which that of z is written over; places for sums of blocks, and for them in
    float64; output: of b (24,); F, blocks. Two phases.
    """
    z, bias, gradient, joined, out = floats(job[5]), floats(job[6]), floats(job[7]), doubles(job[9]), floats(job[10])
    n_faces, n_blocks = job[11], job[12]
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        if phase == 0:
            for block in range(part * n_blocks // job[1], (part + 1) * n_blocks // job[1]):
                sums = floats(job[8] + 4 * SUMS_OF_FIRST * block)
                _clear(sums, SUMS_OF_FIRST)
                for face in range(BLOCK * block, min(BLOCK * (block + 1), n_faces)):
                    _activate_back(z, bias, gradient, sums, WIDTH * face, 0)
                    _activate_back(z, bias, gradient, sums, WIDTH * face, ROW)
        elif part == 0:
            _join(floats(job[8]), joined, SUMS_OF_FIRST, n_blocks)
            for k in range(SUMS_OF_FIRST):
                out[k] = joined[k]
        part_is_done(job)
