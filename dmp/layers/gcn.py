"""The graph convolution of Kipf & Welling."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from dmp.layers.initial_values import glorot_parameter
from dmp.operators import symmetric_product


class GraphConvolution(nn.Module):
    """X' = P X W + b with P = D^(-1/2) (A + I) D^(-1/2) (GCN, Kipf & Welling 2017, eq. 8).

    P X W can be computed as (P X) W or P (X W). The product with P costs in proportion to the columns that it meets, so
    it is taken on the narrower side. First values are those of the library that the authors used.
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.weight = glorot_parameter(in_channels, out_channels, fan_in=in_channels, fan_out=out_channels)
        self.bias = nn.Parameter(torch.zeros(out_channels))

    def forward(self, features: Tensor, propagation: Tensor) -> Tensor:
        """Return (V, out) for features (V, in) and the symmetric CSR matrix P (V, V)."""
        if self.weight.shape[0] < self.weight.shape[1]:
            return torch.addmm(self.bias, symmetric_product(propagation, features), self.weight)
        return symmetric_product(propagation, features @ self.weight) + self.bias
