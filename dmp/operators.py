"""Sparse operators on the vertex graph as torch tensors, and their product with a dense matrix."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from dmp.mesh import IntArray
from dmp.topology import adjacency


def normalised_adjacency(faces: IntArray, n_vertices: int) -> sparse.csr_array:
    """Return D^(-1/2) (A + I) D^(-1/2), D the degrees of A + I: the propagation of GCN (Kipf & Welling 2017, eq. 8).

    Returns:
        (V, V) float64, symmetric.
    """
    return normalised_with_loops(adjacency(faces, n_vertices))


def normalised_with_loops(neighbours: sparse.csr_array) -> sparse.csr_array:
    """Return D^(-1/2) (A + I) D^(-1/2) for A, (V, V) float64; see :func:`normalised_adjacency`."""
    result = sparse.csr_array(neighbours + sparse.eye_array(neighbours.shape[0]))
    scale = 1.0 / np.sqrt(result.sum(axis=1))
    result.data *= np.repeat(scale, np.diff(result.indptr)) * scale[result.indices]
    return result


def scaled_laplacian(faces: IntArray, n_vertices: int) -> sparse.csr_array:
    """Return -D^(-1/2) A D^(-1/2): the normalised Laplacian moved to eigenvalues between -1 and 1 (Defferrard et al. 2016).

    Returns:
        (V, V) float64, symmetric; rows of vertices without neighbours are 0.
    """
    neighbours = adjacency(faces, n_vertices)
    scale = sparse.diags_array(1.0 / np.sqrt(np.maximum(neighbours.sum(axis=1), 1.0)))
    return sparse.csr_array(-(scale @ neighbours @ scale))


def to_torch(matrix: sparse.csr_array, device: torch.device | str = "cpu") -> Tensor:
    """Return ``matrix`` as a float32 CSR tensor with 32-bit indices, which halve the index traffic of each product."""
    ordered = sparse.csr_array(matrix)
    ordered.sort_indices()
    with warnings.catch_warnings():
        # torch calls its CSR tensors a beta once a process; the product used here is covered by the tests.
        warnings.filterwarnings("ignore", message="Sparse CSR tensor support is in beta")
        return torch.sparse_csr_tensor(
            torch.from_numpy(ordered.indptr.astype(np.int32)),
            torch.from_numpy(ordered.indices.astype(np.int32)),
            torch.from_numpy(ordered.data.astype(np.float32)),
            size=ordered.shape,
            device=device,
            # The structure comes from scipy; checking it again would cost a device synchronisation.
            check_invariants=False,
        )


class _SymmetricProduct(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, matrix: Tensor, features: Tensor) -> Tensor:
        ctx.matrix = matrix
        return matrix @ features

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[None, Tensor]:
        # The matrix is its own transpose, so the backward product needs no second matrix.
        return None, ctx.matrix @ gradients[0].contiguous()


def symmetric_product(matrix: Tensor, features: Tensor) -> Tensor:
    """Return ``matrix @ features`` for a symmetric CSR matrix (V, V) and features (V, C).

    The same matrix serves the backward pass. Each output row is summed by one thread in a fixed order, so results
    repeat bit for bit.
    """
    return _SymmetricProduct.apply(matrix, features)  # type: ignore[no-untyped-call]


@dataclass(frozen=True, eq=False)
class EdgePattern:
    """Where a matrix on the directed edges i <- j of a graph has its entries: row i, column j, ordered by i, then j.

    Attributes:
        rows: row starts, (V + 1,) int32.
        columns: (E,) int32.
        reverse: for each edge i <- j the number of j <- i, (E,) int64.
    """

    rows: Tensor
    columns: Tensor
    reverse: Tensor

    @classmethod
    def of(cls, matrix: sparse.csr_array, device: torch.device | str = "cpu") -> EdgePattern:
        """Take the pattern of a matrix (V, V) that has an entry at (j, i) wherever it has one at (i, j)."""
        ordered = sparse.csr_array(matrix)
        ordered.sort_indices()
        numbered = sparse.csr_array((np.arange(ordered.nnz), ordered.indices, ordered.indptr), shape=ordered.shape)
        turned = sparse.csr_array(numbered.T)
        turned.sort_indices()
        tensor = to_torch(numbered, device)
        return cls(tensor.crow_indices(), tensor.col_indices(), torch.from_numpy(turned.data.astype(np.int64)).to(device))

    def matrix(self, entries: Tensor) -> Tensor:
        """Return the CSR matrix (V, V) with these entries (E,)."""
        size = (len(self.rows) - 1,) * 2
        return torch.sparse_csr_tensor(self.rows, self.columns, entries, size=size, check_invariants=False)


class _WeightedProduct(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, entries: Tensor, features: Tensor, pattern: EdgePattern) -> Tensor:
        ctx.pattern = pattern
        ctx.save_for_backward(entries, features)
        return pattern.matrix(entries) @ features

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        entries, features = ctx.saved_tensors
        pattern, gradient = ctx.pattern, gradients[0].contiguous()
        of_entries = of_features = None
        if ctx.needs_input_grad[0]:
            # The inner products of row i of the gradient and row j of the features, at the edges alone.
            sampled = torch.sparse.sampled_addmm(pattern.matrix(entries), gradient, features.T, beta=0.0)
            of_entries = sampled.values()
        if ctx.needs_input_grad[1]:
            of_features = pattern.matrix(entries.index_select(0, pattern.reverse)) @ gradient
        return of_entries, of_features, None


def weighted_product(entries: Tensor, features: Tensor, pattern: EdgePattern) -> Tensor:
    """Return the product of the matrix with these entries (E,) and features (V, C), differentiable in both.

    Nothing larger than entries and features is made on the way, and each sum runs in a fixed order, so that results repeat
    bit for bit.
    """
    return _WeightedProduct.apply(entries, features, pattern)  # type: ignore[no-untyped-call]
