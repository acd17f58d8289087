"""The second half of the network: bilateral filtering of the normals, with weights learnt on the face graph."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from dmp.compiled.message_kernels import CHANNELS, LEAST_AREA_VECTOR
from dmp.recorrupted.compiled_messages import tell
from dmp.recorrupted.compiled_passes import serve
from dmp.recorrupted.compiled_update import UpdateLayers, update
from dmp.recorrupted.passes import average_normals, follow_normals
from dmp.recorrupted.products import (
    Incidence,
    area_vectors,
    gather_corners,
    gather_neighbour_rows,
    gather_neighbours,
)

_N_GEOMETRY = 5
_FIRST_SHARPNESS = 3.0


class BilateralLayer(nn.Module):
    """Weights for the neighbours from features of both faces, some passes of averaging the normals, some of moving vertices.

    A weight depends on features and on angles and distances between the two faces alone, so the layer turns with the mesh.

    Args:
        width: channels of a face.
        message_width: channels of what passes from face to face; these are the largest arrays of the whole network.
        normal_passes: how often normals are averaged.
        vertex_passes: how often vertices follow them.
    """

    def __init__(self, width: int, message_width: int, normal_passes: int, vertex_passes: int) -> None:
        super().__init__()
        self.normal_passes, self.vertex_passes = normal_passes, vertex_passes
        self.of_source = nn.Linear(width, message_width, bias=False)
        self.of_target = nn.Linear(width, message_width)
        self.of_geometry = nn.Linear(_N_GEOMETRY, message_width, bias=False)
        self.weight = nn.Linear(message_width, 1)
        # Logarithm of kappa in exp(-kappa (1 - cosine)), which alone makes the classical bilateral filter: a good start.
        self.sharpness = nn.Parameter(torch.tensor(_FIRST_SHARPNESS).log())
        self.update = nn.Sequential(nn.Linear(width + message_width, width), nn.SiLU(), nn.Linear(width, width))
        self.norm = nn.LayerNorm(width)
        self.own_weight = nn.Linear(width, 1)
        self.gate = nn.Linear(width, 1)
        nn.init.zeros_(self.own_weight.weight)
        nn.init.zeros_(self.gate.weight)
        nn.init.constant_(self.gate.bias, 1.0)

    def forward(self, positions: Tensor, hidden: Tensor, incidence: Incidence, level: float) -> tuple[Tensor, Tensor]:
        """Return new positions, (V, 3), and new features of the faces, (F, H)."""
        weights, told, normals, areas = self.messages(positions, hidden, incidence, level)
        hidden, own, gates = self.updated(hidden, told, areas)
        normals = average_normals(own, weights, normals, incidence, self.normal_passes)
        return follow_normals(positions, normals, gates, incidence, self.vertex_passes), hidden

    def updated(self, hidden: Tensor, told: Tensor, areas: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return new features (F, H), the faces' own weights (F,), and their gates (F,), as :meth:`messages` does."""
        first, _, second = self.update
        assert isinstance(first, nn.Linear)
        assert isinstance(second, nn.Linear)
        layers = UpdateLayers(first, second, self.norm, self.own_weight, self.gate)
        if serve(hidden) and layers.are_served:
            return update(hidden, told, areas, layers)
        hidden = self.norm(hidden + self.update(torch.cat([hidden, told], dim=1)))
        own = functional.softplus(self.own_weight(hidden))[:, 0] * areas
        return hidden, own, torch.sigmoid(self.gate(hidden))[:, 0]

    def messages(
        self, positions: Tensor, hidden: Tensor, incidence: Incidence, level: float
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return weights (3, F), sums of messages (F, M), normals (F, 3), and lengths of area vectors (F,).

        Compiled kernels find them where they can, operations of torch elsewhere; both compute the same up to rounding.
        """
        if self.has_kernels(positions):
            return self.tell(positions, self._both(hidden), incidence, level)
        return self._messages(positions, hidden, incidence, level)

    def has_kernels(self, positions: Tensor) -> bool:
        """Return whether there are compiled kernels for this layer and tensors like this one."""
        return serve(positions) and self.weight.in_features == CHANNELS

    def _both(self, hidden: Tensor) -> Tensor:
        """Return what faces give as sources and as targets side by side, (F, 2 M)."""
        bias = self.of_target.bias
        weight = torch.cat([self.of_source.weight, self.of_target.weight])
        return functional.linear(hidden, weight, torch.cat([torch.zeros_like(bias), bias]))

    def tell(
        self, positions: Tensor, both: Tensor, incidence: Incidence, level: float
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return what :meth:`messages` does, with compiled kernels, for what faces give as sources and as targets (F, 2 M)."""
        numbers = self.of_geometry.weight.t(), self.weight.weight, self.weight.bias, self.sharpness.exp()
        return tell(positions, both, numbers, incidence, level)

    def _messages(
        self, positions: Tensor, hidden: Tensor, incidence: Incidence, level: float
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        corners = gather_corners(positions, incidence)
        vectors = area_vectors(corners)
        areas = vectors.norm(dim=1).clamp_min(LEAST_AREA_VECTOR)
        normals = vectors / areas[:, None]
        geometry, around = self._geometry(normals, corners.mean(dim=0), areas, incidence, level)
        told = functional.silu(
            gather_neighbours(self.of_source(hidden), incidence) + (self.of_target(hidden) + self.of_geometry(geometry))
        )
        if not incidence.complete:
            told = told * incidence.signs.abs()
        alike = torch.exp(self.sharpness.exp() * (geometry[:, :, 0] - 1))
        weights = functional.softplus(self.weight(told))[:, :, 0] * alike * around * incidence.signs[:, :, 0]
        return weights, told.sum(dim=0), normals, areas

    def _geometry(
        self, normals: Tensor, centres: Tensor, areas: Tensor, incidence: Incidence, level: float
    ) -> tuple[Tensor, Tensor]:
        """Return what a face sees of each neighbour, (3, F, G), and the area vectors' lengths of the neighbours, (3, F)."""
        # Coordinates first, so that products run along the long dimension.
        own = torch.cat([normals.t(), centres.t(), areas[None]])
        around = gather_neighbour_rows(own, incidence)
        there, away, area = around[:3], around[3:6] - own[3:6, None], around[6]
        if not incidence.complete:
            there = there * incidence.signs[:, :, 0]
        here = own[:3, None]
        seen = [
            (there * here).sum(dim=0),
            torch.sqrt((away * away).sum(dim=0) + 1e-12),
            (away * here).sum(dim=0) / level,
            (away * there).sum(dim=0) / level,
            torch.log(area + 0.1),
        ]
        return torch.stack(seen).permute(1, 2, 0), area
