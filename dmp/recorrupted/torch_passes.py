"""Passes over normals and vertices in operations of torch, on any device, in any precision; see :mod:`dmp.recorrupted.passes`.

Their backward passes are written out by hand because autograd would keep and revisit every intermediate of every pass.
"""

from __future__ import annotations

import warnings
from typing import Any

import torch
from torch import Tensor

from dmp.compiled.normal_kernels import EPSILON, LEAST_AGREEMENT
from dmp.recorrupted.products import Incidence


def _face_matrix(own: Tensor, weights: Tensor, incidence: Incidence) -> Tensor:
    """Return the CSR matrix (F, F) with ``own`` (F,) on the diagonal and ``weights`` (3, F) at the neighbours."""
    values = torch.stack([own, *weights], dim=1)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Sparse CSR tensor support is in beta")
        return torch.sparse_csr_tensor(
            incidence.face_rows, incidence.face_columns, values.reshape(-1), size=(len(own), len(own)), check_invariants=False
        )


class NormalPasses(torch.autograd.Function):
    """See :func:`dmp.recorrupted.passes.average_normals`."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:
        """Find the result."""
        own, weights, normals, incidence, passes = inputs
        matrix = _face_matrix(own, weights, incidence)
        least = (LEAST_AGREEMENT * (own.abs() + weights.abs().sum(dim=0))).clamp_min_(EPSILON)[:, None]
        stages, lengths, unit = [normals], [], []
        for _ in range(passes):
            summed = matrix @ stages[-1]
            length = summed.norm(dim=1, keepdim=True)
            unit.append(length > least)
            length = torch.maximum(length, least)
            stages.append(summed / length)
            lengths.append(length)
        # The output must be a saved tensor: held by the context itself it would hold the context in turn, and both would stay
        # until the garbage collector finds them, gigabytes later. What lies before it is made here and nobody else changes it.
        ctx.save_for_backward(own, weights, stages[-1])
        ctx.earlier, ctx.lengths, ctx.unit, ctx.incidence = stages[:-1], lengths, unit, incidence
        return stages[-1]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor, None, None]:
        """Find the gradients."""
        own, weights, last = ctx.saved_tensors
        incidence, gradient = ctx.incidence, gradients[0]
        stages = [*ctx.earlier, last]
        transposed = _face_matrix(own, weights.reshape(-1).index_select(0, incidence.back).view(weights.shape), incidence)
        of_sums = []
        for stage, length, unit in zip(reversed(stages[1:]), reversed(ctx.lengths), reversed(ctx.unit), strict=True):
            # The bound itself counts as a constant.
            of_sum = (gradient - unit * stage * (stage * gradient).sum(dim=1, keepdim=True)) / length
            of_sums.append(of_sum)
            gradient = transposed @ of_sum
        if not of_sums:
            return torch.zeros_like(own), torch.zeros_like(weights), gradient, None, None
        before, after = torch.cat(stages[-2::-1], dim=1), torch.cat(of_sums, dim=1)
        around = before.index_select(0, incidence.neighbours).view(3, *before.shape)
        return (after * before).sum(dim=1), (after * around).sum(dim=2), gradient, None, None


class VertexPasses(torch.autograd.Function):
    """See :func:`dmp.recorrupted.passes.follow_normals`."""

    # Coordinates come first in here, (3, V) and (3, F), so that products run along the long dimension.
    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:
        """Find the result."""
        positions, normals, gates, incidence, passes = inputs
        normals = normals.t().contiguous()
        moved = positions.t().contiguous()
        kept = []
        for _ in range(passes):
            corners = moved.index_select(1, incidence.corners).view(3, 3, -1)
            heights = (corners * normals[:, None]).sum(dim=0)
            distances = heights.mean(dim=0) - heights
            kept.append((corners, distances))
            moved = moved + _to_vertices((distances * gates) * normals[:, None], incidence)
        ctx.save_for_backward(normals, gates)
        ctx.kept, ctx.incidence = kept, incidence
        return moved.t().contiguous()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor, None, None]:
        """Find the gradients."""
        normals, gates = ctx.saved_tensors
        incidence, gradient = ctx.incidence, gradients[0].t().contiguous()
        of_normals, of_gates = torch.zeros_like(normals), torch.zeros_like(gates)
        counts = incidence.corner_counts.t()
        for corners, distances in reversed(ctx.kept):
            around = (gradient / counts).index_select(1, incidence.corners).view(3, 3, -1)
            along = (around * normals[:, None]).sum(dim=0)
            of_gates = of_gates + (distances * along).sum(dim=0)
            of_distances = along * gates
            of_heights = of_distances.mean(dim=0) - of_distances
            of_normals = of_normals + gates * (distances * around).sum(dim=1) + (of_heights * corners).sum(dim=1)
            gradient = gradient + _summed(of_heights * normals[:, None], incidence)
        return gradient.t().contiguous(), of_normals.t(), of_gates, None, None


def _summed(values: Tensor, incidence: Incidence) -> Tensor:
    """Sum values at the corners, (3 coordinates, 3 corners, F), at each vertex, (3, V)."""
    return (incidence.corner_sum @ values.view(3, -1).t().contiguous()).t()


def _to_vertices(values: Tensor, incidence: Incidence) -> Tensor:
    return (_summed(values, incidence).t() / incidence.corner_counts).t()
