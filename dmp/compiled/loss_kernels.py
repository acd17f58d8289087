"""The loss of Deep Mesh Prior and its gradient in two passes over the vertices; see :mod:`dmp.losses` for the terms."""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from dmp.compiled.kernel import kernel
from dmp.compiled.phases import FIRST_ARGUMENT, next_part, part_is_done
from dmp.compiled.pointers import doubles, floats, numbers, row_function

# Vertices in a block. Sums are kept block by block and added up in a fixed order, so that no digit depends on the threads.
BLOCK = 512

# What stands where in a job: addresses, and at the end V and two choices. Positions q and their target y; A without its values,
# and the valence; m_i / N, m 1 for the N fitted vertices and 0 for others; both epsilons and lambda; then what is written:
# gradient, what goes to neighbours, sums of blocks (blocks, 2) float64, and total, data and Laplacian loss.
(
    _POSITIONS, _TARGET, _STARTS, _COLUMNS, _VALENCE, _SHARES, _CONSTANTS,
    _GRADIENT, _SPREAD, _SUMS, _LOSSES, _VERTICES, _OF_CHANGE, _IS_SUM,
) = range(FIRST_ARGUMENT, FIRST_ARGUMENT + 14)  # fmt: skip


@row_function
def _here(positions, target, of_change, at):
    """Return what the Laplacian is taken of: a coordinate, or its change."""
    return positions[at] - target[at] if of_change else positions[at]


@row_function
def _residuals(job, block):
    """Write the sums of both terms over a block, each vertex's own part of the gradient, and what it spreads."""
    positions, target, starts, columns = (
        floats(job[_POSITIONS]), floats(job[_TARGET]), numbers(job[_STARTS]), numbers(job[_COLUMNS])
    )  # fmt: skip
    valence, shares, constants = floats(job[_VALENCE]), floats(job[_SHARES]), floats(job[_CONSTANTS])
    gradient, spread, sums = floats(job[_GRADIENT]), floats(job[_SPREAD]), doubles(job[_SUMS])
    of_change, is_sum = job[_OF_CHANGE] != 0, job[_IS_SUM] != 0
    data = rough = 0.0
    for v in range(block * BLOCK, min(job[_VERTICES], block * BLOCK + BLOCK)):
        at = 3 * v
        a, b, c = positions[at] - target[at], positions[at + 1] - target[at + 1], positions[at + 2] - target[at + 2]
        length = np.sqrt(a * a + b * b + c * c + constants[0])
        data += np.float64(shares[v]) * length
        pull = shares[v] / length

        p = q = r = np.float32(0)
        for k in range(starts[v], starts[v + 1]):
            other = 3 * np.int64(columns[k])
            p += _here(positions, target, of_change, other)
            q += _here(positions, target, of_change, other + 1)
            r += _here(positions, target, of_change, other + 2)
        # Form "sum" is form "mean" times the valence.
        share, factor = np.float32(1) / valence[v], valence[v] if is_sum else np.float32(1)
        x = factor * (_here(positions, target, of_change, at) - share * p)
        y = factor * (_here(positions, target, of_change, at + 1) - share * q)
        z = factor * (_here(positions, target, of_change, at + 2) - share * r)
        length = np.sqrt(x * x + y * y + z * z + constants[1])
        rough += np.float64(length) / job[_VERTICES]
        push = factor * constants[2] / (length * np.float32(job[_VERTICES]))
        gradient[at], gradient[at + 1], gradient[at + 2] = pull * a + push * x, pull * b + push * y, pull * c + push * z
        push *= share
        spread[at], spread[at + 1], spread[at + 2] = push * x, push * y, push * z
    sums[2 * block], sums[2 * block + 1] = data, rough


@row_function
def _take_spread(job, block):
    """Add to the gradient of a block what comes from the neighbours."""
    starts, columns = numbers(job[_STARTS]), numbers(job[_COLUMNS])
    gradient, spread = floats(job[_GRADIENT]), floats(job[_SPREAD])
    for v in range(block * BLOCK, min(job[_VERTICES], block * BLOCK + BLOCK)):
        x = y = z = np.float32(0)
        for k in range(starts[v], starts[v + 1]):
            other = 3 * np.int64(columns[k])
            x, y, z = x + spread[other], y + spread[other + 1], z + spread[other + 2]
        gradient[3 * v] -= x
        gradient[3 * v + 1] -= y
        gradient[3 * v + 2] -= z


@row_function
def _add_up(job, blocks):
    sums, losses = doubles(job[_SUMS]), floats(job[_LOSSES])
    data = rough = 0.0
    for block in range(blocks):
        data += sums[2 * block]
        rough += sums[2 * block + 1]
    losses[0] = np.float32(data + np.float64(floats(job[_CONSTANTS])[2]) * rough)
    losses[1], losses[2] = np.float32(data), np.float32(rough)


@row_function
def losses_part(job, phase, part, parts):
    """Do one part of one of two phases: own parts, and what comes from neighbours."""
    blocks = (job[_VERTICES] + BLOCK - 1) // BLOCK
    for block in range(part * blocks // parts, (part + 1) * blocks // parts):
        if phase == 0:
            _residuals(job, block)
        else:
            _take_spread(job, block)
    if phase == 1 and part == 0:
        _add_up(job, blocks)


@kernel
def losses(job):
    """Two phases, see :func:`losses_part`."""
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        losses_part(job, phase, part, job[1])
        part_is_done(job)
