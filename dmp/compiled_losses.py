"""The loss of Deep Mesh Prior on a processor: the terms of :mod:`dmp.losses`, and their gradient with them."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from dmp.compiled import loss_kernels as kernels
from dmp.compiled.phases import launch_parts
from dmp.losses import EPSILON
from dmp.settings import Settings

# Fewer vertices are not worth a second thread.
_LEAST_PART = 2_000


class CompiledLosses:
    """E + lambda E_lap of one mesh; thirty operations of torch and their derivatives in one launch."""

    def __init__(self, settings: Settings, target: Tensor, adjacency: Tensor, valence: Tensor, fitted: Tensor | None) -> None:
        """Lay out what stays the same from step to step.

        Args:
            settings: form and weight of the Laplacian term, and what it is taken of.
            target: y, (V, 3) float32.
            adjacency: A, (V, V), symmetric CSR of ones.
            valence: |N(i)|, (V, 1) float32, at least 1.
            fitted: indices of the vertices that count in the data term, (N,) int64; None for all.
        """
        n_vertices = len(target)
        self._target, self._valence = target.contiguous(), valence.contiguous()
        self._starts, self._columns = (part.int() for part in (adjacency.crow_indices(), adjacency.col_indices()))
        self._shares = torch.zeros(n_vertices)
        self._shares[... if fitted is None else fitted] = 1 / (n_vertices if fitted is None else len(fitted))
        self._constants = torch.tensor([EPSILON, settings.laplacian_epsilon, settings.laplacian_weight])
        self._spread = torch.empty((n_vertices, 3))
        self._sums = torch.empty((-(-n_vertices // kernels.BLOCK), 2), dtype=torch.float64)
        self._choices = int(settings.laplacian_of != "prediction"), int(settings.laplacian_form == "sum")

    def __call__(self, predicted: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return total, data and Laplacian loss for positions q, (V, 3); only the first has a derivative."""
        total, data, laplacian = _Losses.apply(predicted, self)  # type: ignore[no-untyped-call]
        return total, data, laplacian

    def compute(self, predicted: Tensor) -> tuple[Tensor, Tensor]:
        """Return the three losses, (3,), and the gradient of the first, (V, 3).

        Raises:
            ValueError: see :meth:`arguments`.
        """
        predicted = predicted.contiguous()
        gradient, losses = torch.empty_like(predicted), torch.empty(3)
        parts = max(1, min(torch.get_num_threads(), len(predicted) // _LEAST_PART))
        launch_parts(kernels.losses, 2, parts, *self.arguments(predicted, gradient, losses))
        return losses, gradient

    def arguments(self, predicted: Tensor, gradient: Tensor, losses: Tensor) -> tuple[int, ...]:
        """Return the kernel's arguments for positions (V, 3), their gradient, and the losses, (3,), all float32.

        Raises:
            ValueError: when there are other positions than the target has; addresses are all that a kernel sees.
        """
        if predicted.shape != self._target.shape or predicted.dtype != torch.float32:
            raise ValueError(f"The losses are those of {len(self._target)} positions in float32.")
        given = (predicted, self._target, self._starts, self._columns, self._valence, self._shares, self._constants)
        written = gradient, self._spread, self._sums, losses
        return *(tensor.data_ptr() for tensor in (*given, *written)), len(predicted), *self._choices


class _Losses(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, predicted: Tensor, losses: CompiledLosses) -> tuple[Tensor, Tensor, Tensor]:
        found, ctx.gradient = losses.compute(predicted)
        total, data, laplacian = (value.clone() for value in found)
        ctx.mark_non_differentiable(data, laplacian)
        return total, data, laplacian

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        return ctx.gradient * gradients[0], None
