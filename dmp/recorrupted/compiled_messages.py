"""What faces tell their neighbours in a bilateral layer, in compiled kernels; on the processor in float32."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from dmp.compiled import message_back_kernels, message_kernels
from dmp.compiled.phases import launch_phases
from dmp.recorrupted.compiled_passes import addresses
from dmp.recorrupted.products import Incidence

CHANNELS = message_kernels.CHANNELS


class _Messages(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        positions, both, geometry, weight, bias, kappa, incidence, level = inputs
        positions, both, geometry, weight = (part.contiguous() for part in (positions, both, geometry, weight))
        layout, n_faces = incidence.layout, incidence.n_faces
        n_padded = layout.n_padded
        numbers = torch.tensor((bias.item(), kappa.item(), 1 / level))
        own, logits = torch.empty(n_padded, 8), torch.empty(3, n_padded)
        given = (
            positions,
            layout.corners,
            layout.around,
            both,
            geometry,
            weight,
            numbers,
            own,
            layout.signs,
            layout.turns,
            logits,
        )
        weights, total = torch.empty(3, n_faces), torch.empty(n_padded, CHANNELS)
        normals, areas = torch.empty(n_faces, 3), torch.empty(n_faces)
        results = weights, total, normals, areas
        launch_phases(message_kernels.tell, 2, n_faces, *addresses(*given, *results), n_faces, n_padded)
        ctx.save_for_backward(positions, both, geometry, weight)
        ctx.rest = numbers, own, logits, incidence
        return weights, total[:n_faces], normals, areas

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        positions, both, geometry, weight = ctx.saved_tensors
        numbers, own, logits, incidence = ctx.rest
        layout, n_faces, n_vertices = incidence.layout, incidence.n_faces, len(positions)
        n_padded = layout.n_padded
        n_blocks = -(-n_padded // message_back_kernels.BLOCK)
        given = (
            positions,
            layout.corners,
            layout.around,
            both,
            geometry,
            weight,
            numbers,
            own,
            layout.signs,
            layout.turns,
            logits,
        )
        of_results = [gradient.contiguous() for gradient in gradients]
        places = [torch.empty(n_padded, width) for width in (3 * CHANNELS, 24, 8, 12)]
        sums = torch.empty(n_blocks, message_back_kernels.SUMS), torch.empty(message_back_kernels.SUMS, dtype=torch.float64)
        of_parameters = torch.empty(geometry.numel() + weight.numel() + 2)
        of_positions, of_both = torch.empty_like(positions), torch.empty_like(both)
        where = layout.slots_back, layout.starts, layout.corner_places
        arrays = addresses(*given, *of_results, *places, *where, *sums, of_positions, of_both, of_parameters)
        launch_phases(message_back_kernels.tell_backward, 3, n_faces, *arrays, n_faces, n_padded, n_vertices, n_blocks)
        of_geometry, of_weight, of_bias, of_kappa = torch.split(of_parameters, [geometry.numel(), weight.numel(), 1, 1])
        return (
            of_positions,
            of_both,
            of_geometry.view_as(geometry),
            of_weight.view_as(weight),
            of_bias,
            of_kappa.view(()),
            None,
            None,
        )


def tell(
    positions: Tensor,
    both: Tensor,
    numbers: tuple[Tensor, Tensor, Tensor, Tensor],
    incidence: Incidence,
    level: float,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return weights (3, F), sums of messages (F, 12), normals (F, 3), and lengths of area vectors (F,).

    Args:
        positions: (V, 3).
        both: S and T of each face in a row, (F, 24); see :mod:`dmp.compiled.message_kernels`.
        numbers: G transposed, (5, 12); w, (1, 12); b, (1,); kappa, (,).
        incidence: of the mesh.
        level: of the noise.
    """
    return _Messages.apply(positions, both, *numbers, incidence, level)  # type: ignore[no-untyped-call]
