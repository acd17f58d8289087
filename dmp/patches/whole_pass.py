"""The layers of a network on a whole mesh, without what a backward pass would need: two arrays of the widest layer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import torch
from torch import Tensor

from dmp.compiled.blocked_matrix import BlockedMatrix
from dmp.compiled.layer_steps import Normalised
from dmp.compiled.stack_passes import StackPasses
from dmp.compiled.stack_rows import ROWS
from dmp.layers.gcn_stack import Moments

# Rows of the propagation that are gathered and multiplied at once: whole blocks of the kernels.
_ROWS = 512 * ROWS


class WholePass:
    """Memory for :meth:`run` on one mesh, the same in each step."""

    def __init__(
        self, propagation: Tensor, input_channels: int, widths: Sequence[int], dtype: torch.dtype = torch.float32
    ) -> None:
        """Make the arrays.

        Args:
            propagation: P, (V, V) CSR.
            input_channels: channels of the features.
            widths: output channels of the layers.
            dtype: in which numbers between the layers are kept: float32 or bfloat16.
        """
        self._n_vertices = propagation.shape[0]
        self._matrix = BlockedMatrix(propagation)
        self._passes = StackPasses(self._n_vertices, max(widths))
        self._dtype = dtype
        self._places = [torch.empty(self._n_vertices * max(widths), dtype=self._dtype) for _ in range(2)]
        widest_input = max(input_channels, *widths[:-1]) if len(widths) > 1 else input_channels
        self._gathered = torch.empty(min(_ROWS, self._n_vertices) * widest_input, dtype=self._dtype)

    @torch.no_grad()
    def run(self, features: Tensor, convolutions: Iterable[Any], normalisations: Iterable[Any]) -> tuple[Tensor, list[Moments]]:
        """Return the output of the last layer, (V, out), valid until the next call, and the moments of each layer.

        Args:
            features: (V, in).
            convolutions: the layers, each a :class:`dmp.layers.GraphConvolution`.
            normalisations: the ``BatchNorm1d`` after each.
        """
        current = features.to(self._dtype).contiguous()
        moments = []
        for convolution, normalisation in zip(convolutions, normalisations, strict=True):
            weight = convolution.weight.to(self._dtype)
            mixed = self._place(1, weight.shape[1])
            for start in range(0, self._n_vertices, _ROWS):
                rows = min(_ROWS, self._n_vertices - start)
                gathered = self._gathered[: rows * weight.shape[0]].view(rows, weight.shape[0])
                blocks = self._matrix.all_blocks[start // ROWS : -(-(start + rows) // ROWS)]
                self._passes.gather_rows(self._matrix, current, gathered, blocks, start)
                torch.mm(gathered, weight, out=mixed[start : start + rows])
            # The input of the layer is not needed any more, so its output takes its place.
            current = self._place(0, weight.shape[1])
            moments.append(self._passes.moments(mixed))
            self._passes.activate(mixed, Normalised.by(*moments[-1], normalisation.weight, normalisation.bias), current)
        return current.to(features.dtype), moments

    def _place(self, number: int, channels: int) -> Tensor:
        return self._places[number][: self._n_vertices * channels].view(self._n_vertices, channels)
