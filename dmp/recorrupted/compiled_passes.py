"""Passes over normals and vertices in compiled kernels, on the processor in float32; see :mod:`dmp.recorrupted.passes`."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from dmp.compiled import normal_kernels, vertex_kernels
from dmp.compiled.phases import launch_phases

_FOUR_BYTES = 16


def serve(values: Tensor) -> bool:
    """Return whether the kernels can take tensors like this one."""
    return values.device.type == "cpu" and values.dtype == torch.float32


class NormalPasses(torch.autograd.Function):
    """See :func:`dmp.recorrupted.passes.average_normals`."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:
        """Find the result."""
        own, weights, normals, incidence, passes = inputs
        own, weights, normals = own.contiguous(), weights.contiguous(), normals.contiguous()
        layout, n_faces = incidence.layout, incidence.n_faces
        n_stages = passes + 1 if any(ctx.needs_input_grad) else 2
        stages = torch.empty(n_stages, layout.n_padded, 4)
        packed, least, out = torch.empty(layout.n_padded, 4), torch.empty(layout.n_padded), torch.empty_like(normals)
        given = addresses(own, weights, layout.slots, normals, packed, least, stages, layout.around, out)
        launch_phases(normal_kernels.average, passes + 2, n_faces, *given, n_faces, n_stages, _FOUR_BYTES * layout.n_padded)
        ctx.save_for_backward(own, weights)
        ctx.stages, ctx.incidence, ctx.passes = stages, incidence, passes
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor, None, None]:
        """Find the gradients."""
        own, weights = ctx.saved_tensors
        layout, n_faces, gradient = ctx.incidence.layout, ctx.incidence.n_faces, gradients[0].contiguous()
        if ctx.passes == 0:
            return torch.zeros_like(own), torch.zeros_like(weights), gradient, None, None
        places = [torch.empty(layout.n_padded, 4) for _ in range(4)]
        results = torch.empty_like(own), torch.empty_like(weights), torch.empty(n_faces, 3)
        given = addresses(gradient, own, weights, layout.back, *places, ctx.stages, layout.around, *results)
        stage_bytes = _FOUR_BYTES * layout.n_padded
        launch_phases(normal_kernels.average_backward, ctx.passes + 2, n_faces, *given, n_faces, stage_bytes)
        return *results, None, None


class VertexPasses(torch.autograd.Function):
    """See :func:`dmp.recorrupted.passes.follow_normals`."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:
        """Find the result."""
        positions, normals, gates, incidence, passes = inputs
        positions, normals, gates = positions.contiguous(), normals.contiguous(), gates.contiguous()
        layout, n_faces, n_vertices = incidence.layout, incidence.n_faces, len(positions)
        n_stages = passes + 1 if any(ctx.needs_input_grad) else 2
        stages, out = torch.empty(n_stages, n_vertices, 4), torch.empty_like(positions)
        faces, along, vertices = torch.empty(layout.n_padded, 4), torch.empty(layout.n_padded, 4), torch.empty(n_vertices, 16)
        given = addresses(positions, normals, gates, *layout.of_vertices, faces, vertices, along, stages, out)
        sizes = n_vertices, n_faces, n_stages, _FOUR_BYTES * n_vertices
        launch_phases(vertex_kernels.follow, 2 * passes + 3, n_faces, *given, *sizes)
        ctx.save_for_backward(positions)
        ctx.faces, ctx.vertices, ctx.stages, ctx.incidence, ctx.passes = faces, vertices, stages, incidence, passes
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor, None, None]:
        """Find the gradients."""
        (positions,) = ctx.saved_tensors
        layout, n_faces, n_vertices = ctx.incidence.layout, ctx.incidence.n_faces, len(positions)
        places = [
            torch.empty(layout.n_padded, 4),
            *(torch.empty(n_vertices, 4) for _ in range(3)),
            torch.empty(layout.n_padded, 3),
        ]
        results = torch.empty_like(positions), torch.empty(n_faces, 3), torch.empty(n_faces)
        given = addresses(
            gradients[0].contiguous(), positions, *layout.of_vertices, ctx.faces, ctx.vertices, *places, ctx.stages, *results
        )
        sizes = n_vertices, n_faces, _FOUR_BYTES * n_vertices
        launch_phases(vertex_kernels.follow_backward, 2 * ctx.passes + 2, n_faces, *given, *sizes)
        return *results, None, None


def addresses(*tensors: Tensor) -> tuple[int, ...]:
    """Return where the numbers of the tensors lie."""
    return tuple(tensor.data_ptr() for tensor in tensors)
