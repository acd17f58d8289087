"""Kernels that go through a layer in one sweep over the vertices, the product with its weights included.

For float32, and where :mod:`dmp.compiled.packed_weights` has a product. Rows are used while they are in the cache: each kind of
layer and each direction has a kernel that sweeps over parts of the rows and finishes a block as soon as the rows of all its
neighbours are there, and one, with the same arguments, that then finishes the blocks with neighbours in other parts.

A job is: number of the next part, number of parts; starts, columns and values of P; bounds, queue starts, queue and highest of
the sweep (for the second kernel: the blocks in place of the bounds); V; then addresses and sizes as each pair of kernels says.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

from dmp.compiled.kernel import kernel
from dmp.compiled.pointers import floats, multiply_rows, numbers, row_function, take_next
from dmp.compiled.stack_rows import ROWS, activate_rows, derive_rows, gather_rows, moments_rows, sums_rows

_SIZE = 4  # bytes of a float32


# -- forward ------------------------------------------------------------------------------------------------------


@row_function
def _gather_block(job, x, y, block, channels):
    first, last = block * ROWS, min(job[9], block * ROWS + ROWS)
    gather_rows(numbers(job[2]), numbers(job[3]), floats(job[4]), floats(x), floats(y), first, last, channels)


@row_function
def _moments_block(job, z, means, squares, block, channels):
    first, last = block * ROWS, min(job[9], block * ROWS + ROWS)
    place = _SIZE * block * channels
    moments_rows(floats(z), floats(means + place), floats(squares + place), first, last, channels)


@row_function
def _multiply_block(function, packed, x, y, block, n_in, n_out):
    # Always whole blocks, as the weights were packed for; there is room for them behind the last row.
    at = _SIZE * ROWS * block
    multiply_rows(function, ROWS, x + at * n_in, packed, y + at * n_out, n_in, n_out)


@row_function
def _finish_multiplied(job, block):
    _gather_block(job, job[17], job[18], block, job[22])
    _moments_block(job, job[18], job[19], job[20], block, job[22])


@kernel
def activate_multiply_gather(job):
    """The z before, mean, scale, beta, y before, function, weights, product, z, means, squares, in, out.

    A layer that multiplies first: y for the z before, its product with the weights, z = P times that, and the moments of z; see
    :func:`gather_multiplied`.
    """
    queue_starts, queue, highest = numbers(job[6]), numbers(job[7]), numbers(job[8])
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        bounds = numbers(job[5])
        k, end = queue_starts[part], bounds[part + 1]
        for row in range(bounds[part], end, ROWS):
            last = min(end, row + ROWS)
            activate_rows(
                floats(job[10]), floats(job[14]), floats(job[11]), floats(job[12]), floats(job[13]), row, last, job[21]
            )  # fmt: skip
            _multiply_block(job[15], job[16], job[14], job[17], row // ROWS, job[21], job[22])
            while k < queue_starts[part + 1] and highest[queue[k]] < last:
                _finish_multiplied(job, queue[k])
                k += 1


@kernel
def gather_multiplied(job):
    """The same for the blocks that are left: z and its moments."""
    blocks = numbers(job[5])
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        _finish_multiplied(job, blocks[part])


@row_function
def _finish_gathered(job, block):
    _gather_block(job, job[14], job[17], block, job[21])
    _multiply_block(job[15], job[16], job[17], job[18], block, job[21], job[22])
    _moments_block(job, job[18], job[19], job[20], block, job[22])


@kernel
def activate_gather_multiply(job):
    """The same arguments, with P y in place of the product.

    A layer that gathers first: y for the z before, P y, z = that times the weights, and the moments of z; see
    :func:`gather_and_multiply`.
    """
    queue_starts, queue, highest = numbers(job[6]), numbers(job[7]), numbers(job[8])
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        bounds = numbers(job[5])
        k, end = queue_starts[part], bounds[part + 1]
        for row in range(bounds[part], end, ROWS):
            last = min(end, row + ROWS)
            activate_rows(
                floats(job[10]), floats(job[14]), floats(job[11]), floats(job[12]), floats(job[13]), row, last, job[21]
            )  # fmt: skip
            while k < queue_starts[part + 1] and highest[queue[k]] < last:
                _finish_gathered(job, queue[k])
                k += 1


@kernel
def gather_and_multiply(job):
    """The same for the blocks that are left: P y, z, and its moments."""
    blocks = numbers(job[5])
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        _finish_gathered(job, blocks[part])


# -- backward -----------------------------------------------------------------------------------------------------


@row_function
def _sums_block(job, g, block, channels):
    first, last = block * ROWS, min(job[9], block * ROWS + ROWS)
    place = _SIZE * block * channels
    sums_rows(
        floats(g), floats(job[21]), floats(job[22]), floats(job[23]), floats(job[24]),
        floats(job[25] + place), floats(job[26] + place), first, last, channels,
    )  # fmt: skip


@row_function
def _derive_block(job, first, last):
    derive_rows(
        floats(job[10]), floats(job[11]), floats(job[12]), floats(job[13]), floats(job[14]), floats(job[15]), floats(job[16]),
        first, last, job[28],
    )  # fmt: skip


@row_function
def _finish_spread(job, block):
    _gather_block(job, job[10], job[19], block, job[28])
    _multiply_block(job[17], job[18], job[19], job[20], block, job[28], job[27])
    _sums_block(job, job[20], block, job[27])


@kernel
def derive_gather_multiply(job):
    """The g, z, mean, scale, beta, slope, constant; function, weights, P g; g and z before, mean, scale, beta; sums; in, out.

    Backward through a layer that multiplies first: the gradient of z over that of y, P times that, that times the transposed
    weights, which is the gradient of the y before, and its sums; see :func:`gather_multiply_sums`.
    """
    queue_starts, queue, highest = numbers(job[6]), numbers(job[7]), numbers(job[8])
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        bounds = numbers(job[5])
        k, end = queue_starts[part], bounds[part + 1]
        for row in range(bounds[part], end, ROWS):
            last = min(end, row + ROWS)
            _derive_block(job, row, last)
            while k < queue_starts[part + 1] and highest[queue[k]] < last:
                _finish_spread(job, queue[k])
                k += 1


@kernel
def gather_multiply_sums(job):
    """The same for the blocks that are left."""
    blocks = numbers(job[5])
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        _finish_spread(job, blocks[part])


@row_function
def _finish_back(job, block):
    _gather_block(job, job[19], job[20], block, job[27])
    _sums_block(job, job[20], block, job[27])


@kernel
def derive_multiply_gather(job):
    """The same arguments, with the product in place of P g.

    Backward through a layer that gathers first: the gradient of z over that of y, that times the transposed weights, P times
    that, which is the gradient of the y before, and its sums; see :func:`gather_sums_blocks`.
    """
    queue_starts, queue, highest = numbers(job[6]), numbers(job[7]), numbers(job[8])
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        bounds = numbers(job[5])
        k, end = queue_starts[part], bounds[part + 1]
        for row in range(bounds[part], end, ROWS):
            last = min(end, row + ROWS)
            _derive_block(job, row, last)
            _multiply_block(job[17], job[18], job[10], job[19], row // ROWS, job[28], job[27])
            while k < queue_starts[part + 1] and highest[queue[k]] < last:
                _finish_back(job, queue[k])
                k += 1


@kernel
def gather_sums_blocks(job):
    """The same for the blocks that are left."""
    blocks = numbers(job[5])
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        _finish_back(job, blocks[part])
