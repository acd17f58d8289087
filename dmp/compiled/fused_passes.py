"""Whole layers in one sweep over the vertices each, see :mod:`dmp.compiled.fused_kernels`."""

from __future__ import annotations

from torch import Tensor

from dmp.compiled import fused_kernels as kernels
from dmp.compiled.kernel import Kernel
from dmp.compiled.launching import launch
from dmp.compiled.layer_steps import Backward, Derivative, Forward
from dmp.compiled.packed_weights import PackedWeights
from dmp.compiled.stack_passes import StackPasses
from dmp.compiled.stack_rows import ROWS


class FusedPasses(StackPasses):
    """The passes for float32, where weights can be packed. All arrays need room for whole blocks of rows."""

    def __init__(self, n_vertices: int, widest: int) -> None:
        super().__init__(n_vertices, widest)
        self._packed: dict[tuple[int, int], PackedWeights] = {}

    def forward_multiplying(self, step: Forward) -> tuple[Tensor, Tensor]:
        """Go through a layer that multiplies by its weights first, and return the moments of its z."""
        return self._forward(step, kernels.activate_multiply_gather, kernels.gather_multiplied)

    def forward_gathering(self, step: Forward) -> tuple[Tensor, Tensor]:
        """Go through a layer that gathers first, and return the moments of its z."""
        return self._forward(step, kernels.activate_gather_multiply, kernels.gather_and_multiply)

    def backward_multiplying(self, step: Backward) -> Derivative:
        """Go back through a layer that multiplies first, and return the derivative of the layer before."""
        return self._backward(step, kernels.derive_gather_multiply, kernels.gather_multiply_sums)

    def backward_gathering(self, step: Backward) -> Derivative:
        """Go back through a layer that gathers first, and return the derivative of the layer before."""
        return self._backward(step, kernels.derive_multiply_gather, kernels.gather_sums_blocks)

    def _forward(self, step: Forward, sweep: Kernel, rest: Kernel) -> tuple[Tensor, Tensor]:
        mixed_before, normalised = step.before
        packed = self._pack(step.weight)
        places = packed.multiply_at, packed.address, step.between.data_ptr(), step.mixed.data_ptr()
        given = mixed_before.data_ptr(), *normalised.addresses, step.activated.data_ptr()
        self._in_blocks((sweep, rest), step, *given, *places, *self._sums_at, *step.weight.shape)
        return self._joined_moments(step.weight.shape[1])

    def _backward(self, step: Backward, sweep: Kernel, rest: Kernel) -> Derivative:
        mixed, normalised = step.layer
        mixed_before, normalised_before = step.before
        packed = self._pack(step.weight, transposed=True)
        slopes = step.derivative.slope.data_ptr(), step.derivative.constant.data_ptr()
        given = step.gradient.data_ptr(), mixed.data_ptr(), *normalised.addresses, *slopes
        places = packed.multiply_at, packed.address, step.between.data_ptr(), step.of_before.data_ptr()
        before = mixed_before.data_ptr(), *normalised_before.addresses
        self._in_blocks((sweep, rest), step, *given, *places, *before, *self._sums_at, *step.weight.shape)
        return self._joined_sums(normalised_before)

    def _in_blocks(self, pair: tuple[Kernel, Kernel], step: Forward | Backward, *arguments: int) -> None:
        first, second = pair
        matrix = step.matrix
        sweep = matrix.sweep(self._threads(max(step.weight.shape)))
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
