"""Passes over the rows of a layer's arrays, on tensors; see :mod:`dmp.compiled.stack_kernels` for what is written."""

from __future__ import annotations

from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from dmp.compiled import stack_kernels as kernels
from dmp.compiled.blocked_matrix import BlockedMatrix
from dmp.compiled.kernel import Kernel
from dmp.compiled.launching import launch
from dmp.compiled.layer_steps import Backward, Derivative, Forward, Layer, Normalised
from dmp.compiled.stack_rows import ROWS

# Parts for each thread, so that one that is held up holds up little; and values below which waiting for another thread costs
# more than it saves.
_PARTS, WORTH_SHARING = 4, 1 << 15


class StackPasses:
    """The passes, with memory for the sums of blocks."""

    def __init__(self, n_vertices: int, widest: int) -> None:
        """Make the memory for layers of ``n_vertices`` rows and at most ``widest`` channels."""
        self._n_vertices = n_vertices
        self._n_blocks = -(-n_vertices // ROWS)
        self._sums = torch.empty((2, self._n_blocks * widest), dtype=torch.float32)
        self._joined = torch.empty((2, widest), dtype=torch.float64)

    def activate(self, mixed: Tensor, normalised: Normalised, out: Tensor) -> None:
        """Write y to ``out`` for z."""
        self._run(kernels.activate, (mixed, out), *normalised.addresses, *mixed.shape)

    def moments(self, mixed: Tensor) -> tuple[Tensor, Tensor]:
        """Return mean and 1 / deviation of z over the vertices, (C,) both."""
        self._run(kernels.moments, (mixed,), *self._sums_at, *mixed.shape)
        return self._joined_moments(mixed.shape[1])

    def gather(self, matrix: BlockedMatrix, features: Tensor, out: Tensor) -> None:
        """Write P x to ``out``."""
        self.gather_rows(matrix, features, out, matrix.all_blocks)

    def gather_rows(
        self, matrix: BlockedMatrix, features: Tensor, out: Tensor, blocks: NDArray[Any], first_row: int = 0
    ) -> None:
        """Write these ``blocks`` of P x to ``out``, whose row 0 stands for ``first_row``."""
        if len(blocks) == 0:
            return
        channels = features.shape[1]
        place = out.data_ptr() - first_row * channels * out.element_size()
        arguments = (*matrix.addresses, blocks.ctypes.data, len(blocks), matrix.n_rows, channels)
        launch(kernels.gather.of(features.dtype), (features.data_ptr(), place, *arguments), self._parts(len(blocks), channels))

    def gather_moments(self, matrix: BlockedMatrix, features: Tensor, out: Tensor) -> tuple[Tensor, Tensor]:
        """Write z = P x to ``out`` and return its :meth:`moments`."""
        self._run(kernels.gather_moments, (features, out), *matrix.addresses, *self._sums_at, *features.shape)
        return self._joined_moments(features.shape[1])

    def activate_gather(
        self, matrix: BlockedMatrix, mixed: Tensor, normalised: Normalised, activated: Tensor, out: Tensor
    ) -> None:
        """Write y to ``activated`` for z, and P y to ``out``."""
        self._sweep(kernels.activate_gather, matrix, (mixed, activated, out), activated, *normalised.addresses)

    def sums(self, gradient: Tensor, mixed: Tensor, normalised: Normalised) -> Derivative:
        """Return what the sums over vertices give, for the gradient of y."""
        self._run(kernels.sums, (gradient, mixed), *normalised.addresses, *self._sums_at, *mixed.shape)
        return self._joined_sums(normalised)

    def gather_sums(
        self, matrix: BlockedMatrix, product: Tensor, gradient: Tensor, mixed: Tensor, normalised: Normalised
    ) -> Derivative:
        """Write P x to ``gradient`` for x in ``product``, and return its :meth:`sums`."""
        arguments = (*matrix.addresses, *normalised.addresses, *self._sums_at, *mixed.shape)
        self._run(kernels.gather_sums, (product, gradient, mixed), *arguments)
        return self._joined_sums(normalised)

    def derive(self, gradient: Tensor, mixed: Tensor, normalised: Normalised, derivative: Derivative) -> None:
        """Write the gradient of z over that of y."""
        slopes = derivative.slope.data_ptr(), derivative.constant.data_ptr()
        self._run(kernels.derive, (gradient, mixed), *normalised.addresses, *slopes, *mixed.shape)

    def derive_gather(self, matrix: BlockedMatrix, gradient: Tensor, layer: Layer, derivative: Derivative, out: Tensor) -> None:
        """Write the gradient of z over that of y, and P times it to ``out``."""
        mixed, normalised = layer
        slopes = derivative.slope.data_ptr(), derivative.constant.data_ptr()
        self._sweep(kernels.derive_gather, matrix, (gradient, mixed, out), gradient, *normalised.addresses, *slopes)

    # -- whole layers ---------------------------------------------------------------------------------------------

    def forward_multiplying(self, step: Forward) -> tuple[Tensor, Tensor]:
        """Go through a layer that multiplies by its weights first, and return the moments of its z."""
        self.activate(*step.before, step.activated)
        torch.mm(step.activated, step.weight, out=step.between)
        return self.gather_moments(step.matrix, step.between, step.mixed)

    def forward_gathering(self, step: Forward) -> tuple[Tensor, Tensor]:
        """Go through a layer that gathers first, and return the moments of its z."""
        self.activate_gather(step.matrix, *step.before, step.activated, step.between)
        torch.mm(step.between, step.weight, out=step.mixed)
        return self.moments(step.mixed)

    def backward_multiplying(self, step: Backward) -> Derivative:
        """Go back through a layer that multiplies first, and return the derivative of the layer before."""
        self.derive_gather(step.matrix, step.gradient, step.layer, step.derivative, step.between)
        torch.mm(step.between, step.weight.T, out=step.of_before)
        return self.sums(step.of_before, *step.before)

    def backward_gathering(self, step: Backward) -> Derivative:
        """Go back through a layer that gathers first, and return the derivative of the layer before."""
        self.derive(step.gradient, *step.layer, step.derivative)
        torch.mm(step.gradient, step.weight.T, out=step.between)
        return self.gather_sums(step.matrix, step.between, step.of_before, *step.before)

    @property
    def _sums_at(self) -> tuple[int, int]:
        return self._sums[0].data_ptr(), self._sums[1].data_ptr()

    def _run(self, kernel: Kernel, rows: tuple[Tensor, ...], *arguments: int) -> None:
        addresses = (tensor.data_ptr() for tensor in rows)
        launch(kernel.of(rows[0].dtype), (*addresses, *arguments), self._parts(self._n_blocks, rows[0].shape[1]))

    def _sweep(self, kernel: Kernel, matrix: BlockedMatrix, rows: tuple[Tensor, ...], written: Tensor, *arguments: int) -> None:
        """Run a kernel that writes to ``written``, and then P times that to the last of ``rows`` where it can."""
        sweep = matrix.sweep(self._threads(rows[0].shape[1]))
        plan = (part.ctypes.data for part in (sweep.bounds, sweep.queue_starts, sweep.queue, sweep.highest))
        addresses = (tensor.data_ptr() for tensor in rows)
        channels = rows[0].shape[1]
        launch(kernel.of(rows[0].dtype), (*addresses, *matrix.addresses, *plan, *arguments, channels), sweep.n_parts)
        self.gather_rows(matrix, written, rows[2], sweep.others)

    def _joined_moments(self, channels: int) -> tuple[Tensor, Tensor]:
        mean, over_deviation = torch.empty(channels), torch.empty(channels)
        places = *self._sums_at, self._joined.data_ptr(), mean.data_ptr(), over_deviation.data_ptr()
        launch(kernels.join_moments, (*places, self._n_vertices, channels), parts=1)
        return mean, over_deviation

    def _joined_sums(self, normalised: Normalised) -> Derivative:
        channels = len(normalised.mean)
        found = Derivative(*(torch.empty(channels) for _ in range(4)))
        before = *self._sums_at, self._joined.data_ptr(), normalised.over_deviation.data_ptr(), normalised.scale.data_ptr()
        after = (found.of_gamma, found.of_beta, found.slope, found.constant)
        arguments = (*before, *(part.data_ptr() for part in after), self._n_vertices, channels)
        launch(kernels.join_sums, arguments, parts=1)
        return found

    def _threads(self, channels: int) -> int:
        """Return among how many threads to divide passes over all rows."""
        return torch.get_num_threads() if self._n_vertices * channels >= WORTH_SHARING else 1

    def _parts(self, blocks: int, channels: int) -> int:
        threads = self._threads(channels)
        return 1 if threads == 1 else min(blocks, _PARTS * threads)
