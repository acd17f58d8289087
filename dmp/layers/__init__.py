"""Graph convolutions: the three that the paper compares, and one that sees the shape."""

from __future__ import annotations

from dmp.layers.chebyshev import ChebyshevConvolution
from dmp.layers.choice import Graph, convolution_maker, graph_for
from dmp.layers.gcn import GraphConvolution
from dmp.layers.mixture import MixtureConvolution, MixtureGraph

__all__ = [
    "ChebyshevConvolution",
    "Graph",
    "GraphConvolution",
    "MixtureConvolution",
    "MixtureGraph",
    "convolution_maker",
    "graph_for",
]
