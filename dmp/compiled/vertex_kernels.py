"""Kernels that move vertices after given normals of the faces again and again, and their derivatives.

A pass adds 1/N sum_f g_f n_f (n_f . (c_f - x)) over the N faces f around a vertex x, c_f their centroids. With x = x_0 + u that is
a + 1/N sum_f n_f h_f - M u, where a is the first pass's, M = 1/N sum_f g_f n_f n_f^T, and h_f = g_f n_f . (mean of u at the corners).
Moves are small beside positions, so little is lost to rounding however far from the origin a mesh lies.

The change of a pass is S x / N with S symmetric. So the gradient y of x, divided by N, goes back through the same passes without a,
and gradients of normals and gates are those of the sum of y^T S x over the passes.

Numbers of a vertex come in fours: three coordinates and a 0. Those of four faces come together: the first coordinates of their
normals, the second, the third, their gates. Memory is laid out for whole fours; faces that are none have gates of 0.

Every kernel takes a pointer to int64, see :mod:`dmp.compiled.phases`; its arguments are what its name says.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.kernel import kernel
from dmp.compiled.lanes import all4, coordinates, load4, spread, store4, turned
from dmp.compiled.normal_kernels import load_threes
from dmp.compiled.phases import next_part, part_is_done, share
from dmp.compiled.pointers import floats, numbers, row_function

_ONE, _ZERO, _THIRD, _HALF = np.float32(1), np.float32(0), np.float32(1 / 3), np.float32(0.5)


@row_function
def _place(face):
    """Return where the numbers of a face begin among fours of faces."""
    return 4 * (face & ~3) + (face & 3)


@row_function
def _pack_faces(normals, gates, packed, n_faces, first, last):
    for face in range(first, last, 4):
        at = 4 * face
        p, q, r, _ = load_threes(normals, face, n_faces)
        store4(packed, at, p)
        store4(packed, at + 4, q)
        store4(packed, at + 8, r)
        for k in range(4):
            packed[at + 12 + k] = gates[face + k] if face + k < n_faces else _ZERO


@row_function
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


@row_function
def _corner(values, corners, at):
    """Return the coordinates of one corner of four faces."""
    x, y, z, _ = turned(
        load4(values, np.int64(corners[at])),
        load4(values, np.int64(corners[at + 1])),
        load4(values, np.int64(corners[at + 2])),
        load4(values, np.int64(corners[at + 3])),
    )
    return x, y, z


@row_function
def _store_along(out, at, p, q, r, height):
    """Write n_f h_f of four faces."""
    a, b, c, d = turned(p * height, q * height, r * height, all4(_ZERO))
    store4(out, at, a)
    store4(out, at + 4, b)
    store4(out, at + 8, c)
    store4(out, at + 12, d)


@row_function
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


@row_function
def _sum_of_corners(u, corners, at):
    return load4(u, np.int64(corners[at])) + load4(u, np.int64(corners[at + 4])) + load4(u, np.int64(corners[at + 8]))


@row_function
def _change(vertices, along, starts, around, shares, x, y, z, v):
    """Return 1/N sum_f n_f h_f - M u at a vertex with u = (x, y, z)."""
    total = all4(_ZERO)
    for k in range(starts[v], starts[v + 1]):
        total = total + load4(along, 4 * np.int64(around[k]))
    lost = x * load4(vertices, 16 * v) + y * load4(vertices, 16 * v + 4) + z * load4(vertices, 16 * v + 8)
    return all4(shares[v]) * total - lost


@row_function
def _to_vertices(vertices, along, starts, around, shares, u, out, first, last):
    for v in range(first, last):
        value = load4(u, 4 * v)
        x, y, z, _ = spread(value)
        change = _change(vertices, along, starts, around, shares, x, y, z, v)
        store4(out, 4 * v, value + (change + load4(vertices, 16 * v + 12)))


@kernel
def follow(job):
    """Go through the passes.

    Arguments: positions (V, 3), normals (F, 3), gates (F,), corners in fours of faces, starts of the vertices' faces (V + 1,) and these
    faces, int32 all, shares 1/N (V,); places for fours of faces, M and a, n_f h_f, stages; output (V, 3); V, F, stages there are, bytes
    of a stage. Phases: two for each pass and 3. Pass p makes stage p + 1 of stage p, counted round the stages there are.
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


@row_function
def _along_normals(p, q, r, corner):
    return p * corner[0] + q * corner[1] + r * corner[2]


@row_function
def _add_to(sums, at, a, b, c, y, of_y):
    """Add to three fours of faces what three corners y give, times one number each: (C + C^T) n of the bilinear form of a pass."""
    for k in range(3):
        store4(sums, at + 4 * k, load4(sums, at + 4 * k) + (a[k] * of_y[0] + b[k] * of_y[1] + c[k] * of_y[2]))


@row_function
def _around_mean(a, b, c):
    mean = (a + b + c) * all4(_THIRD)
    return a - mean, b - mean, c - mean
