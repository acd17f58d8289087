"""How a bilateral layer finds features of a face, its weight and its gate, in compiled kernels; on the processor in float32."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from dmp.compiled import update_kernels
from dmp.compiled.phases import launch_phases
from dmp.compiled.update_kernels import BLOCK, SUMS, SUMS_OF_FIRST, WIDTH
from dmp.recorrupted.compiled_passes import addresses


@dataclass(frozen=True, eq=False)
class UpdateLayers:
    """The layers that are gone through, see :mod:`dmp.compiled.update_kernels`."""

    first: nn.Linear
    second: nn.Linear
    norm: nn.LayerNorm
    own_weight: nn.Linear
    gate: nn.Linear

    @property
    def are_served(self) -> bool:
        """Whether the kernels are made for layers of this width."""
        return self.second.in_features == self.second.out_features == WIDTH and self.norm.eps == update_kernels.EPSILON

    @property
    def parameters(self) -> tuple[Tensor, ...]:
        """Weights and biases, in the order of the gradients."""
        weighing, gating = (self.own_weight.weight, self.own_weight.bias), (self.gate.weight, self.gate.bias)
        first, second = (self.first.weight, self.first.bias), (self.second.weight, self.second.bias)
        return *first, *second, self.norm.weight, self.norm.bias, *weighing, *gating


class _Update(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        hidden, told, areas, first, b, second, c, gamma, beta, w, v, u, t = (part.contiguous() for part in inputs)
        n_faces = len(hidden)
        z = torch.mm(hidden, first[:, :WIDTH].t()).addmm_(told, first[:, WIDTH:].t())
        activated, out, normalised = torch.empty_like(z), torch.empty_like(z), torch.empty_like(z)
        launch_phases(update_kernels.activate, 1, n_faces, *addresses(z, b, activated), n_faces)
        y = torch.mm(activated, second.t())
        kept, own, gates = torch.empty(3, -(-n_faces // 4) * 4), torch.empty(n_faces), torch.empty(n_faces)
        arrays = hidden, y, areas, c, gamma, beta, w, u, torch.cat([v, t]), normalised, kept, out, own, gates
        launch_phases(update_kernels.settle, 1, n_faces, *addresses(*arrays), n_faces)
        ctx.save_for_backward(hidden, told, areas, first, b, second, gamma, beta, w, u)
        ctx.kept = z, activated, normalised, kept
        return out, own, gates

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, ...]:
        hidden, told, areas, first, b, second, gamma, beta, w, u = ctx.saved_tensors
        z, activated, normalised, kept = ctx.kept
        n_faces = len(hidden)
        n_blocks = -(-n_faces // BLOCK)
        of_hidden, of_areas = torch.empty_like(z), torch.empty(n_faces)
        sums, joined = torch.empty(n_blocks, SUMS), torch.empty(SUMS, dtype=torch.float64)
        of_parameters = torch.empty(5 * WIDTH + 2)
        given = *(gradient.contiguous() for gradient in gradients), areas, gamma, beta, w, u, normalised, kept
        arrays = *given, of_hidden, of_areas, sums, joined, of_parameters
        launch_phases(update_kernels.settle_backward, 2, n_faces, *addresses(*arrays), n_faces, n_blocks)
        of_c, of_beta, of_gamma, of_w, of_u, of_v, of_t = torch.split(of_parameters, [WIDTH] * 5 + [1, 1])

        of_second = torch.mm(of_hidden.t(), activated)
        of_z, of_b = torch.mm(of_hidden, second), torch.empty(WIDTH)
        sums = torch.empty(n_blocks, SUMS_OF_FIRST)
        arrays = z, b, of_z, sums, joined, of_b
        launch_phases(update_kernels.activate_backward, 2, n_faces, *addresses(*arrays), n_faces, n_blocks)
        of_first = torch.cat([torch.mm(of_z.t(), hidden), torch.mm(of_z.t(), told)], dim=1)
        of_told = torch.mm(of_z, first[:, WIDTH:])
        # What r has of the features themselves, and what the first product has.
        of_hidden.addmm_(of_z, first[:, :WIDTH])
        of_layers = of_first, of_b, of_second, of_c, of_gamma, of_beta, of_w.view_as(w), of_v, of_u.view_as(u), of_t
        return of_hidden, of_told, of_areas, *of_layers


def update(hidden: Tensor, told: Tensor, areas: Tensor, layers: UpdateLayers) -> tuple[Tensor, Tensor, Tensor]:
    """Return new features (F, 24), own weights (F,), and gates (F,).

    Args:
        hidden: features, (F, 24).
        told: sums of messages, (F, M).
        areas: lengths of area vectors, (F,).
        layers: what is done with them.
    """
    return _Update.apply(hidden, told, areas, *layers.parameters)  # type: ignore[no-untyped-call]
