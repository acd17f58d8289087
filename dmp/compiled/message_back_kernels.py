"""Kernel of the derivatives of :mod:`dmp.compiled.message_kernels`.

It finds again what faces see, and keeps for each slot what goes back to the neighbour there: the gradient of the message before
silu, which is that of S as well, and those of normal, area and centroid. Each face then collects what came back to it.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.face_rows import (
    cross,
    fours_at,
    inner,
    position,
    scaled,
    store_pairs,
    vector_difference,
    vector_sum,
)
from dmp.compiled.kernel import kernel
from dmp.compiled.lanes import (
    all4,
    all12,
    coordinates,
    exponential,
    folded,
    inlined,
    larger,
    load4,
    load12,
    logistic,
    number_at,
    softplus,
    square_root,
    store4,
    store12,
    turned,
    where_larger,
)
from dmp.compiled.message_kernels import CHANNELS, LEAST_AREA_VECTOR, SEEN, before_silu, kept, neighbours, seen_by, sees
from dmp.compiled.phases import next_part, part_is_done
from dmp.compiled.pointers import doubles, floats, numbers

# Sums over faces are kept block by block and added up in a fixed order, so that none depends on how many threads there are.
BLOCK = 256
# Of the gradients of G, w, b, kappa; the last two are four numbers each that want adding up.
SUMS = SEEN * CHANNELS + CHANNELS + 8

_LEAST, _ONE, _ZERO, _THIRD = np.float32(LEAST_AREA_VECTOR), np.float32(1), np.float32(0), np.float32(1 / 3)
_A_TENTH, _TINY = np.float32(0.1), np.float32(1e-30)
_OF_WEIGHT, _OF_BIAS, _OF_KAPPA = SEEN * CHANNELS, SEEN * CHANNELS + CHANNELS, SEEN * CHANNELS + CHANNELS + 4


@inlined
def _add(values, at, more):
    store4(values, at, load4(values, at) + more)


@inlined
def _add_row(values, at, more):
    store12(values, at, load12(values, at) + more)


@inlined
def _message_back(both, geometry, weight, of_total, out, at, row, other, seen, counts, of_logit):
    """Write the gradient of a message before silu, and return it; and the gradient of w."""
    given = before_silu(both, geometry, row, other, seen)
    part = logistic(given)
    message = given * part
    gradient = all12(counts) * load12(of_total, CHANNELS * row) + all12(of_logit) * load12(weight, 0)
    gradient = gradient * (part + message * (all12(_ONE) - part))
    store12(out, at, gradient)
    return gradient, all12(of_logit) * message


@inlined
def _of_seen(k, geometry, sums, a, b, c, d, seen_a, seen_b, seen_c, seen_d):
    """Add to the gradient of a row of G what the messages a, b, c, d give; return the gradients of the numbers seen."""
    one = all12(seen_a[k]) * a + all12(seen_b[k]) * b
    other = all12(seen_c[k]) * c + all12(seen_d[k]) * d
    _add_row(sums, CHANNELS * k, one + other)
    row = load12(geometry, CHANNELS * k)
    return _added_up(folded(row * a), folded(row * b), folded(row * c), folded(row * d))


@inlined
def _to_own_row(of_both, face, slot, gradient, n_faces):
    """Add the gradient of a message to that of T, of which the first slot's is the first."""
    at = 2 * CHANNELS * face + CHANNELS
    if face < n_faces:
        store12(of_both, at, gradient if slot == 0 else load12(of_both, at) + gradient)


@inlined
def _added_up(a, b, c, d):
    p, q, r, s = turned(a, b, c, d)
    return (p + q) + (r + s)


@inlined
def _back(own, around, both, geometry, weight, kappa, over_level, sums, job, n_faces, n_padded, first, last):
    """Write what goes back from each slot, and what faces themselves get, the gradients of T among that."""
    signs, turns, logits, of_weights, of_total = (
        floats(job[13]),
        floats(job[14]),
        floats(job[15]),
        floats(job[16]),
        floats(job[17]),
    )
    of_messages, returned, of_own, of_both = floats(job[20]), floats(job[21]), floats(job[22]), floats(job[30])
    end, one, zero = n_faces - 1, all4(_ONE), all4(_ZERO)
    for face in range(first, last, 4):
        normal, _, centre, _ = kept(own, 8 * face, 8 * face + 8, 8 * face + 16, 8 * face + 24)
        of_normal, of_centre = (zero, zero, zero), (zero, zero, zero)
        for slot in range(3):
            at = slot * n_padded + face
            a, b, c, d = neighbours(around, 4 * face, slot)
            other_normal, area, other_centre, other_log = kept(own, 8 * a, 8 * b, 8 * c, 8 * d)
            turned_by, sign = load4(turns, at), load4(signs, at)
            seen, there, away = sees(normal, centre, other_normal, other_centre, other_log, turned_by, over_level)
            counts = larger(sign, zero - sign)
            # weight = softplus(logit) alike area sign
            logit, alike = load4(logits, at), exponential(kappa * (seen[0] - one))
            of_weight = fours_at(of_weights, slot * n_faces + face, n_faces - face) * sign
            soft = softplus(logit)
            of_logit = of_weight * alike * area * logistic(logit)
            of_power = of_weight * soft * area * alike
            of_area = of_weight * soft * alike
            _add(sums, _OF_BIAS, of_logit)
            _add(sums, _OF_KAPPA, of_power * (seen[0] - one))
            place, p, q, r, s = 36 * face + 12 * slot, seen_by(0, seen), seen_by(1, seen), seen_by(2, seen), seen_by(3, seen)
            k, m, n = min(face + 1, end), min(face + 2, end), min(face + 3, end)
            e, t = _message_back(
                both, geometry, weight, of_total, of_messages, place, face, a, p, number_at(counts, 0), number_at(of_logit, 0)
            )
            f, u = _message_back(
                both, geometry, weight, of_total, of_messages, place + 36, k, b, q, number_at(counts, 1), number_at(of_logit, 1)
            )
            g, v = _message_back(
                both, geometry, weight, of_total, of_messages, place + 72, m, c, r, number_at(counts, 2), number_at(of_logit, 2)
            )
            h, w = _message_back(
                both,
                geometry,
                weight,
                of_total,
                of_messages,
                place + 108,
                n,
                d,
                s,
                number_at(counts, 3),
                number_at(of_logit, 3),
            )
            _add_row(sums, _OF_WEIGHT, (t + u) + (v + w))
            _to_own_row(of_both, face, slot, e, n_faces)
            _to_own_row(of_both, face + 1, slot, f, n_faces)
            _to_own_row(of_both, face + 2, slot, g, n_faces)
            _to_own_row(of_both, face + 3, slot, h, n_faces)
            of_cosine = _of_seen(0, geometry, sums, e, f, g, h, p, q, r, s) + kappa * of_power
            of_distance = _of_seen(1, geometry, sums, e, f, g, h, p, q, r, s) / seen[1]
            of_height = _of_seen(2, geometry, sums, e, f, g, h, p, q, r, s) * over_level
            of_other_height = _of_seen(3, geometry, sums, e, f, g, h, p, q, r, s) * over_level
            of_area = of_area + _of_seen(4, geometry, sums, e, f, g, h, p, q, r, s) / (area + all4(_A_TENTH))
            of_there = vector_sum(scaled(normal, of_cosine), scaled(away, of_other_height))
            of_away = vector_sum(
                vector_sum(scaled(away, of_distance), scaled(normal, of_height)), scaled(there, of_other_height)
            )
            of_normal = vector_sum(of_normal, vector_sum(scaled(there, of_cosine), scaled(away, of_height)))
            of_centre = vector_difference(of_centre, of_away)
            x, y, z = scaled(of_there, turned_by)
            rows, others = turned(x, y, z, of_area), turned(of_away[0], of_away[1], of_away[2], zero)
            store_pairs(returned, 24 * face + 8 * slot, 24, rows, others)
        rows = turned(of_normal[0], of_normal[1], of_normal[2], zero)
        store_pairs(of_own, 8 * face, 8, rows, turned(of_centre[0], of_centre[1], of_centre[2], zero))


@inlined
def _returned(values, slots, face, width, c):
    """Return the sum of the fours at c of what came back to a face, which has ``width`` numbers a slot."""
    a, b, d = np.int64(slots[4 * face]), np.int64(slots[4 * face + 1]), np.int64(slots[4 * face + 2])
    return load4(values, width * a + c) + load4(values, width * b + c) + load4(values, width * d + c)


@inlined
def _of_rows(slots, of_messages, of_both, first, last):
    """Write the gradients of S."""
    for face in range(first, last):
        a, b, c = np.int64(slots[4 * face]), np.int64(slots[4 * face + 1]), np.int64(slots[4 * face + 2])
        total = load12(of_messages, CHANNELS * a) + load12(of_messages, CHANNELS * b) + load12(of_messages, CHANNELS * c)
        store12(of_both, 2 * CHANNELS * face, total)


@inlined
def _whole(of_own, returned, slots, k, c):
    return load4(of_own, 8 * k + c) + _returned(returned, slots, k, 8, c)


@inlined
def _given(values, k, n_faces):
    if k < n_faces:
        return coordinates(values[3 * k], values[3 * k + 1], values[3 * k + 2])
    return all4(_ZERO)


@inlined
def _of_corners(positions, corners, slots, of_normals, of_areas, of_own, returned, out, n_faces, first, last):
    """Write the gradients at the corners of the faces, a four each."""
    for face in range(first, last, 4):
        x, y, z, of_area = turned(
            _whole(of_own, returned, slots, face, 0),
            _whole(of_own, returned, slots, face + 1, 0),
            _whole(of_own, returned, slots, face + 2, 0),
            _whole(of_own, returned, slots, face + 3, 0),
        )
        p, q, r, _ = turned(
            _whole(of_own, returned, slots, face, 4),
            _whole(of_own, returned, slots, face + 1, 4),
            _whole(of_own, returned, slots, face + 2, 4),
            _whole(of_own, returned, slots, face + 3, 4),
        )
        u, v, w, _ = turned(
            _given(of_normals, face, n_faces),
            _given(of_normals, face + 1, n_faces),
            _given(of_normals, face + 2, n_faces),
            _given(of_normals, face + 3, n_faces),
        )
        at = 4 * face
        a, b, c = position(positions, 0, corners, at), position(positions, 1, corners, at), position(positions, 2, corners, at)
        one, other = vector_difference(b, a), vector_difference(c, a)
        vector, of_normal = cross(one, other), vector_sum((x, y, z), (u, v, w))
        length = square_root(inner(vector, vector))
        inverse = all4(_ONE) / larger(length, all4(_LEAST))
        of_length = of_area + fours_at(of_areas, face, n_faces - face) - inner(of_normal, vector) * (inverse * inverse)
        # Below the least length that counts as a constant.
        along = where_larger(all4(_LEAST), length, all4(_ZERO), of_length / larger(length, all4(_TINY)))
        of_vector = vector_sum(scaled(of_normal, inverse), scaled(vector, along))
        of_mean = scaled((p, q, r), all4(_THIRD))
        of_one, of_other = cross(other, of_vector), cross(of_vector, one)
        _store_corner(out, 12 * face, vector_difference(of_mean, vector_sum(of_one, of_other)))
        _store_corner(out, 12 * face + 4, vector_sum(of_mean, of_one))
        _store_corner(out, 12 * face + 8, vector_sum(of_mean, of_other))


@inlined
def _store_corner(out, at, vector):
    a, b, c, d = turned(vector[0], vector[1], vector[2], all4(_ZERO))
    store4(out, at, a)
    store4(out, at + 12, b)
    store4(out, at + 24, c)
    store4(out, at + 36, d)


@inlined
def _of_positions(starts, places, of_corners, out, first, last):
    for v in range(first, last):
        total = all4(_ZERO)
        for k in range(starts[v], starts[v + 1]):
            total = total + load4(of_corners, 4 * np.int64(places[k]))
        out[3 * v], out[3 * v + 1], out[3 * v + 2] = number_at(total, 0), number_at(total, 1), number_at(total, 2)


@inlined
def _join(sums, joined, out, n_blocks):
    """Write the gradients of G (60), w (12), b and kappa in a row, with the sums over the blocks in float64."""
    for k in range(SUMS):
        joined[k] = 0.0
    for block in range(n_blocks):
        for k in range(SUMS):
            joined[k] += sums[SUMS * block + k]
    for k in range(_OF_BIAS):
        out[k] = joined[k]
    for k in range(2):
        at = _OF_BIAS + 4 * k
        out[_OF_BIAS + k] = (joined[at] + joined[at + 1]) + (joined[at + 2] + joined[at + 3])


@kernel
def tell_backward(job):
    """Go back through :func:`dmp.compiled.message_kernels.tell`.

    Arguments: positions (V, 3), corners in fours of faces, fours around; S and T in a row (F, 24), G (5, 12), w (12,), three
    numbers: b, kappa and 1 / level; what is kept of faces; signs (3, n), signs that turn normals (3, n), logits (3, n);
    gradients: of weights (3, F), of sums of messages (F, 12), of normals (F, 3), of areas (F,); places: for gradients of
    messages (n, 3, 12), for what goes back (n, 3, 8), for what faces get themselves (n, 8), at corners (n, 3, 4); where back
    slots are (slot + 3 face), four numbers a face; starts of the vertices' corners (V + 1,), these corners (corner + 3 face);
    place for sums of blocks, and for them in float64; outputs: of positions (V, 3), of S and T (F, 24), of G, w, b, kappa
    (74,); F, n, V, blocks. Three phases.
    """
    positions, corners, around, both = floats(job[5]), numbers(job[6]), numbers(job[7]), floats(job[8])
    geometry, weight, three, own = floats(job[9]), floats(job[10]), floats(job[11]), floats(job[12])
    of_normals, of_areas, of_messages = floats(job[18]), floats(job[19]), floats(job[20])
    returned, of_own, of_corners, slots = floats(job[21]), floats(job[22]), floats(job[23]), numbers(job[24])
    starts, places, joined = numbers(job[25]), numbers(job[26]), doubles(job[28])
    of_positions, of_both, of_parameters = floats(job[29]), floats(job[30]), floats(job[31])
    n_faces, n_padded, n_vertices, n_blocks = job[32], job[33], job[34], job[35]
    kappa, over_level = all4(three[1]), all4(three[2])
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        first_block, last_block = part * n_blocks // job[1], (part + 1) * n_blocks // job[1]
        first, last = first_block * BLOCK, min(last_block * BLOCK, n_padded)
        if phase == 0:
            for block in range(first_block, last_block):
                sums = floats(job[27] + 4 * SUMS * block)
                for k in range(0, SUMS, 4):
                    store4(sums, k, all4(_ZERO))
                first, last = block * BLOCK, min((block + 1) * BLOCK, n_padded)
                _back(own, around, both, geometry, weight, kappa, over_level, sums, job, n_faces, n_padded, first, last)
        elif phase == 1:
            _of_rows(slots, of_messages, of_both, first, min(last, n_faces))
            _of_corners(positions, corners, slots, of_normals, of_areas, of_own, returned, of_corners, n_faces, first, last)
        else:
            first, last = part * n_vertices // job[1], (part + 1) * n_vertices // job[1]
            _of_positions(starts, places, of_corners, of_positions, first, last)
            if part == 0:
                _join(floats(job[27]), joined, of_parameters, n_blocks)
        part_is_done(job)
