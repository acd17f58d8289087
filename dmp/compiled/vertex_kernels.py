"""Kernels that move vertices after given normals of the faces again and again, and their derivatives.

A pass adds 1/N sum_f g_f n_f (n_f . (c_f - x)) over the N faces f around a vertex x, c_f their centroids. With x = x_0 + u that
is a + 1/N sum_f n_f h_f - M u, where a is what the first pass adds, M = 1/N sum_f g_f n_f n_f^T, and h_f = g_f n_f . (mean of u
at the corners). Moves are small beside positions, so little is lost to rounding however far from the origin a mesh lies.

The change of a pass is S x / N with S symmetric. So the gradient y of x, divided by N, goes back through the same passes
without a, and gradients of normals and gates are those of the sum of y^T S x over the passes.

Numbers of a vertex come in fours: three coordinates and a 0. Those of four faces come together: the first coordinates of their
normals, the second, the third, their gates. Memory is laid out for whole fours; faces that are none have gates of 0.

Every kernel takes a pointer to int64, see :mod:`dmp.compiled.phases`; its arguments are what its name says.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.kernel import kernel
from dmp.compiled.lanes import all4, coordinates, inlined, load4, number_at, spread, store4, turned
from dmp.compiled.normal_kernels import load_threes
from dmp.compiled.phases import next_part, part_is_done, share
from dmp.compiled.pointers import floats, numbers

_ZERO, _THIRD, _HALF = np.float32(0), np.float32(1 / 3), np.float32(0.5)


@inlined
def _place(face):
    """Return where the numbers of a face begin among fours of faces."""
    return 4 * (face & ~3) + (face & 3)


@inlined
def _pack_faces(normals, gates, packed, n_faces, first, last):
    for face in range(first, last, 4):
        at = 4 * face
        p, q, r, _ = load_threes(normals, face, n_faces)
        store4(packed, at, p)
        store4(packed, at + 4, q)
        store4(packed, at + 8, r)
        for k in range(4):
            packed[at + 12 + k] = gates[face + k] if face + k < n_faces else _ZERO


@inlined
def _pack_vertices(positions, faces, corners, starts, around, shares, out, first, last):
    """Write M, in three fours, and a for each vertex."""
    for v in range(first, last):
        xx = xy = xz = yy = yz = zz = a = b = c = _ZERO
        x, y, z = positions[3 * v], positions[3 * v + 1], positions[3 * v + 2]
        for k in range(starts[v], starts[v + 1]):
            at = _place(np.int64(around[k]))
            p, q, r, gate = faces[at], faces[at + 4], faces[at + 8], faces[at + 12]
            height = _ZERO
            for corner in range(at, at + 12, 4):
                other = 3 * (np.int64(corners[corner]) // 4)
                height += p * (positions[other] - x) + q * (positions[other + 1] - y) + r * (positions[other + 2] - z)
            height *= _THIRD * gate
            a, b, c = a + p * height, b + q * height, c + r * height
            p_gate, q_gate, r_gate = gate * p, gate * q, gate * r
            xx, xy, xz = xx + p_gate * p, xy + p_gate * q, xz + p_gate * r
            yy, yz, zz = yy + q_gate * q, yz + q_gate * r, zz + r_gate * r
        s = shares[v]
        store4(out, 16 * v, coordinates(s * xx, s * xy, s * xz))
        store4(out, 16 * v + 4, coordinates(s * xy, s * yy, s * yz))
        store4(out, 16 * v + 8, coordinates(s * xz, s * yz, s * zz))
        store4(out, 16 * v + 12, coordinates(s * a, s * b, s * c))


@inlined
def _corner(values, corners, at):
    """Return the coordinates of one corner of four faces."""
    x, y, z, _ = turned(
        load4(values, np.int64(corners[at])),
        load4(values, np.int64(corners[at + 1])),
        load4(values, np.int64(corners[at + 2])),
        load4(values, np.int64(corners[at + 3])),
    )
    return x, y, z


@inlined
def _store_along(out, at, p, q, r, height):
    """Write n_f h_f of four faces."""
    a, b, c, d = turned(p * height, q * height, r * height, all4(_ZERO))
    store4(out, at, a)
    store4(out, at + 4, b)
    store4(out, at + 8, c)
    store4(out, at + 12, d)


@inlined
def _to_faces(faces, corners, u, out, first, last):
    """Write n_f h_f."""
    for face in range(first, last, 4):
        at = 4 * face
        p, q, r, gate = load4(faces, at), load4(faces, at + 4), load4(faces, at + 8), load4(faces, at + 12)
        # Four by four the sums of the corners, then turned once.
        x, y, z, _ = turned(
            _sum_of_corners(u, corners, at),
            _sum_of_corners(u, corners, at + 1),
            _sum_of_corners(u, corners, at + 2),
            _sum_of_corners(u, corners, at + 3),
        )
        _store_along(out, at, p, q, r, (p * x + q * y + r * z) * (gate * all4(_THIRD)))


@inlined
def _sum_of_corners(u, corners, at):
    return load4(u, np.int64(corners[at])) + load4(u, np.int64(corners[at + 4])) + load4(u, np.int64(corners[at + 8]))


@inlined
def _change(vertices, along, starts, around, shares, x, y, z, v):
    """Return 1/N sum_f n_f h_f - M u at a vertex with u = (x, y, z)."""
    total = all4(_ZERO)
    for k in range(starts[v], starts[v + 1]):
        total = total + load4(along, 4 * np.int64(around[k]))
    lost = x * load4(vertices, 16 * v) + y * load4(vertices, 16 * v + 4) + z * load4(vertices, 16 * v + 8)
    return all4(shares[v]) * total - lost


@inlined
def _to_vertices(vertices, along, starts, around, shares, u, out, first, last):
    for v in range(first, last):
        value = load4(u, 4 * v)
        x, y, z, _ = spread(value)
        change = _change(vertices, along, starts, around, shares, x, y, z, v)
        store4(out, 4 * v, value + (change + load4(vertices, 16 * v + 12)))


@kernel
def follow(job):
    """Go through the passes.

    Arguments: positions (V, 3), normals (F, 3), gates (F,), corners in fours of faces, starts of the vertices' faces (V + 1,)
    and these faces, int32 all, shares 1/N (V,); places for fours of faces, M and a, n_f h_f, stages; output (V, 3); V, F,
    stages there are, bytes of a stage. Phases: two for each pass and 3. Pass p makes stage p + 1 of stage p, counted round the
    stages there are.
    """
    positions, normals, gates, corners = floats(job[5]), floats(job[6]), floats(job[7]), numbers(job[8])
    starts, around, shares = numbers(job[9]), numbers(job[10]), floats(job[11])
    faces, vertices, along, out = floats(job[12]), floats(job[13]), floats(job[14]), floats(job[16])
    n_vertices, n_faces, n_stages, stage_bytes = job[17], job[18], job[19], job[20]
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        first, last = share(part, job[1], n_faces)
        first_vertex, last_vertex = share(part, job[1], n_vertices)
        last_vertex = min(last_vertex, n_vertices)
        number = (phase - 2) // 2
        u = floats(job[15] + number % n_stages * stage_bytes)
        after = floats(job[15] + (number + 1) % n_stages * stage_bytes)
        if phase == 0:
            _pack_faces(normals, gates, faces, n_faces, first, last)
        elif phase == 1:
            _pack_vertices(positions, faces, corners, starts, around, shares, vertices, first_vertex, last_vertex)
            for v in range(first_vertex, last_vertex):
                store4(after, 4 * v, all4(_ZERO))
        elif phase == job[3] - 1:
            for v in range(first_vertex, last_vertex):
                for c in range(3):
                    out[3 * v + c] = positions[3 * v + c] + u[4 * v + c]
        elif phase % 2 == 0:
            _to_faces(faces, corners, u, along, first, last)
        else:
            _to_vertices(vertices, along, starts, around, shares, u, after, first_vertex, last_vertex)
        part_is_done(job)


@inlined
def _heights(p, q, r, a, b, c):
    """Return the heights of three corners over their mean, and this mean, for normals (p, q, r)."""
    one = p * a[0] + q * a[1] + r * a[2]
    two = p * b[0] + q * b[1] + r * b[2]
    three = p * c[0] + q * c[1] + r * c[2]
    mean = (one + two + three) * all4(_THIRD)
    return one - mean, two - mean, three - mean, mean


@inlined
def _bilinear(c, a, b, d, heights, e, f, g, others):
    """Return one coordinate of sum_c y_c h(x)_c + x_c h(y)_c for the corners a, b, d of y and e, f, g of x."""
    of_y = a[c] * heights[0] + b[c] * heights[1] + d[c] * heights[2]
    return of_y + (e[c] * others[0] + f[c] * others[1] + g[c] * others[2])


@inlined
def _back_to_faces(faces, corners, u, y, along, sums, first, last):
    """Write n_f h_f of y, and add what the pass at u gives for the normals."""
    for face in range(first, last, 4):
        at = 4 * face
        p, q, r, gate = load4(faces, at), load4(faces, at + 4), load4(faces, at + 8), load4(faces, at + 12)
        a, b, c = _corner(y, corners, at), _corner(y, corners, at + 4), _corner(y, corners, at + 8)
        one, two, three, mean = _heights(p, q, r, a, b, c)
        _store_along(along, at, p, q, r, mean * gate)
        d, e, f = _corner(u, corners, at), _corner(u, corners, at + 4), _corner(u, corners, at + 8)
        four, five, six, _ = _heights(p, q, r, d, e, f)
        of_y, of_u, k = (one, two, three), (four, five, six), 3 * face
        store4(sums, k, load4(sums, k) + _bilinear(0, a, b, c, of_u, d, e, f, of_y))
        store4(sums, k + 4, load4(sums, k + 4) + _bilinear(1, a, b, c, of_u, d, e, f, of_y))
        store4(sums, k + 8, load4(sums, k + 8) + _bilinear(2, a, b, c, of_u, d, e, f, of_y))


@inlined
def _back_to_vertices(vertices, along, starts, around, shares, y, out, total, first, last):
    for v in range(first, last):
        value = load4(y, 4 * v)
        p, q, r, _ = spread(value)
        store4(out, 4 * v, value + _change(vertices, along, starts, around, shares, p, q, r, v))
        store4(total, 4 * v, load4(total, 4 * v) + value)


@inlined
def _of_faces(faces, corners, positions, total, sums, of_normals, of_gates, n_faces, first, last):
    """Write the gradients of normals and gates: what the sums say, and what x_0 gives with the sum of y over the passes."""
    for face in range(first, last, 4):
        at, k = 4 * face, 3 * face
        p, q, r, gate = load4(faces, at), load4(faces, at + 4), load4(faces, at + 8), load4(faces, at + 12)
        a, b, c = _corner(total, corners, at), _corner(total, corners, at + 4), _corner(total, corners, at + 8)
        one, two, three, _ = _heights(p, q, r, a, b, c)
        zero = all4(_ZERO)
        # From the first corner, as the heights have no mean; so rounding does not know where the origin is.
        d, e, f = (zero, zero, zero), _edge(positions, corners, at, 4), _edge(positions, corners, at, 8)
        four, five, six, _ = _heights(p, q, r, d, e, f)
        of_y, of_x = (one, two, three), (four, five, six)
        x = load4(sums, k) + _bilinear(0, a, b, c, of_x, d, e, f, of_y)
        y = load4(sums, k + 4) + _bilinear(1, a, b, c, of_x, d, e, f, of_y)
        z = load4(sums, k + 8) + _bilinear(2, a, b, c, of_x, d, e, f, of_y)
        of_gate = (x * p + y * q + z * r) * all4(-_HALF)
        rows = turned(zero - x * gate, zero - y * gate, zero - z * gate, of_gate)
        _store_threes(of_normals, of_gates, rows, face, n_faces)


@inlined
def _store_threes(threes, ones, rows, first, count):
    for k in range(min(4, count - first)):
        row = rows[0] if k == 0 else (rows[1] if k == 1 else (rows[2] if k == 2 else rows[3]))
        at = first + k
        threes[3 * at], threes[3 * at + 1], threes[3 * at + 2] = number_at(row, 0), number_at(row, 1), number_at(row, 2)
        ones[at] = number_at(row, 3)


@inlined
def _edge(positions, corners, at, other):
    """Return the coordinates of the edges from the first corner of four faces to another one."""
    x, y, z, _ = turned(
        _difference(positions, corners, at, other),
        _difference(positions, corners, at + 1, other),
        _difference(positions, corners, at + 2, other),
        _difference(positions, corners, at + 3, other),
    )
    return x, y, z


@inlined
def _difference(positions, corners, at, other):
    a, b = 3 * (np.int64(corners[at]) // 4), 3 * (np.int64(corners[at + other]) // 4)
    return coordinates(
        positions[b] - positions[a], positions[b + 1] - positions[a + 1], positions[b + 2] - positions[a + 2]
    )  # fmt: skip


@kernel
def follow_backward(job):
    """Go back through the passes.

    Arguments: gradient (V, 3), positions (V, 3), corners in fours of faces, starts of the vertices' faces (V + 1,), these
    faces, shares 1/N (V,), fours of faces, M and a; places for n_f h_f, two times y in fours, their sum in fours, sums for the
    normals in three fours of faces; stages; outputs: of positions (V, 3), of normals (F, 3), of gates (F,); V, F, bytes of a
    stage. Phases: two for each pass and 2.
    """
    gradient, positions, corners, starts, around = (
        floats(job[5]),
        floats(job[6]),
        numbers(job[7]),
        numbers(job[8]),
        numbers(job[9]),
    )
    shares, faces, vertices, along = floats(job[10]), floats(job[11]), floats(job[12]), floats(job[13])
    total, sums = floats(job[16]), floats(job[17])
    of_positions, of_normals, of_gates = floats(job[19]), floats(job[20]), floats(job[21])
    n_vertices, n_faces, stage_bytes, passes = job[22], job[23], job[24], (job[3] - 2) // 2
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        first, last = share(part, job[1], n_faces)
        first_vertex, last_vertex = share(part, job[1], n_vertices)
        last_vertex = min(last_vertex, n_vertices)
        done = (phase - 1) // 2
        y, after = floats(job[14 + done % 2]), floats(job[15 - done % 2])
        if phase == 0:
            for v in range(first_vertex, last_vertex):
                s = all4(shares[v])
                store4(after, 4 * v, s * coordinates(gradient[3 * v], gradient[3 * v + 1], gradient[3 * v + 2]))
                store4(total, 4 * v, all4(_ZERO))
            for k in range(3 * first, 3 * last, 4):
                store4(sums, k, all4(_ZERO))
        elif phase == job[3] - 1:
            _of_faces(faces, corners, positions, total, sums, of_normals, of_gates, n_faces, first, last)
            for v in range(first_vertex, last_vertex):
                for c in range(3):
                    of_positions[3 * v + c] = y[4 * v + c] / shares[v]
        elif phase % 2 == 1:
            u = floats(job[18] + (passes - 1 - done) * stage_bytes)
            _back_to_faces(faces, corners, u, y, along, sums, first, last)
        else:
            _back_to_vertices(vertices, along, starts, around, shares, y, after, total, first_vertex, last_vertex)
        part_is_done(job)
