"""Passes over the rows of a layer's arrays, on tensors; see :mod:`dmp.compiled.stack_kernels` for what is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import torch
from numpy.typing import NDArray
from torch import Tensor

from dmp.compiled import stack_kernels as kernels
from dmp.compiled.blocked_matrix import BlockedMatrix
from dmp.compiled.launching import launch
from dmp.compiled.stack_rows import ROWS

# Parts for each thread, so that one that is held up holds up little.
_PARTS = 4


@dataclass(frozen=True, eq=False)
class Normalised:
    """How a layer is normalised: u = (z - mean) scale + beta; all (C,) float32.

    Attributes:
        mean: of z.
        over_deviation: 1 / deviation of z.
        scale: gamma / deviation.
        beta: what is added at the end.
    """

    mean: Tensor
    over_deviation: Tensor
    scale: Tensor
    beta: Tensor

    @classmethod
    def by(cls, mean: Tensor, over_deviation: Tensor, gamma: Tensor, beta: Tensor) -> Normalised:
        """Put the weights gamma and beta together with moments."""
        return cls(mean, over_deviation, gamma.detach() * over_deviation, beta.detach())

    @property
    def addresses(self) -> tuple[int, int, int]:
        """Addresses of mean, scale and beta."""
        return self.mean.data_ptr(), self.scale.data_ptr(), self.beta.data_ptr()


# z of a layer, (V, C), and how it is normalised.
Layer: TypeAlias = tuple[Tensor, Normalised]


@dataclass(frozen=True, eq=False)
class Derivative:
    """What a layer's sums over vertices give: gradients, and numbers for the gradient of z; all (C,) float32."""

    of_gamma: Tensor
    of_beta: Tensor
    slope: Tensor
    constant: Tensor


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
        launch(kernels.gather, (_is_half(features), features.data_ptr(), place, *arguments), self._parts(len(blocks)))

    def gather_moments(self, matrix: BlockedMatrix, features: Tensor, out: Tensor) -> tuple[Tensor, Tensor]:
        """Write z = P x to ``out`` and return its :meth:`moments`."""
        self._run(kernels.gather_moments, (features, out), *matrix.addresses, *self._sums_at, *features.shape)
        return self._joined_moments(features.shape[1])

    def activate_gather(
        self, matrix: BlockedMatrix, mixed: Tensor, normalised: Normalised, activated: Tensor, out: Tensor
    ) -> None:
        """Write y to ``activated`` for z, and P y to ``out``."""
        self._sweep(kernels.activate_gather, matrix, (mixed, activated, out), *normalised.addresses)

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

    def derive_gather(
        self,
        matrix: BlockedMatrix,
        gradient: Tensor,
        mixed: Tensor,
        normalised: Normalised,
        derivative: Derivative,
        out: Tensor,
    ) -> None:
        """Write the gradient of z over that of y, and P times it to ``out``."""
        slopes = derivative.slope.data_ptr(), derivative.constant.data_ptr()
        self._sweep(kernels.derive_gather, matrix, (gradient, mixed, out), *normalised.addresses, *slopes)

    # -- whole layers: what a layer does between the z before it and its own z ---------------------------------------

    def forward_multiplying(
        self, matrix: BlockedMatrix, before: Layer, weight: Tensor, activated: Tensor, product: Tensor, mixed: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Go through a layer that multiplies first, and return the moments of its z.

        Args:
            matrix: P.
            before: the layer before.
            weight: W, (in, out).
            activated: place for y before, (V, in).
            product: place for y W, (V, out).
            mixed: place for z = P y W, (V, out).
        """
        self.activate(*before, activated)
        torch.mm(activated, weight, out=product)
        return self.gather_moments(matrix, product, mixed)

    def forward_gathering(
        self, matrix: BlockedMatrix, before: Layer, weight: Tensor, activated: Tensor, gathered: Tensor, mixed: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Go through a layer that gathers first, with a place for P y before in ``gathered``, (V, in); see above."""
        self.activate_gather(matrix, *before, activated, gathered)
        torch.mm(gathered, weight, out=mixed)
        return self.moments(mixed)

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
        """Go back through a layer that multiplies first, and return the derivative of the layer before.

        Args:
            matrix: P.
            gradient: that of y, (V, out); is written over.
            layer: the layer.
            derivative: of the layer.
            weight: W, (in, out).
            spread: place for P times the gradient of z, (V, out).
            of_before: place for the gradient of the y before, (V, in).
            before: the layer before.
        """
        self.derive_gather(matrix, gradient, *layer, derivative, spread)
        torch.mm(spread, weight.T, out=of_before)
        return self.sums(of_before, *before)

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
        """Go back through a layer that gathers first; see above.

        Args:
            matrix: P.
            gradient: that of y, (V, out); that of z is written over it.
            layer: the layer.
            derivative: of the layer.
            weight: W, (in, out).
            product: place for the gradient of z times the transposed weights, (V, in).
            of_before: place for the gradient of the y before, (V, in).
            before: the layer before.
        """
        self.derive(gradient, *layer, derivative)
        torch.mm(gradient, weight.T, out=product)
        return self.gather_sums(matrix, product, of_before, *before)

    @property
    def _sums_at(self) -> tuple[int, int]:
        return self._sums[0].data_ptr(), self._sums[1].data_ptr()

    def _run(self, kernel: Callable[..., Any], rows: tuple[Tensor, ...], *arguments: int) -> None:
        addresses = (tensor.data_ptr() for tensor in rows)
        launch(kernel, (_is_half(rows[0]), *addresses, *arguments), self._parts(self._n_blocks))

    def _sweep(
        self, kernel: Callable[..., Any], matrix: BlockedMatrix, rows: tuple[Tensor, Tensor, Tensor], *arguments: int
    ) -> None:
        sweep = matrix.sweep(torch.get_num_threads())
        plan = (part.ctypes.data for part in (sweep.bounds, sweep.queue_starts, sweep.queue, sweep.highest))
        addresses = (tensor.data_ptr() for tensor in rows)
        channels = rows[0].shape[1]
        launch(kernel, (_is_half(rows[0]), *addresses, *matrix.addresses, *plan, *arguments, channels), sweep.n_parts)
        # The kernel writes y over z or beside it: what the product is taken of is where the kernel has written.
        written = rows[1] if kernel is kernels.activate_gather else rows[0]
        self.gather_rows(matrix, written, rows[2], sweep.others)

    def _joined_moments(self, channels: int) -> tuple[Tensor, Tensor]:
        mean, over_deviation = torch.empty(channels), torch.empty(channels)
        places = *self._sums_at, self._joined.data_ptr(), mean.data_ptr(), over_deviation.data_ptr()
        launch(kernels.join_moments, (0, *places, self._n_vertices, channels), self._parts(-(-channels // 64)))
        return mean, over_deviation

    def _joined_sums(self, normalised: Normalised) -> Derivative:
        channels = len(normalised.mean)
        found = Derivative(*(torch.empty(channels) for _ in range(4)))
        before = *self._sums_at, self._joined.data_ptr(), normalised.over_deviation.data_ptr(), normalised.scale.data_ptr()
        after = (found.of_gamma, found.of_beta, found.slope, found.constant)
        arguments = (0, *before, *(part.data_ptr() for part in after), self._n_vertices, channels)
        launch(kernels.join_sums, arguments, self._parts(-(-channels // 64)))
        return found

    def _parts(self, most: int) -> int:
        threads = torch.get_num_threads()
        return 1 if threads == 1 else min(most, _PARTS * threads)


def _is_half(rows: Tensor) -> int:
    return int(rows.dtype == torch.bfloat16)
