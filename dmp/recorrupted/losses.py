"""The two terms of the loss; for both the expectation over the noise is that against the true shape, plus a constant."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

# Length of an area vector, in squared mean edge lengths, below which a face has no more say: the normal of a sliver turns
# by any angle at the least movement, and a few of those would drown the gradients of all others.
_SLIVER = 0.05


def position_errors(predicted: Tensor, target: Tensor) -> Tensor:
    """Return || q_i - t_i ||^2 at each vertex, (N,), for predicted and recorrupted positions, (N, 3) both."""
    return (predicted - target).square().sum(dim=1)


def normal_errors(predicted: Tensor, target: Tensor, scale: Tensor) -> Tensor:
    """Return - n_f(q) . A_f(t) / Abar_f at each face, (N,).

    It is linear in the area vector of the target, whose expectation is the true area vector, so it rewards the cosine to
    the *true* normals.

    Args:
        predicted: area vectors of the prediction, (N, 3); only their directions count, but for slivers.
        target: area vectors of the recorrupted target, (N, 3).
        scale: Abar, a positive length for each face, (N, 1).
    """
    normals = functional.normalize(predicted, dim=1, eps=_SLIVER)
    return -(normals * target / scale).sum(dim=1)


def weighted(position: Tensor, normal: Tensor, normal_weight: float) -> Tensor:
    """Return the total loss."""
    return torch.add(position, normal, alpha=normal_weight)
