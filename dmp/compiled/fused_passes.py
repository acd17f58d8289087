"""Whole layers in one sweep over the vertices each, see :mod:`dmp.compiled.fused_kernels`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from dmp.compiled import fused_kernels as kernels
from dmp.compiled.blocked_matrix import BlockedMatrix
from dmp.compiled.launching import launch
from dmp.compiled.packed_weights import PackedWeights
from dmp.compiled.stack_passes import Derivative, Layer, StackPasses
from dmp.compiled.stack_rows import ROWS


class FusedPasses(StackPasses):
    """The passes for float32, where weights can be packed. All arrays need room for whole blocks of rows."""

    def __init__(self, n_vertices: int, widest: int) -> None:
        super().__init__(n_vertices, widest)
        self._packed: dict[tuple[int, int], PackedWeights] = {}

    def forward_multiplying(
        self, matrix: BlockedMatrix, before: Layer, weight: Tensor, activated: Tensor, product: Tensor, mixed: Tensor
    ) -> tuple[Tensor, Tensor]:
        pair = kernels.activate_multiply_gather, kernels.gather_multiplied
        return self._forward(pair, matrix, before, weight, activated, product, mixed)

    def forward_gathering(
        self, matrix: BlockedMatrix, before: Layer, weight: Tensor, activated: Tensor, gathered: Tensor, mixed: Tensor
    ) -> tuple[Tensor, Tensor]:
        pair = kernels.activate_gather_multiply, kernels.gather_and_multiply
        return self._forward(pair, matrix, before, weight, activated, gathered, mixed)

    def backward_multiplying(
        self,
        matrix: BlockedMatrix,
        gradient: Tensor,
        layer: Layer,
        derivative: Derivative,
        weight: Tensor,
        spread: Tensor,
        of_before: Tensor,
        before: Layer,
    ) -> Derivative:
        pair = kernels.derive_gather_multiply, kernels.gather_multiply_sums
        return self._backward(pair, matrix, gradient, layer, derivative, weight, spread, of_before, before)

    def backward_gathering(
        self,
        matrix: BlockedMatrix,
        gradient: Tensor,
        layer: Layer,
        derivative: Derivative,
        weight: Tensor,
        product: Tensor,
        of_before: Tensor,
        before: Layer,
    ) -> Derivative:
        pair = kernels.derive_multiply_gather, kernels.gather_sums_blocks
        return self._backward(pair, matrix, gradient, layer, derivative, weight, product, of_before, before)

    def _forward(
        self,
        pair: tuple[Callable[..., Any], Callable[..., Any]],
        matrix: BlockedMatrix,
        before: Layer,
        weight: Tensor,
        activated: Tensor,
        between: Tensor,
        mixed: Tensor,
    ) -> tuple[Tensor, Tensor]:
        mixed_before, normalised = before
        packed = self._pack(weight)
        places = activated.data_ptr(), packed.multiply_at, packed.address, between.data_ptr(), mixed.data_ptr()
        arguments = mixed_before.data_ptr(), *normalised.addresses, *places, *self._sums_at, *weight.shape
        self._in_blocks(pair, matrix, *arguments)
        return self._joined_moments(weight.shape[1])

    def _backward(
        self,
        pair: tuple[Callable[..., Any], Callable[..., Any]],
        matrix: BlockedMatrix,
        gradient: Tensor,
        layer: Layer,
        derivative: Derivative,
        weight: Tensor,
        between: Tensor,
        of_before: Tensor,
        before: Layer,
    ) -> Derivative:
        mixed, normalised = layer
        mixed_before, normalised_before = before
        packed = self._pack(weight, transposed=True)
        slopes = derivative.slope.data_ptr(), derivative.constant.data_ptr()
        places = packed.multiply_at, packed.address, between.data_ptr(), of_before.data_ptr(), mixed_before.data_ptr()
        own = gradient.data_ptr(), mixed.data_ptr(), *normalised.addresses, *slopes
        self._in_blocks(pair, matrix, *own, *places, *normalised_before.addresses, *self._sums_at, *weight.shape)
        return self._joined_sums(normalised_before)

    def _in_blocks(
        self, pair: tuple[Callable[..., Any], Callable[..., Any]], matrix: BlockedMatrix, *arguments: int
    ) -> None:
        first, second = pair
        sweep = matrix.sweep(torch.get_num_threads())
        plan = [part.ctypes.data for part in (sweep.bounds, sweep.queue_starts, sweep.queue, sweep.highest)]
        launch(first, (*matrix.addresses, *plan, matrix.n_rows, *arguments), sweep.n_parts)
        if len(sweep.others):
            plan[0] = sweep.others.ctypes.data
            launch(second, (*matrix.addresses, *plan, matrix.n_rows, *arguments), len(sweep.others))

    def _pack(self, weight: Tensor, *, transposed: bool = False) -> PackedWeights:
        sizes = (weight.shape[1], weight.shape[0]) if transposed else (weight.shape[0], weight.shape[1])
        if sizes not in self._packed:
            self._packed[sizes] = PackedWeights(*sizes, ROWS)
        self._packed[sizes].pack(weight, transposed=transposed)
        return self._packed[sizes]
