"""The layers of a network on a whole mesh, without what a backward pass would need: two arrays of the widest layer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import torch
from torch import Tensor

from dmp.layers.gcn_stack import Moments, normalise_and_activate, propagate

# Rows of the propagation that are worked on at once.
_ROWS = 1 << 15


class WholePass:
    """Memory for :meth:`run` on one mesh, the same in each step."""

    def __init__(self, propagation: Tensor, input_channels: int, widths: Sequence[int]) -> None:
        """Make the arrays.

        Args:
            propagation: P, (V, V) CSR.
            input_channels: channels of the features.
            widths: output channels of the layers.
        """
        self._n_vertices = propagation.shape[0]
        self._parts = _row_parts(propagation)
        self._dtype = propagation.dtype
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
        current = features.to(self._dtype)
        moments = []
        for convolution, normalisation in zip(convolutions, normalisations, strict=True):
            weight = convolution.weight.to(self._dtype)
            mixed = self._place(1, weight.shape[1])
            for start, part in self._parts:
                rows = part.shape[0]
                gathered = self._gathered[: rows * weight.shape[0]].view(rows, weight.shape[0])
                propagate(part, current, gathered)
                torch.mm(gathered, weight, out=mixed[start : start + rows])
            # The input of the layer is not needed any more, so its output takes its place.
            current = self._place(0, weight.shape[1])
            moments.append(normalise_and_activate(mixed, normalisation.weight, normalisation.bias, current))
        return current.to(features.dtype), moments

    def _place(self, number: int, channels: int) -> Tensor:
        return self._places[number][: self._n_vertices * channels].view(self._n_vertices, channels)


def bytes_per_vertex(widths: Sequence[int], *, value_bytes: int = 4) -> int:
    """Return what a :class:`WholePass` takes for each vertex of a large mesh."""
    return 2 * max(widths) * value_bytes


def _row_parts(matrix: Tensor) -> list[tuple[int, Tensor]]:
    """Return parts of the rows of a CSR matrix with the number of the first row of each; they share its memory."""
    starts, columns, values = matrix.crow_indices(), matrix.col_indices(), matrix.values()
    found = []
    for start in range(0, matrix.shape[0], _ROWS):
        own = starts[start : start + _ROWS + 1]
        first, last = int(own[0]), int(own[-1])
        part = torch.sparse_csr_tensor(
            own - own[0], columns[first:last], values[first:last], size=(len(own) - 1, matrix.shape[1]), check_invariants=False
        )
        found.append((start, part))
    return found
