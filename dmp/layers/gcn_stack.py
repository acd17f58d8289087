"""The paper's series of graph convolutions as one operation with its own backward pass and buffers that are used again.

Written with one automatic derivative a layer, a step of the published network spends two fifths of its time outside the matrix
products: on fresh memory for each result, on zeros that are overwritten, on a bias that batch normalisation takes off again.
Here each layer is

    z = P x W,    u = gamma (z - mean) / deviation + beta,    y = LeakyReLU(u),

with the sparse product P taken on the narrower side. The bias of a convolution in front of a batch normalisation changes
nothing, so it is left out, and its gradient is exactly 0.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import torch
from torch import Tensor
from torch.nn import functional

# Mean and 1 / deviation of each channel over the vertices, (C,) both.
Moments: TypeAlias = tuple[Tensor, Tensor]

SLOPE = 0.01
_EPSILON = 1e-5
# Rows that are worked on at once in the backward pass: so many that a call costs little, so few that they stay in the cache.
_CHUNK_VALUES = 1 << 17


class StackBuffers:
    """Memory for the layers of one network on one mesh, the same in each step.

    Attributes:
        keep_outputs: whether outputs of layers are kept beside what they are computed from. Without, a step takes 5 to 20 %
            longer, and a training a quarter less memory.
        generation: number of forward passes that have used the buffers.
    """

    def __init__(
        self,
        n_vertices: int,
        input_channels: int,
        widths: Sequence[int],
        *,
        dtype: torch.dtype = torch.float32,
        keep_outputs: bool = True,
    ) -> None:
        """Make the buffers.

        Args:
            n_vertices: V.
            input_channels: channels of the features.
            widths: output channels of the layers.
            dtype: in which activations are kept: float32, float64 or bfloat16.
            keep_outputs: see above.
        """
        self.keep_outputs = keep_outputs
        self.generation = 0
        self._n_vertices = n_vertices
        self.dtype = dtype
        inputs = (input_channels, *widths)[:-1]

        def rows(channels: int) -> Tensor:
            return torch.empty((n_vertices, channels), dtype=dtype)

        # What a layer normalises, z; and P x, where the product with P comes first.
        self.mixed = [rows(width) for width in widths]
        self.gathered = [rows(i) if i < o else None for i, o in zip(inputs, widths, strict=True)]
        widest = max(input_channels, *widths)
        self._scratch = [torch.empty(n_vertices * widest, dtype=dtype) for _ in range(2 if keep_outputs else 3)]
        self._outputs = [rows(width) for width in widths] if keep_outputs else None

    def first(self, n_vertices: int) -> StackBuffers:
        """Return buffers for fewer vertices in the same memory; of these and those only one can be in use at a time."""
        part = copy.copy(self)
        part._n_vertices = n_vertices
        part.mixed = [rows[:n_vertices] for rows in self.mixed]
        part.gathered = [None if rows is None else rows[:n_vertices] for rows in self.gathered]
        part._outputs = None if self._outputs is None else [rows[:n_vertices] for rows in self._outputs]
        return part

    def scratch(self, number: int, channels: int) -> Tensor:
        """Return a working place (V, channels): number 0 or 1. Its content lasts until the next that asks for it."""
        return self._scratch[number][: self._n_vertices * channels].view(self._n_vertices, channels)

    def output(self, layer: int) -> Tensor:
        """Return the place for the output of a layer, which without ``keep_outputs`` all layers share."""
        if self._outputs is not None:
            return self._outputs[layer]
        return self._scratch[2][: self._n_vertices * self.mixed[layer].shape[1]].view_as(self.mixed[layer])


def bytes_per_vertex(input_channels: int, widths: Sequence[int], *, value_bytes: int = 4, keep_outputs: bool = True) -> int:
    """Return what :class:`StackBuffers` takes for each vertex."""
    inputs = (input_channels, *widths)[:-1]
    values = sum(widths) + sum(i for i, o in zip(inputs, widths, strict=True) if i < o)
    values += max(input_channels, *widths) * (2 if keep_outputs else 3)
    return value_bytes * (values + (sum(widths) if keep_outputs else 0))


def gcn_stack(
    features: Tensor,
    propagation: Tensor,
    convolutions: Iterable[Any],
    normalisations: Iterable[Any],
    buffers: StackBuffers,
    *,
    moments: Sequence[Moments] | None = None,
) -> Tensor:
    """Return the output of the last layer, (V, out).

    A backward pass belongs to the last forward pass through the same buffers.

    Args:
        features: (V, in).
        propagation: P, symmetric CSR matrix (V, V), of the type of the buffers.
        convolutions: the layers, each a :class:`dmp.layers.GraphConvolution`.
        normalisations: the ``BatchNorm1d`` after each.
        buffers: made for these sizes.
        moments: by which each layer is normalised, where the vertices are only some of those of the mesh; by default those
            of the vertices at hand.
    """
    parameters = [
        parameter
        for convolution, normalisation in zip(convolutions, normalisations, strict=True)
        for parameter in (convolution.weight, convolution.bias, normalisation.weight, normalisation.bias)
    ]
    return _GcnStack.apply(features, propagation, buffers, moments, *parameters)  # type: ignore[no-untyped-call]


def propagate(matrix: Tensor, features: Tensor, out: Tensor) -> None:
    """Write ``matrix @ features`` to ``out``."""
    if features.dtype == torch.bfloat16:
        # The library behind the product below has no kernel for it.
        out.copy_(torch.sparse.mm(matrix, features, "sum"))
        return
    # As a sum with 0 times the output: a plain product fills fresh memory with zeros first, and copies afterwards.
    torch.addmm(out, matrix, features, beta=0, out=out)


def normalise_and_activate(mixed: Tensor, gamma: Tensor, beta: Tensor, out: Tensor) -> Moments:
    """Write y to ``out`` for z, and return the moments of z."""
    mean, over_deviation = torch.empty_like(gamma), torch.empty_like(gamma)
    torch.native_batch_norm(mixed, gamma, beta, None, None, True, 0.0, _EPSILON, out=(out, mean, over_deviation))
    functional.leaky_relu(out, SLOPE, inplace=True)
    return mean, over_deviation


def _normalise_by(moments: Moments, mixed: Tensor, gamma: Tensor, beta: Tensor, out: Tensor) -> Moments:
    """Write y to ``out`` for z and given moments, and return these."""
    mean, over_deviation = moments
    scale = gamma * over_deviation
    torch.addcmul((beta - mean * scale).to(mixed.dtype), mixed, scale.to(mixed.dtype), out=out)
    functional.leaky_relu(out, SLOPE, inplace=True)
    return moments


class _GcnStack(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        features: Tensor,
        propagation: Tensor,
        buffers: StackBuffers,
        moments: Sequence[Moments] | None,
        *parameters: Tensor,
    ) -> Tensor:
        buffers.generation += 1
        ctx.generation, ctx.buffers, ctx.propagation = buffers.generation, buffers, propagation
        ctx.features = current = features.to(buffers.dtype)
        ctx.parameters = parameters
        ctx.moments, ctx.are_given = [], moments is not None
        for layer, (weight, _, gamma, beta) in enumerate(_by_layer(parameters)):
            rounded = weight.to(buffers.dtype)
            mixed, gathered, output = buffers.mixed[layer], buffers.gathered[layer], buffers.output(layer)
            if gathered is not None:
                propagate(propagation, current, gathered)
                torch.mm(gathered, rounded, out=mixed)
            else:
                product = buffers.scratch(0, weight.shape[1])
                torch.mm(current, rounded, out=product)
                propagate(propagation, product, mixed)
            if moments is None:
                ctx.moments.append(normalise_and_activate(mixed, gamma, beta, output))
            else:
                ctx.moments.append(_normalise_by(moments[layer], mixed, gamma, beta, output))
            current = output
        # A copy, because the buffer is written again in the next step.
        return current.to(features.dtype, copy=True)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        buffers: StackBuffers = ctx.buffers
        if buffers.generation != ctx.generation:
            raise RuntimeError("The buffers of the network have been used by another forward pass since.")
        layers = _by_layer(ctx.parameters)
        found: list[Tensor | None] = []
        current = buffers.scratch(0, gradients[0].shape[1])
        current.copy_(gradients[0])
        for layer in reversed(range(len(layers))):
            weight, bias, gamma, _ = layers[layer]
            mean, over_deviation = ctx.moments[layer]
            mixed, output = buffers.mixed[layer], buffers.output(layer)
            torch.ops.aten.leaky_relu_backward.grad_input(current, output, SLOPE, True, grad_input=current)
            current, of_gamma, of_beta = _through_normalisation(current, mixed, gamma, mean, over_deviation)
            rounded = weight.to(buffers.dtype)
            needs_more = layer > 0 or ctx.needs_input_grad[0]
            before = ctx.features if layer == 0 else buffers.output(layer - 1)
            if not buffers.keep_outputs and layer > 0:
                # By the very operation of the forward pass, so that not a digit differs.
                if ctx.are_given:
                    _normalise_by(ctx.moments[layer - 1], buffers.mixed[layer - 1], *layers[layer - 1][2:], before)
                else:
                    normalise_and_activate(buffers.mixed[layer - 1], *layers[layer - 1][2:], before)
            gathered = buffers.gathered[layer]
            if gathered is not None:
                of_weight = torch.mm(gathered.T, current)
                if needs_more:
                    product = buffers.scratch(1, weight.shape[0])
                    torch.mm(current, rounded.T, out=product)
                    current = buffers.scratch(0, weight.shape[0])
                    propagate(ctx.propagation, product, current)
            else:
                spread = buffers.scratch(1, weight.shape[1])
                propagate(ctx.propagation, current, spread)
                of_weight = torch.mm(before.T, spread)
                if needs_more:
                    current = buffers.scratch(0, weight.shape[0])
                    torch.mm(spread, rounded.T, out=current)
            found[:0] = [of_weight.to(weight.dtype), torch.zeros_like(bias), of_gamma, of_beta]
        of_features = current.to(ctx.features.dtype, copy=True) if ctx.needs_input_grad[0] else None
        return of_features, None, None, None, *found


def _by_layer(parameters: Sequence[Tensor]) -> list[tuple[Tensor, Tensor, Tensor, Tensor]]:
    return [(parameters[k], parameters[k + 1], parameters[k + 2], parameters[k + 3]) for k in range(0, len(parameters), 4)]


def _through_normalisation(
    gradient: Tensor, mixed: Tensor, gamma: Tensor, mean: Tensor, over_deviation: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Return the gradients of z (V, C), gamma and beta (C,) for that of u; ``gradient`` may be written to.

    With g = gradient of u and h = (z - mean) / deviation the gradient of z is
    gamma / deviation (g - mean(g) - h mean(g h)) (Ioffe & Szegedy 2015, section 3).
    """
    if gradient.dtype != torch.bfloat16:
        of_mixed, of_gamma, of_beta = torch.ops.aten.native_batch_norm_backward(
            gradient, mixed, gamma, None, None, mean, over_deviation, True, _EPSILON, [True, True, True]
        )
        return of_mixed, of_gamma, of_beta
    # The library's own is twenty times slower for bfloat16. Sums are taken in float32, over parts that stay in the cache.
    n_vertices, channels = gradient.shape
    rows = min(n_vertices, max(1, _CHUNK_VALUES // channels))
    starts = range(0, n_vertices, rows)
    ones = torch.ones((1, rows))
    sums = torch.empty((len(starts), 2, 1, channels))
    for start, (sum_here, product_here) in zip(starts, sums, strict=True):
        here = gradient[start : start + rows].float()
        torch.mm(ones[:, : len(here)], here, out=sum_here)
        torch.mm(ones[:, : len(here)], here.mul_(mixed[start : start + rows]), out=product_here)
    of_beta, with_mixed = sums.sum(dim=0)[:, 0]
    of_gamma = (with_mixed - mean * of_beta) * over_deviation
    scale = gamma * over_deviation
    slope = -scale * over_deviation * of_gamma / n_vertices
    constant = -scale * of_beta / n_vertices - mean * slope
    for start in starts:
        here = gradient[start : start + rows]
        here.copy_(here.float().mul_(scale).addcmul_(mixed[start : start + rows].float(), slope).add_(constant))
    return gradient, of_gamma, of_beta
