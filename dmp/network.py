"""The network F that maps fixed random values on the vertices to one displacement each (paper, section 3.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from dmp.layers import Graph, GraphConvolution
from dmp.layers.choice import MakeConvolution
from dmp.settings import Architecture

if TYPE_CHECKING:
    from dmp.layers.gcn_stack import Moments
    from dmp.layers.stack_buffers import StackBuffers

_NARROWEST = 16


@dataclass(frozen=True)
class Layout:
    """Numbers of channels in a network.

    Attributes:
        widths: output channels of the convolutions.
        hidden: output channels of the first of the two linear layers.
    """

    widths: tuple[int, ...]
    hidden: int

    def divided(self, divisor: int) -> Layout:
        """Return the layout with all numbers divided by ``divisor``, none below 16."""
        return Layout(
            tuple(max(_NARROWEST, width // divisor) for width in self.widths), max(_NARROWEST, self.hidden // divisor)
        )


# The two states of the authors' published code, by month; see :mod:`dmp.settings`.
LAYOUTS: Mapping[Architecture, Layout] = {
    "2024-06": Layout((32, 64, 128, 256, 256, 512, 512, 256, 256, 128, 64, 32, 32), hidden=16),
    "2021-04": Layout((32, 64, 128, 256, 256, 512, 512, 256, 256, 128), hidden=64),
}
PUBLISHED_WIDTHS = LAYOUTS["2024-06"].widths
PUBLISHED_HIDDEN = LAYOUTS["2024-06"].hidden


def scaled_widths(divisor: int) -> tuple[int, ...]:
    """Return the published channel widths of the convolutions divided by ``divisor``, none below 16."""
    return LAYOUTS["2024-06"].divided(divisor).widths


def skip_sources(n_layers: int) -> tuple[int | None, ...]:
    """Return for each layer the earlier one whose output is joined to its input with skip connections, or None.

    Layers are numbered from 0. The second half mirrors the first: layer k takes the output of layer n - 1 - k, except in the
    middle, where that is the layer's own input. For 13 layers this is the authors' published code; for other numbers of layers
    no variant was published.
    """
    mirrored = (n_layers - 1 - layer for layer in range(n_layers))
    return tuple(source if source < layer - 1 else None for layer, source in enumerate(mirrored))


class DisplacementNetwork(nn.Module):
    """Graph convolutions, each followed by batch normalisation and LeakyReLU(0.01), then linear layers to 3 coordinates.

    There are two linear layers with a LeakyReLU between them. With ``skip`` it is the U-shaped variant of the authors'
    published code: the outputs of the first half of the convolutions are joined, channels beside channels, to the inputs of the
    second half (:func:`skip_sources`), and one linear layer ends it.

    Batch normalisation always uses the statistics of the mesh at hand: there is only this one.
    """

    def __init__(
        self,
        input_channels: int = 16,
        widths: Sequence[int] = PUBLISHED_WIDTHS,
        hidden: int = PUBLISHED_HIDDEN,
        *,
        skip: bool = False,
        convolution: MakeConvolution = GraphConvolution,
    ) -> None:
        """Make a network.

        Args:
            input_channels: random values of a vertex.
            widths: output channels of the convolutions.
            hidden: output channels of the first linear layer; without meaning for ``skip``.
            skip: whether to make the variant with skip connections.
            convolution: makes one layer from its numbers of input and output channels.
        """
        super().__init__()
        self.sizes = (input_channels, *widths)
        self.sources = skip_sources(len(widths)) if skip else (None,) * len(widths)
        joined = [0 if source is None else widths[source] for source in self.sources]
        sizes = [width + more for width, more in zip((input_channels, *widths), joined, strict=False)]
        self.convolutions = nn.ModuleList(convolution(i, o) for i, o in zip(sizes, widths, strict=True))
        self.normalisations = nn.ModuleList(nn.BatchNorm1d(width) for width in widths)
        self.hidden = None if skip else nn.Linear(widths[-1], hidden)
        self.output = nn.Linear(widths[-1] if skip else hidden, 3)

    @property
    def has_use_for_buffers(self) -> bool:
        """Whether :meth:`buffers_for` makes :meth:`forward` faster on a processor: for graph convolutions in a plain series."""
        is_plain = all(source is None for source in self.sources)
        return is_plain and all(isinstance(convolution, GraphConvolution) for convolution in self.convolutions)

    def buffers_for(self, n_vertices: int, *, dtype: torch.dtype = torch.float32, keep_outputs: bool = True) -> StackBuffers:
        """Return buffers for :meth:`forward`, see :class:`dmp.layers.stack_buffers.StackBuffers`."""
        # Loads the compiled kernels, which a program that trains nothing can do without.
        from dmp.layers.stack_buffers import StackBuffers

        return StackBuffers(n_vertices, self.sizes[0], self.sizes[1:], dtype=dtype, keep_outputs=keep_outputs)

    def forward(
        self,
        features: Tensor,
        graph: Graph,
        buffers: StackBuffers | None = None,
        moments: Sequence[Moments] | None = None,
    ) -> Tensor:
        """Return one vector a vertex, (V, 3).

        Args:
            features: (V, input_channels).
            graph: what the convolutions know of the mesh.
            buffers: of :meth:`buffers_for`; results are the same without. A backward pass must follow its forward pass before
                the next one.
            moments: with buffers alone: by which each layer is normalised, in place of those of the vertices at hand.
        """
        if buffers is not None:
            from dmp.layers.gcn_stack import gcn_stack

            # Buffers are made for graph convolutions alone, and what these know of the mesh is a matrix.
            features = gcn_stack(
                features, cast(Tensor, graph), self.convolutions, self.normalisations, buffers, moments=moments
            )
            return self.ended(features)
        outputs: list[Tensor] = []
        for source, convolution, normalisation in zip(self.sources, self.convolutions, self.normalisations, strict=True):
            if source is not None:
                features = torch.cat([features, outputs[source]], dim=1)
            features = functional.leaky_relu(normalisation(convolution(features, graph)), 0.01, inplace=True)
            outputs.append(features)
        return self.ended(features)

    def ended(self, features: Tensor) -> Tensor:
        """Return the linear layers' output, (V, 3), for that of the convolutions."""
        if self.hidden is not None:
            features = functional.leaky_relu(self.hidden(features), 0.01)
        return self.output(features)
