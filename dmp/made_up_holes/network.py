"""A small graph network that tells how far the true surface lies from the thin plate, along the normal."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from dmp.operators import symmetric_product


class InpaintingNetwork(nn.Module):
    """Residual graph layers x + ReLU(W [LN(x), P LN(x)]), from features (V, C) to one offset a vertex, (V,).

    The last layer starts at 0, so an untrained network returns the thin plate.
    """

    def __init__(self, mean: Tensor, deviation: Tensor, width: int = 64, layers: int = 6) -> None:
        """Make a network that scales its features with ``mean`` and ``deviation``, (C,) each."""
        super().__init__()
        self.mean: Tensor
        self.deviation: Tensor
        self.register_buffer("mean", mean)
        self.register_buffer("deviation", deviation)
        self.first = nn.Linear(len(mean), width)
        self.layers = nn.ModuleList(nn.Linear(2 * width, width) for _ in range(layers))
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(layers))
        self.last = nn.Linear(width, 1)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    def forward(self, features: Tensor, propagation: Tensor) -> Tensor:
        """Return offsets (V,) in mean edge lengths; ``propagation`` is the symmetric matrix P (V, V)."""
        hidden = functional.relu(self.first((features - self.mean) / self.deviation))
        for layer, norm in zip(self.layers, self.norms, strict=True):
            even = norm(hidden)
            hidden = hidden + functional.relu(layer(torch.cat([even, symmetric_product(propagation, even)], dim=1)))
        return self.last(hidden)[:, 0]
