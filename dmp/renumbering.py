"""An order of the vertices in which neighbours lie close together in memory."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import reverse_cuthill_mckee

from dmp.mesh import IntArray


def locality_order(neighbours: sparse.csr_array) -> IntArray:
    """Return the vertices of a graph in an order that keeps neighbours together (Cuthill & McKee 1969, reversed).

    A sparse product then finds in the processor's cache most of the rows that it gathers, however the file numbered them.

    Args:
        neighbours: adjacency, (V, V), symmetric.

    Returns:
        (V,) int64: the old number of each vertex by its new one.
    """
    # scipy's routine takes 32-bit numbers only.
    indices, starts = neighbours.indices.astype(np.int32), neighbours.indptr.astype(np.int32)
    graph = sparse.csr_matrix((neighbours.data, indices, starts), shape=neighbours.shape)
    return np.asarray(reverse_cuthill_mckee(graph, symmetric_mode=True), dtype=np.int64)


def inverse_of(order: IntArray) -> IntArray:
    """Return the new number of each vertex by its old one, (V,) int64."""
    inverse = np.empty_like(order)
    inverse[order] = np.arange(len(order))
    return inverse


def renumbered(matrix: sparse.csr_array, order: IntArray) -> sparse.csr_array:
    """Return the matrix (V, V) with rows and columns in another order, column numbers ascending in each row."""
    inverse = inverse_of(order)
    lengths = np.diff(matrix.indptr)[order]
    starts = np.concatenate([[0], np.cumsum(lengths)])
    # The place of each entry among the old ones: the start of its old row, and its rank in the row.
    places = np.repeat(matrix.indptr[order] - starts[:-1], lengths) + np.arange(starts[-1])
    result = sparse.csr_array((matrix.data[places], inverse[matrix.indices[places]], starts), shape=matrix.shape)
    result.sort_indices()
    return result
