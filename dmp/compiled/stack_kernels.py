"""Kernels of a graph convolution with batch normalisation and LeakyReLU, each as few passes over memory as the order allows.

Every kernel takes a pointer to int64: the number of the next part, the number of parts, then what its name says. Rows of arrays
are float32 or bfloat16, see :meth:`dmp.compiled.kernel.Kernel.of`; everything else is float32 or int32.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

from dmp.compiled import stack_rows
from dmp.compiled.kernel import kernel
from dmp.compiled.pointers import doubles, floats, numbers, row_function, take_next
from dmp.compiled.pointers import floats as rows
from dmp.compiled.stack_rows import ROWS, activate_rows, derive_rows, gather_rows, moments_rows, sums_rows


@row_function
def _rows_of_part(job, part, n_vertices):
    """Return the first row of a part, and the one after its last; parts are whole blocks."""
    blocks = (n_vertices + ROWS - 1) // ROWS
    return part * blocks // job[1] * ROWS, min(n_vertices, (part + 1) * blocks // job[1] * ROWS)


@kernel
def activate(job):
    """z, y, mean, scale, beta, V, C: write y for z."""
    z, y = rows(job[2]), rows(job[3])
    mean, scale, beta, n_vertices, channels = floats(job[4]), floats(job[5]), floats(job[6]), job[7], job[8]
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        first, last = _rows_of_part(job, part, n_vertices)
        activate_rows(z, y, mean, scale, beta, first, last, channels)


@kernel
def derive(job):
    """g, z, mean, scale, beta, slope, constant, V, C: write the gradient of z over that of y."""
    g, z = rows(job[2]), rows(job[3])
    mean, scale, beta, slope, constant = floats(job[4]), floats(job[5]), floats(job[6]), floats(job[7]), floats(job[8])
    n_vertices, channels = job[9], job[10]
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        first, last = _rows_of_part(job, part, n_vertices)
        derive_rows(g, z, g, mean, scale, beta, slope, constant, first, last, channels)


@kernel
def moments(job):
    """z, means, squares, V, C: write mean and sum of squared distances from it for each block, (blocks, C)."""
    z = rows(job[2])
    means, squares, n_vertices, channels = job[3], job[4], job[5], job[6]
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        first, last = _rows_of_part(job, part, n_vertices)
        for row in range(first, last, ROWS):
            place = 4 * (row // ROWS) * channels
            moments_rows(z, floats(means + place), floats(squares + place), row, min(last, row + ROWS), channels)


@kernel
def sums(job):
    """g, z, mean, scale, beta, plain, weighted, V, C: write the sums of each block, (blocks, C), for the gradient of y."""
    g, z = rows(job[2]), rows(job[3])
    mean, scale, beta, plain, weighted = floats(job[4]), floats(job[5]), floats(job[6]), job[7], job[8]
    n_vertices, channels = job[9], job[10]
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        first, last = _rows_of_part(job, part, n_vertices)
        for row in range(first, last, ROWS):
            place = 4 * (row // ROWS) * channels
            sums_rows(
                g, z, mean, scale, beta, floats(plain + place), floats(weighted + place), row, min(last, row + ROWS), channels
            )  # fmt: skip


@kernel
def gather(job):
    """x, y, starts, columns, values, blocks, number of blocks, V, C: write these blocks of P x to y."""
    x, y = rows(job[2]), rows(job[3])
    starts, columns, values, blocks = numbers(job[4]), numbers(job[5]), floats(job[6]), numbers(job[7])
    n_blocks, n_vertices, channels = job[8], job[9], job[10]
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        for k in range(part * n_blocks // job[1], (part + 1) * n_blocks // job[1]):
            first = blocks[k] * ROWS
            gather_rows(starts, columns, values, x, y, first, min(n_vertices, first + ROWS), channels)


@kernel
def gather_moments(job):
    """x, y, starts, columns, values, means, squares, V, C: write P x to y, and what :func:`moments` writes for y."""
    x, y = rows(job[2]), rows(job[3])
    starts, columns, values = numbers(job[4]), numbers(job[5]), floats(job[6])
    means, squares, n_vertices, channels = job[7], job[8], job[9], job[10]
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        first, end = _rows_of_part(job, part, n_vertices)
        for row in range(first, end, ROWS):
            last, place = min(end, row + ROWS), 4 * (row // ROWS) * channels
            gather_rows(starts, columns, values, x, y, row, last, channels)
            moments_rows(y, floats(means + place), floats(squares + place), row, last, channels)


@kernel
def gather_sums(job):
    """x, g, z, starts, columns, values, mean, scale, beta, plain, weighted, V, C: write P x to g, and its :func:`sums`."""
    x, g, z = rows(job[2]), rows(job[3]), rows(job[4])
    starts, columns, values = numbers(job[5]), numbers(job[6]), floats(job[7])
    mean, scale, beta, plain, weighted = floats(job[8]), floats(job[9]), floats(job[10]), job[11], job[12]
    n_vertices, channels = job[13], job[14]
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        first, end = _rows_of_part(job, part, n_vertices)
        for row in range(first, end, ROWS):
            last, place = min(end, row + ROWS), 4 * (row // ROWS) * channels
            gather_rows(starts, columns, values, x, g, row, last, channels)
            sums_rows(g, z, mean, scale, beta, floats(plain + place), floats(weighted + place), row, last, channels)


@kernel
def activate_gather(job):
    """z, y, out, starts, columns, values, bounds, queue starts, queue, highest, mean, scale, beta, C.

    Write y for z, and P y to ``out`` in all blocks of the queues, which have no neighbour outside their part.
    """
    z, y, gathered = rows(job[2]), rows(job[3]), rows(job[4])
    starts, columns, values = numbers(job[5]), numbers(job[6]), floats(job[7])
    bounds, queue_starts, queue, highest = numbers(job[8]), numbers(job[9]), numbers(job[10]), numbers(job[11])
    mean, scale, beta, channels = floats(job[12]), floats(job[13]), floats(job[14]), job[15]
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        end, k = bounds[part + 1], queue_starts[part]
        for row in range(bounds[part], end, ROWS):
            last = min(end, row + ROWS)
            activate_rows(z, y, mean, scale, beta, row, last, channels)
            # Blocks whose neighbours are all there: they are still in the cache.
            while k < queue_starts[part + 1] and highest[queue[k]] < last:
                first = queue[k] * ROWS
                gather_rows(starts, columns, values, y, gathered, first, min(end, first + ROWS), channels)
                k += 1


@kernel
def derive_gather(job):
    """g, z, out, starts, columns, values, bounds, queue starts, queue, highest, mean, scale, beta, slope, constant, C.

    Write the gradient of z over that of y, and P times it to ``out`` in all blocks of the queues.
    """
    g, z, gathered = rows(job[2]), rows(job[3]), rows(job[4])
    starts, columns, values = numbers(job[5]), numbers(job[6]), floats(job[7])
    bounds, queue_starts, queue, highest = numbers(job[8]), numbers(job[9]), numbers(job[10]), numbers(job[11])
    mean, scale, beta, slope, constant = floats(job[12]), floats(job[13]), floats(job[14]), floats(job[15]), floats(job[16])
    channels = job[17]
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        end, k = bounds[part + 1], queue_starts[part]
        for row in range(bounds[part], end, ROWS):
            last = min(end, row + ROWS)
            derive_rows(g, z, g, mean, scale, beta, slope, constant, row, last, channels)
            while k < queue_starts[part + 1] and highest[queue[k]] < last:
                first = queue[k] * ROWS
                gather_rows(starts, columns, values, g, gathered, first, min(end, first + ROWS), channels)
                k += 1


@kernel
def join_moments(job):
    """Means, squares, space (2, C) float64, mean, over_deviation, V, C: write the moments of all rows."""
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        stack_rows.join_moments(
            floats(job[2]), floats(job[3]), doubles(job[4]), floats(job[5]), floats(job[6]), job[7], ROWS, job[8],
            part * job[8] // job[1], (part + 1) * job[8] // job[1],
        )  # fmt: skip


@kernel
def join_sums(job):
    """Plain, weighted, space, over_deviation, scale, of gamma, of beta, slope, constant, V, C: add up sums of blocks."""
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        stack_rows.join_sums(
            floats(job[2]), floats(job[3]), doubles(job[4]), floats(job[5]), floats(job[6]), floats(job[7]), floats(job[8]),
            floats(job[9]), floats(job[10]), job[11], ROWS, job[12], part * job[12] // job[1], (part + 1) * job[12] // job[1],
        )  # fmt: skip
