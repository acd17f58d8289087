"""The paper's series of graph convolutions as one operation with its own backward pass and buffers that are used again.

Written with one automatic derivative a layer, a step of the published network spends two fifths of its time outside the matrix
products: on fresh memory for each result, on zeros that are overwritten, on a dozen passes over the same values, on a bias that
batch normalisation takes off again. Here each layer is

    z = P x W,    u = gamma (z - mean) / deviation + beta,    y = LeakyReLU(u),

with the sparse product P taken on the narrower side, and all that is no matrix product done by compiled kernels in few passes:
y is made where the next layer needs it, and sums over the vertices are taken of what has just been written. In float32, where
weights can be packed, all layers are one launch (:mod:`dmp.compiled.fused_stack`); what follows here is for all else. The bias
of a convolution in front of a batch normalisation changes nothing, so it is left out, and its gradient is exactly 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from dmp.compiled.blocked_matrix import BlockedMatrix
from dmp.compiled.layer_steps import Backward, Derivative, Forward, Normalised
from dmp.layers.stack_buffers import StackBuffers

# Mean and 1 / deviation of each channel over the vertices, (C,) both.
Moments: TypeAlias = tuple[Tensor, Tensor]


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
        propagation: P, symmetric CSR matrix (V, V).
        convolutions: the layers, each a :class:`dmp.layers.GraphConvolution`.
        normalisations: the ``BatchNorm1d`` after each.
        buffers: made for these sizes.
        moments: by which each layer is normalised, where the vertices are only some of those of the mesh; by default those
            of the vertices at hand.
    """
    parameters = layer_parameters(convolutions, normalisations)
    return _GcnStack.apply(features, propagation, buffers, moments, *parameters)  # type: ignore[no-untyped-call]


def layer_parameters(convolutions: Iterable[Any], normalisations: Iterable[Any]) -> list[Tensor]:
    """Return weight, bias, gamma and beta of each layer, one after the other."""
    return [
        parameter
        for convolution, normalisation in zip(convolutions, normalisations, strict=True)
        for parameter in (convolution.weight, convolution.bias, normalisation.weight, normalisation.bias)
    ]


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
        ctx.generation, ctx.buffers, ctx.parameters = buffers.generation, buffers, parameters
        if buffers.fused is not None:
            return buffers.fused.forward(features, buffers.blocked(propagation), parameters, moments)
        ctx.features = features.to(buffers.dtype).contiguous()
        ctx.matrix = matrix = buffers.blocked(propagation)
        passes = buffers.passes
        normalised: list[Normalised] = []
        ctx.normalised = normalised
        for layer, (weight, _, gamma, beta) in enumerate(_by_layer(parameters)):
            rounded = weight.to(buffers.dtype)
            mixed, gathered = buffers.mixed[layer], buffers.gathered[layer]
            if layer == 0:
                found = _first_forward(ctx.features, rounded, buffers, matrix)
            elif gathered is not None:
                before, activated = (buffers.mixed[layer - 1], normalised[-1]), buffers.scratch(0, weight.shape[0])
                found = passes.forward_gathering(Forward(matrix, before, rounded, activated, gathered, mixed))
            else:
                before, product = (buffers.mixed[layer - 1], normalised[-1]), buffers.scratch(0, weight.shape[1])
                output = buffers.output(layer - 1)
                found = passes.forward_multiplying(Forward(matrix, before, rounded, output, product, mixed))
            normalised.append(Normalised.by(*(found if moments is None else moments[layer]), gamma, beta))
        # Fresh memory, because the buffers are written again in the next step.
        output = torch.empty_like(mixed)
        passes.activate(mixed, normalised[-1], output)
        return output.to(features.dtype)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        buffers: StackBuffers = ctx.buffers
        if buffers.generation != ctx.generation:
            raise RuntimeError("The buffers of the network have been used by another forward pass since.")
        if buffers.fused is not None:
            of_features, of_parameters = buffers.fused.backward(gradients[0], of_features=ctx.needs_input_grad[0])
            return of_features, None, None, None, *of_parameters
        layers, normalised, matrix, passes = _by_layer(ctx.parameters), ctx.normalised, ctx.matrix, buffers.passes
        found: list[Tensor | None] = []
        # The gradient of y changes its place from layer to layer, because rows of the next one are made before it is used up.
        place = 0
        current = buffers.scratch(place, gradients[0].shape[1])
        current.copy_(gradients[0])
        derivative = passes.sums(current, buffers.mixed[-1], normalised[-1])
        for layer in reversed(range(1, len(layers))):
            weight, bias, _, _ = layers[layer]
            own, before = (buffers.mixed[layer], normalised[layer]), (buffers.mixed[layer - 1], normalised[layer - 1])
            rounded, gathered = weight.to(buffers.dtype), buffers.gathered[layer]
            found[:0] = [None, torch.zeros_like(bias), derivative.of_gamma, derivative.of_beta]
            place = 2 - place
            of_before = buffers.scratch(place, weight.shape[0])
            between = buffers.scratch(1, weight.shape[1 if gathered is None else 0])
            step = Backward(matrix, current, own, derivative, rounded, between, of_before, before)
            if gathered is not None:
                derivative = passes.backward_gathering(step)
                found[0] = torch.mm(gathered.T, current).to(weight.dtype)
            else:
                derivative = passes.backward_multiplying(step)
                output = buffers.output(layer - 1)
                if not buffers.keep_outputs:
                    # By the very operation of the forward pass, so that not a digit differs.
                    passes.activate(*before, output)
                found[0] = torch.mm(output.T, between).to(weight.dtype)
            current = of_before
        of_features, of_weight = _first_backward(ctx, current, derivative, buffers.scratch(1, layers[0][0].shape[1]))
        first = [of_weight, torch.zeros_like(layers[0][1]), derivative.of_gamma, derivative.of_beta]
        return of_features, None, None, None, *first, *found


def _first_forward(features: Tensor, weight: Tensor, buffers: StackBuffers, matrix: BlockedMatrix) -> Moments:
    """Write z of the first layer, and return its moments."""
    passes, mixed, gathered = buffers.passes, buffers.mixed[0], buffers.gathered[0]
    if gathered is not None:
        passes.gather(matrix, features, gathered)
        torch.mm(gathered, weight, out=mixed)
        return passes.moments(mixed)
    product = buffers.scratch(0, weight.shape[1])
    torch.mm(features, weight, out=product)
    return passes.gather_moments(matrix, product, mixed)


def _first_backward(ctx: Any, gradient: Tensor, derivative: Derivative, spread: Tensor) -> tuple[Tensor | None, Tensor]:
    """Return the gradients of the features, where they are wanted, and of the first weights, for that of the first y."""
    buffers: StackBuffers = ctx.buffers
    weight: Tensor = ctx.parameters[0]
    passes, gathered = buffers.passes, buffers.gathered[0]
    if gathered is None:
        passes.derive_gather(ctx.matrix, gradient, (buffers.mixed[0], ctx.normalised[0]), derivative, spread)
        of_weight = torch.mm(ctx.features.T, spread)
    else:
        passes.derive(gradient, buffers.mixed[0], ctx.normalised[0], derivative)
        of_weight = torch.mm(gathered.T, gradient)
    if not ctx.needs_input_grad[0]:
        return None, of_weight.to(weight.dtype)
    if gathered is None:
        of_features = torch.mm(spread, weight.T.to(buffers.dtype))
    else:
        of_features = torch.empty_like(gathered)
        passes.gather(ctx.matrix, torch.mm(gradient, weight.T.to(buffers.dtype)), of_features)
    return of_features.to(weight.dtype), of_weight.to(weight.dtype)


def _by_layer(parameters: Sequence[Tensor]) -> list[tuple[Tensor, Tensor, Tensor, Tensor]]:
    return [(parameters[k], parameters[k + 1], parameters[k + 2], parameters[k + 3]) for k in range(0, len(parameters), 4)]
