"""The network on the whole mesh, whose gradient is found patch by patch.

Forward all layers run on the whole mesh, which tells the output and what batch normalisation needs: mean and deviation of each
channel over all vertices. Nothing else is kept. Backward each patch, with a halo as many edges wide as there are layers, runs
forward again with these moments, and then backward from the gradient of its core.

So output and loss are those of a training on the whole mesh, and no border of a patch shows. The gradient differs in one thing:
how the moments change with the weights is counted with the means over a patch in place of those over the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from dmp.layers.gcn_stack import Moments
from dmp.layers.stack_buffers import StackBuffers
from dmp.mesh import FloatArray
from dmp.network import DisplacementNetwork
from dmp.operators import to_torch
from dmp.patches.partition import partition
from dmp.patches.whole_pass import WholePass


@dataclass(frozen=True, eq=False)
class _Piece:
    vertices: Tensor
    core: Tensor
    propagation: Tensor
    buffers: StackBuffers


class PatchedNetwork:
    """A network on a mesh that is too large for :class:`dmp.layers.stack_buffers.StackBuffers` of all vertices."""

    def __init__(
        self,
        network: DisplacementNetwork,
        propagation: Tensor,
        positions: FloatArray,
        patch_vertices: int,
        *,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        """Divide the mesh and make the memory that all steps share.

        Args:
            network: of graph convolutions alone, without skip connections.
            propagation: P, (V, V) CSR.
            positions: by which the mesh is divided, (V, 3).
            patch_vertices: most vertices of a patch without its halo.
            dtype: in which numbers between the layers are kept: float32 or bfloat16.
        """
        self._network = network
        self._whole = WholePass(propagation, network.sizes[0], network.sizes[1:], dtype)
        matrix = _to_scipy(propagation)
        patches = partition(positions, matrix, patch_vertices, len(network.convolutions))
        largest = max(len(patch.vertices) for patch in patches)
        buffers = network.buffers_for(largest, dtype=dtype, keep_outputs=False)
        self._pieces = [
            _Piece(
                vertices=torch.from_numpy(patch.vertices),
                core=torch.from_numpy(patch.core)[:, None],
                propagation=to_torch(matrix[patch.vertices][:, patch.vertices]),
                buffers=buffers.first(len(patch.vertices)),
            )
            for patch in patches
        ]

    @property
    def n_patches(self) -> int:
        """Number of patches."""
        return len(self._pieces)

    def __call__(self, features: Tensor) -> Tensor:
        """Return one vector a vertex, (V, 3), for ``features`` (V, in); differentiable in the network's parameters."""
        output: Tensor = _InPatches.apply(features, self, *self._network.parameters())  # type: ignore[no-untyped-call]
        return output

    def whole_output(self, features: Tensor) -> tuple[Tensor, list[Moments]]:
        """Return the output on the whole mesh, (V, 3), and the moments of each layer, without gradients."""
        with torch.no_grad():
            last, moments = self._whole.run(features, self._network.convolutions, self._network.normalisations)
            return self._network.ended(last), moments

    def patch_output(self, number: int, features: Tensor, moments: list[Moments]) -> tuple[Tensor, Tensor, Tensor]:
        """Return a patch's vertices, which of them are its core, and the output there, differentiable in the parameters."""
        piece = self._pieces[number]
        own = features.index_select(0, piece.vertices)
        return piece.vertices, piece.core, self._network(own, piece.propagation, piece.buffers, moments)


class _InPatches(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, features: Tensor, patched: PatchedNetwork, *parameters: Tensor) -> Tensor:
        output, ctx.moments = patched.whole_output(features)
        ctx.features, ctx.patched, ctx.parameters = features, patched, parameters
        return output

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        patched: PatchedNetwork = ctx.patched
        sums = [torch.zeros_like(parameter) for parameter in ctx.parameters]
        for number in range(patched.n_patches):
            with torch.enable_grad():
                vertices, core, output = patched.patch_output(number, ctx.features, ctx.moments)
            of_output = gradients[0].index_select(0, vertices) * core
            for total, found in zip(sums, torch.autograd.grad(output, ctx.parameters, of_output), strict=True):
                total.add_(found)
        return None, None, *sums


def _to_scipy(matrix: Tensor) -> sparse.csr_array:
    parts = matrix.values().float(), matrix.col_indices(), matrix.crow_indices()
    values, columns, starts = (np.asarray(part) for part in parts)
    return sparse.csr_array((values, columns, starts), shape=(matrix.shape[0], matrix.shape[1]))
