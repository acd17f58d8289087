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
