"""Products with one sparse matrix again and again, as averaging over neighbours does.

A compiled kernel takes them on the processor in float32, operations of torch elsewhere; both compute the same up to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from dmp.compiled import diffusion_kernels
from dmp.compiled.phases import launch_phases
from dmp.recorrupted.compiled_passes import addresses, serve

_LARGEST_WIDTH = 4


def diffused_at(matrix: Tensor, values: Tensor, steps: Sequence[int]) -> Tensor:
    """Return P^k x for each number k of ``steps``, (K, V, C), not differentiable.

    Args:
        matrix: P, (V, V) CSR.
        values: x, (V, C).
        steps: ascending, not negative.
    """
    if serve(values) and values.shape[1] <= _LARGEST_WIDTH:
        return _compiled(matrix, values.detach(), steps)
    found, done = [], 0
    values = values.detach()
    for step in steps:
        for _ in range(step - done):
            values = matrix @ values
        found.append(values)
        done = step
    return torch.stack(found)


def diffused(matrix: Tensor, transposed: Tensor, values: Tensor, steps: int) -> Tensor:
    """Return P^k x, (V, C), for k = ``steps`` and x = ``values`` (V, C); ``transposed`` serves the backward pass."""
    return _Diffused.apply(matrix, transposed, values, steps)  # type: ignore[no-untyped-call]


class _Diffused(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, matrix: Tensor, transposed: Tensor, values: Tensor, steps: int) -> Tensor:
        ctx.transposed, ctx.steps = transposed, steps
        return diffused_at(matrix, values, (steps,))[0]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[None, None, Tensor, None]:
        return None, None, diffused_at(ctx.transposed, gradients[0], (ctx.steps,))[0], None


def _compiled(matrix: Tensor, values: Tensor, steps: Sequence[int]) -> Tensor:
    n_vertices, channels = values.shape
    most = steps[-1]
    places = torch.full((most + 1,), -1, dtype=torch.int32)
    places[list(steps)] = torch.arange(len(steps), dtype=torch.int32)
    fours = torch.empty(2, n_vertices, 4)
    out = torch.empty(len(steps), n_vertices, channels)
    arrays = matrix.crow_indices(), matrix.col_indices(), matrix.values(), values.contiguous(), fours[0], fours[1], places, out
    launch_phases(diffusion_kernels.diffuse, most + 1, n_vertices, *addresses(*arrays), n_vertices, channels)
    return out
