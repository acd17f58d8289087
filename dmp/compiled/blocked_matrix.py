"""A sparse matrix for the compiled kernels: its addresses, and which of its rows can be had early in a sweep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dmp.compiled.stack_rows import ROWS


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
    """

    bounds: NDArray[np.int32]
    queue_starts: NDArray[np.int32]
    queue: NDArray[np.int32]
    highest: NDArray[np.int32]
    others: NDArray[np.int32]

    @property
    def n_parts(self) -> int:
        """Number of parts."""
        return len(self.bounds) - 1


class BlockedMatrix:
    """A CSR matrix (V, V) with numbers of 32 bits, whose rows are worked on in blocks of 64."""

    def __init__(self, matrix: Tensor) -> None:
        self._starts = matrix.crow_indices().to(torch.int32).contiguous()
        self._columns = matrix.col_indices().to(torch.int32).contiguous()
        self._values = matrix.values().float().contiguous()
        self.n_rows = matrix.shape[0]
        self.n_blocks = -(-self.n_rows // ROWS)
        self.all_blocks = np.arange(self.n_blocks, dtype=np.int32)
        self._lowest, self._highest = self._reach()
        self._sweeps: dict[int, Sweep] = {}

    @property
    def addresses(self) -> tuple[int, int, int]:
        """Addresses of the row starts, the columns and the values."""
        return self._starts.data_ptr(), self._columns.data_ptr(), self._values.data_ptr()

    def sweep(self, threads: int) -> Sweep:
        """Return the division for so many threads; results are the same for all of them."""
        if threads not in self._sweeps:
            self._sweeps[threads] = self._divided(min(threads, self.n_blocks))
        return self._sweeps[threads]

    def _reach(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return the smallest and the largest column in each block; an empty block is given its own rows."""
        starts, columns = self._starts.numpy(), self._columns.numpy()
        first = self.all_blocks * ROWS
        lowest, highest = first.copy(), np.minimum(first + ROWS, self.n_rows).astype(np.int32) - 1
        entries = starts[np.append(first, self.n_rows)]
        filled = np.flatnonzero(np.diff(entries))
        if len(filled):
            lowest[filled] = np.minimum.reduceat(columns, entries[:-1][filled])
            highest[filled] = np.maximum.reduceat(columns, entries[:-1][filled])
        return lowest, highest

    def _divided(self, parts: int) -> Sweep:
        block_bounds = np.arange(parts + 1) * self.n_blocks // parts
        bounds = np.minimum(block_bounds * ROWS, self.n_rows).astype(np.int32)
        part_of_block = np.repeat(np.arange(parts), np.diff(block_bounds))
        is_inside = (self._lowest >= bounds[part_of_block]) & (self._highest < bounds[part_of_block + 1])
        inside = np.flatnonzero(is_inside)
        queue = inside[np.lexsort((self._highest[inside], part_of_block[inside]))].astype(np.int32)
        counts = np.bincount(part_of_block[inside], minlength=parts)
        return Sweep(
            bounds=bounds,
            queue_starts=np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
            queue=queue,
            highest=self._highest,
            others=np.flatnonzero(~is_inside).astype(np.int32),
        )
