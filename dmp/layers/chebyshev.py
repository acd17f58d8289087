"""The Chebyshev convolution of Defferrard et al."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from dmp.layers.initial_values import glorot_parameter
from dmp.operators import symmetric_product


class ChebyshevConvolution(nn.Module):
    """X' = sum over k < K of T_k(L) X W_k + b (Defferrard, Bresson, Vandergheynst 2016, eq. 4).

    T_0 = I, T_1 = L, T_k = 2 L T_(k-1) - T_(k-2) are the Chebyshev polynomials of the scaled Laplacian
    L = 2 (I - D^(-1/2) A D^(-1/2)) / 2 - I = - D^(-1/2) A D^(-1/2), whose eigenvalues lie between -1 and 1.

    Products with L are taken on the narrower side: of X by the recurrence above, of the X W_k by Clenshaw's. First values
    are those of the library that the authors used.
    """

    def __init__(self, in_channels: int, out_channels: int, terms: int = 2) -> None:
        """Make a layer with ``terms`` polynomials, K; a vertex then sees K - 1 rings of neighbours."""
        super().__init__()
        self.weight = glorot_parameter(terms, in_channels, out_channels, fan_in=in_channels, fan_out=out_channels)
        self.bias = nn.Parameter(torch.zeros(out_channels))

    def forward(self, features: Tensor, laplacian: Tensor) -> Tensor:
        """Return (V, out) for features (V, in) and the symmetric CSR matrix L (V, V)."""
        if self.weight.shape[1] < self.weight.shape[2]:
            return self._by_features(features, laplacian)
        return self._by_outputs(features, laplacian)

    def _by_features(self, features: Tensor, laplacian: Tensor) -> Tensor:
        result = torch.addmm(self.bias, features, self.weight[0])
        before, term = features, features
        for index, weight in enumerate(self.weight[1:]):
            if index == 0:
                term = symmetric_product(laplacian, features)
            else:
                before, term = term, 2.0 * symmetric_product(laplacian, term) - before
            result = torch.addmm(result, term, weight)
        return result

    def _by_outputs(self, features: Tensor, laplacian: Tensor) -> Tensor:
        after: Tensor | None = None
        term: Tensor | None = None
        for weight in self.weight[1:].flip(0):
            mixed = features @ weight
            if term is not None:
                mixed = mixed + 2.0 * symmetric_product(laplacian, term)
            if after is not None:
                mixed = mixed - after
            after, term = term, mixed
        result = torch.addmm(self.bias, features, self.weight[0])
        if term is not None:
            result = result + symmetric_product(laplacian, term)
        return result if after is None else result - after
