"""The network of the method: a learned bank of diffusions, then learned bilateral filtering."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from scipy import sparse
from torch import Tensor, nn

from dmp.mesh import FloatArray, IntArray
from dmp.operators import normalised_adjacency, to_torch
from dmp.recorrupted.bilateral import BilateralLayer
from dmp.recorrupted.diffusion import diffused
from dmp.recorrupted.face_graph import face_graph
from dmp.recorrupted.filter_bank import FilterBank
from dmp.recorrupted.products import Incidence
from dmp.topology import adjacency

_ANCHOR_STEPS = 30
# The flattening layer: so many passes over normals and vertices, and the kappa that they begin with. It reaches far where
# normals agree, and little elsewhere.
_FLATTENING_NORMAL_PASSES, _FLATTENING_VERTEX_PASSES, _FLATTENING_SHARPNESS = 80, 60, 24.0


@dataclass(frozen=True, eq=False)
class Operators:
    """What the network needs to know of a mesh.

    Attributes:
        half_lazy: P = (I + D^-1 A) / 2, (V, V) CSR.
        half_lazy_transposed: its transpose.
        propagation: D^(-1/2) (A + I) D^(-1/2), (V, V) CSR, symmetric.
        incidence: of faces and vertices.
    """

    half_lazy: Tensor
    half_lazy_transposed: Tensor
    propagation: Tensor
    incidence: Incidence

    @classmethod
    def of(cls, faces: IntArray, n_vertices: int, normals: FloatArray, device: torch.device) -> Operators:
        """Build the operators of a mesh whose faces (F, 3) have about the unit ``normals`` (F, 3)."""
        neighbours = adjacency(faces, n_vertices)
        valence = np.maximum(neighbours.sum(axis=1), 1.0)
        half_lazy = 0.5 * (sparse.eye_array(n_vertices) + sparse.diags_array(1.0 / valence) @ neighbours)
        return cls(
            half_lazy=to_torch(sparse.csr_array(half_lazy), device),
            half_lazy_transposed=to_torch(sparse.csr_array(half_lazy.T), device),
            propagation=to_torch(normalised_adjacency(faces, n_vertices), device),
            incidence=Incidence.of(faces, n_vertices, face_graph(faces, normals), device),
        )


class RestorationNetwork(nn.Module):
    """Maps positions to restored positions; turning or moving the input turns and moves the output.

    Args:
        layers: bilateral layers before the flattening one.
        normal_passes: passes over the normals in each.
        vertex_passes: passes over the vertices in each.
        width: channels on the faces.
    """

    def __init__(self, layers: int, normal_passes: int, vertex_passes: int, width: int = 24, message_width: int = 12) -> None:
        super().__init__()
        self.bank = FilterBank()
        self.first = nn.Parameter(torch.zeros(1, width))
        self.anchor = nn.Parameter(torch.ones(()))
        self.layers = nn.ModuleList([BilateralLayer(width, message_width, normal_passes, vertex_passes) for _ in range(layers)])
        self.flattening = BilateralLayer(width, message_width, _FLATTENING_NORMAL_PASSES, _FLATTENING_VERTEX_PASSES)
        with torch.no_grad():
            self.flattening.sharpness.fill_(math.log(_FLATTENING_SHARPNESS))

    @torch.no_grad()
    def set_sharpness(self, sharpness: float) -> None:
        """Start every bilateral layer but the flattening one with this kappa."""
        for layer in self.layers:
            if isinstance(layer, BilateralLayer):
                layer.sharpness.fill_(math.log(sharpness))

    @torch.no_grad()
    def set_flattening(self, gate: float) -> None:
        """Start with vertices that follow the flattening layer by the logistic function of ``gate``."""
        self.flattening.gate.bias.fill_(gate)

    def forward(self, positions: Tensor, operators: Operators, level: float, flatten: bool = True) -> Tensor:
        """Return restored positions, (V, 3), of noisy ``positions`` (V, 3) with noise of about ``level``.

        Without ``flatten`` the flattening layer is left out.
        """
        incidence = operators.incidence
        given = positions
        positions = self.bank(positions, operators.half_lazy, operators.propagation, incidence, level)
        hidden = self.first.expand(incidence.n_faces, -1)
        for layer in self.layers:
            positions, hidden = layer(positions, hidden, incidence, level)
        # What is coarse in the input is hardly noise. Given back, it keeps filtered regions and boundaries in their place. It
        # brings coarse waves of the noise along, which the flattening layer takes out where the surface is flat.
        coarse = diffused(operators.half_lazy, operators.half_lazy_transposed, given - positions, _ANCHOR_STEPS)
        positions = positions + self.anchor * coarse
        if flatten:
            positions, _ = self.flattening(positions, hidden, incidence, level)
        return positions
