"""A sparse matrix for the compiled kernels: its addresses, and which of its rows can be had early in a sweep."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dmp.compiled.stack_rows import ROWS

# Smaller blocks are multiplied more slowly, by more than is won with equal shares.
LEAST_ROWS = 112


def equal_blocks(n_vertices: int) -> int:
    """Return the rows of a block where blocks shall be full, and, if that can be, as many for each of two or four threads."""
    for shares in (4, 2, 1):
        blocks = -(-n_vertices // (ROWS * shares)) * shares
        rows = -(-n_vertices // blocks)
        if rows >= LEAST_ROWS:
            return rows
    return ROWS


@dataclass(frozen=True, eq=False)
class Sweep:
    """The rows of a matrix divided among threads.

    Within a part rows of the product are taken as soon as all that they need is there, while it is in the cache.

    Attributes:
        bounds: first row of each part, and the number of rows, (parts + 1,) int32.
        queue_starts: where the blocks of each part begin in ``queue``, (parts + 1,) int32.
        queue: blocks without neighbours outside their part, part by part, in the order in which their last neighbour comes.
        highest: largest column in each block, (blocks,) int32.
        others: all other blocks.
        other_starts: where those begin in ``others`` that each part is to finish, (parts + 1,) int32.
        n_slots: places for blocks of rows that are enough where a place is given to another block as soon as nothing more is
            wanted of the rows there.
        slots: the place of each block, (blocks,) int32.
        columns: the columns of the matrix, counted by these places, int32.
    """

    bounds: NDArray[np.int32]
    queue_starts: NDArray[np.int32]
    queue: NDArray[np.int32]
    highest: NDArray[np.int32]
    others: NDArray[np.int32]
    other_starts: NDArray[np.int32]
    n_slots: int
    slots: NDArray[np.int32]
    columns: NDArray[np.int32]

    @property
    def n_parts(self) -> int:
        """Number of parts."""
        return len(self.bounds) - 1


class BlockedMatrix:
    """A CSR matrix (V, V) with numbers of 32 bits, whose rows are worked on in blocks."""

    def __init__(self, matrix: Tensor, rows: int = ROWS) -> None:
        """Look at which rows ask for which, in blocks of so many ``rows``."""
        self.rows = rows
        self._starts = matrix.crow_indices().to(torch.int32).contiguous()
        self._columns = matrix.col_indices().to(torch.int32).contiguous()
        self._values = matrix.values().float().contiguous()
        self.n_rows = matrix.shape[0]
        self.n_blocks = -(-self.n_rows // rows)
        self.all_blocks = np.arange(self.n_blocks, dtype=np.int32)
        self._lowest, self._highest = self._reach()
        self._sweeps: dict[int, Sweep] = {}

    @property
    def addresses(self) -> tuple[int, int, int]:
        """Addresses of the row starts, the columns and the values."""
        return self._starts.data_ptr(), self._columns.data_ptr(), self._values.data_ptr()

    def sweep(self, threads: int) -> Sweep:
        """Return the division for so many threads."""
        if threads not in self._sweeps:
            self._sweeps[threads] = self._divided(min(threads, self.n_blocks))
        return self._sweeps[threads]

    def _reach(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return the smallest and the largest column in each block; an empty block is given its own rows."""
        starts, columns = self._starts.numpy(), self._columns.numpy()
        first = self.all_blocks * self.rows
        lowest, highest = first.copy(), np.minimum(first + self.rows, self.n_rows).astype(np.int32) - 1
        entries = starts[np.append(first, self.n_rows)]
        filled = np.flatnonzero(np.diff(entries))
        if len(filled):
            lowest[filled] = np.minimum.reduceat(columns, entries[:-1][filled])
            highest[filled] = np.maximum.reduceat(columns, entries[:-1][filled])
        return lowest, highest

    def _divided(self, parts: int) -> Sweep:
        block_bounds = np.arange(parts + 1) * self.n_blocks // parts
        bounds = np.minimum(block_bounds * self.rows, self.n_rows).astype(np.int32)
        part_of_block = np.repeat(np.arange(parts), np.diff(block_bounds))
        is_inside = (self._lowest >= bounds[part_of_block]) & (self._highest < bounds[part_of_block + 1])
        inside = np.flatnonzero(is_inside)
        queue = inside[np.lexsort((self._highest[inside], part_of_block[inside]))].astype(np.int32)
        counts = np.bincount(part_of_block[inside], minlength=parts)
        others = np.flatnonzero(~is_inside).astype(np.int32)
        queue_starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        slots, n_slots = self._slots(block_bounds, queue, others)
        columns = self._columns.numpy()
        return Sweep(
            bounds=bounds,
            queue_starts=queue_starts,
            queue=queue,
            highest=self._highest,
            others=others,
            other_starts=(np.arange(parts + 1) * len(others) // parts).astype(np.int32),
            n_slots=n_slots,
            slots=slots,
            columns=slots[columns // self.rows] * np.int32(self.rows) + columns % self.rows,
        )

    def _slots(self, block_bounds: NDArray[Any], queue: NDArray[Any], others: NDArray[Any]) -> tuple[NDArray[np.int32], int]:
        """Return a place for each block of rows, and the number of places."""
        first, last = self._lowest // self.rows, self._highest // self.rows
        # For each block that after whose beginning nothing more is wanted of it.
        wanted_until = self.all_blocks.copy()
        for block in queue:
            wanted = slice(first[block], last[block] + 1)
            wanted_until[wanted] = np.maximum(wanted_until[wanted], last[block])
        for block in others:
            wanted_until[first[block] : last[block] + 1] = self.n_blocks
        slots, n_slots = np.zeros(self.n_blocks, dtype=np.int32), 0
        for begin, end in pairwise(block_bounds):
            # The place left last is the one that is still in the cache.
            free: list[int] = []
            leaving: dict[int, list[int]] = defaultdict(list)
            for block in range(begin, end):
                if not free:
                    free.append(n_slots)
                    n_slots += 1
                slots[block] = free.pop()
                leaving[wanted_until[block]].append(slots[block])
                free += leaving.pop(block, [])
        return slots, n_slots
