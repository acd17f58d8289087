"""What a layer has on its way forward and backward."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from torch import Tensor

from dmp.compiled.blocked_matrix import BlockedMatrix


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


@dataclass(frozen=True, eq=False)
class Forward:
    """From the z of the layer before to that of a layer.

    Attributes:
        matrix: P.
        before: the layer before.
        weight: W, (in, out).
        activated: place for the y before, (V, in).
        between: place for P y, (V, in), or y W, (V, out): whichever comes first.
        mixed: place for z = P y W, (V, out).
    """

    matrix: BlockedMatrix
    before: Layer
    weight: Tensor
    activated: Tensor
    between: Tensor
    mixed: Tensor


@dataclass(frozen=True, eq=False)
class Backward:
    """From the gradient of a layer's y to that of the y before.

    Attributes:
        matrix: P.
        gradient: that of y, (V, out); that of z is written over it.
        layer: the layer.
        derivative: of the layer.
        weight: W, (in, out).
        between: place for the gradient of z times the transposed weights, (V, in), or for P times it, (V, out).
        of_before: place for the gradient of the y before, (V, in).
        before: the layer before.
    """

    matrix: BlockedMatrix
    gradient: Tensor
    layer: Layer
    derivative: Derivative
    weight: Tensor
    between: Tensor
    of_before: Tensor
    before: Layer
