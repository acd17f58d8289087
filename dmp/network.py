"""The network F that maps fixed random values on the vertices to one displacement each (paper, section 3.1)."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional

from dmp.layers import GraphConvolution

# Output widths of the 13 convolutions and of the first linear layer in the authors' code (HEAD).
PUBLISHED_WIDTHS = (32, 64, 128, 256, 256, 512, 512, 256, 256, 128, 64, 32, 32)
PUBLISHED_HIDDEN = 16
_NARROWEST = 16


def scaled_widths(divisor: int) -> tuple[int, ...]:
    """Return the published channel widths divided by ``divisor``, none below 16."""
    return tuple(max(_NARROWEST, width // divisor) for width in PUBLISHED_WIDTHS)


class DisplacementNetwork(nn.Module):
    """Graph convolutions, each followed by batch normalisation and LeakyReLU(0.01), then two linear layers.

    Batch normalisation always uses the statistics of the mesh at hand: there is only this one.
    """

    def __init__(
        self, input_channels: int = 16, widths: tuple[int, ...] = PUBLISHED_WIDTHS, hidden: int = PUBLISHED_HIDDEN
    ) -> None:
        super().__init__()
        sizes = (input_channels, *widths)
        self.convolutions = nn.ModuleList(GraphConvolution(i, o) for i, o in zip(sizes, widths, strict=False))
        self.normalisations = nn.ModuleList(nn.BatchNorm1d(width) for width in widths)
        self.hidden = nn.Linear(widths[-1], hidden)
        self.output = nn.Linear(hidden, 3)

    def forward(self, features: Tensor, propagation: Tensor) -> Tensor:
        """Return one vector a vertex, (V, 3), for features (V, input_channels) and the symmetric matrix P (V, V)."""
        for convolution, normalisation in zip(self.convolutions, self.normalisations, strict=True):
            features = functional.leaky_relu(normalisation(convolution(features, propagation)), 0.01, inplace=True)
        return self.output(functional.leaky_relu(self.hidden(features), 0.01))
