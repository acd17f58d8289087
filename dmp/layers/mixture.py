"""The convolution with a mixture of Gaussians of Monti et al. (MoNet, GMMConv)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy import sparse
from torch import Tensor, nn

from dmp.layers.initial_values import glorot_parameter
from dmp.mesh import FloatArray
from dmp.operators import EdgePattern, weighted_product

# Keeps a Gaussian of no width from dividing by zero; the value of the library that the authors used.
_EPSILON = 1e-15
# Smaller weights, below 1e-12, count as 0. In a sum with the vertex's own part they are rounding, but as entries they make
# numbers too small for the processor's fast path, and a step ten times as slow.
_LOWEST_EXPONENT = -28.0


@dataclass(frozen=True, eq=False)
class MixtureGraph:
    """What a mixture convolution needs to know of a mesh.

    Attributes:
        pattern: the directed edges i <- j.
        coordinates: pseudo-coordinates u of each edge, (D, E) float32.
        shares: 1 / |N(i)| of each edge, (E,) float32.
    """

    pattern: EdgePattern
    coordinates: Tensor
    shares: Tensor

    @classmethod
    def of(cls, neighbours: sparse.csr_array, coordinates: FloatArray, device: torch.device | str = "cpu") -> MixtureGraph:
        """Build the tensors for ``coordinates`` (E, D) of the entries of the adjacency matrix (V, V), in its order."""
        valences = np.diff(neighbours.indptr)
        return cls(
            pattern=EdgePattern.of(neighbours, device),
            coordinates=_tensor(coordinates.T, device),
            shares=_tensor(np.repeat(1.0 / np.maximum(valences, 1), valences), device),
        )


def _tensor(values: FloatArray, device: torch.device | str) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32)).to(device)


class MixtureConvolution(nn.Module):
    """x'_i = R x_i + b + sum over k of mean over N(i) of w_k(u_ij) G_k x_j, with learnt Gaussians w_k.

    w_k(u) = exp(-1/2 sum over d of (u_d - mu_kd)^2 / sigma_kd^2) (Monti et al. 2017, eq. 11; Fey & Lenssen's library adds the
    vertex's own part R x_i). What it can tell apart depends on the pseudo-coordinates u of an edge alone; see
    :mod:`dmp.layers.pseudo_coordinates`.

    No array of edges times channels is ever made: each kernel is a sparse matrix with its weights as entries, and the product
    with it is taken on the narrower side of the layer.
    """

    def __init__(
        self, in_channels: int, out_channels: int, *, dimension: int, kernels: int, width: float | None = None
    ) -> None:
        """Make a layer.

        Args:
            in_channels: columns of the features.
            out_channels: columns of the result.
            dimension: number of pseudo-coordinates, D.
            kernels: number of Gaussians, K.
            width: first value of all sigma; by default random, as in the library that the authors used.
        """
        super().__init__()
        self.weight = glorot_parameter(kernels, in_channels, out_channels, fan_in=in_channels, fan_out=kernels * out_channels)
        self.root = glorot_parameter(in_channels, out_channels, fan_in=in_channels, fan_out=out_channels)
        self.bias = nn.Parameter(torch.zeros(out_channels))
        self.mu = glorot_parameter(kernels, dimension, fan_in=kernels, fan_out=dimension)
        self.sigma = glorot_parameter(kernels, dimension, fan_in=kernels, fan_out=dimension)
        if width is not None:
            nn.init.constant_(self.sigma, width)

    def edge_weights(self, graph: MixtureGraph) -> Tensor:
        """Return w_k(u_ij) / |N(i)|, (K, E)."""
        distance = (graph.coordinates - self.mu[:, :, None]).square() / (_EPSILON + self.sigma.square())[:, :, None]
        exponents = -0.5 * distance.sum(dim=1)
        return torch.exp(exponents).masked_fill(exponents < _LOWEST_EXPONENT, 0.0) * graph.shares

    def forward(self, features: Tensor, graph: MixtureGraph) -> Tensor:
        """Return (V, out) for features (V, in)."""
        result = torch.addmm(self.bias, features, self.root)
        widens = self.weight.shape[1] < self.weight.shape[2]
        for entries, weight in zip(self.edge_weights(graph).unbind(0), self.weight.unbind(0), strict=True):
            if widens:
                result = torch.addmm(result, weighted_product(entries, features, graph.pattern), weight)
            else:
                result = result + weighted_product(entries, features @ weight, graph.pattern)
        return result
