"""Sparse operators on the vertex graph as torch tensors, and their product with a dense matrix."""

from __future__ import annotations

import warnings
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
    with_loops = adjacency(faces, n_vertices) + sparse.eye_array(n_vertices)
    scale = sparse.diags_array(1.0 / np.sqrt(with_loops.sum(axis=1)))
    return sparse.csr_array(scale @ with_loops @ scale)


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
