"""From settings to the convolution that they name, and to what it needs to know of the mesh."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import torch
from scipy import sparse
from torch import Tensor, nn

from dmp.layers.chebyshev import ChebyshevConvolution
from dmp.layers.gcn import GraphConvolution
from dmp.layers.mixture import MixtureConvolution, MixtureGraph
from dmp.layers.pseudo_coordinates import N_SHAPE_COORDINATES, N_VALENCE_COORDINATES, shape_coordinates, valence_coordinates
from dmp.mesh import FloatArray, IntArray
from dmp.operators import normalised_with_loops, scaled_laplacian, to_torch
from dmp.settings import Settings
from dmp.topology import adjacency

# The second argument of a convolution: its matrix, or edges with pseudo-coordinates.
Graph: TypeAlias = Tensor | MixtureGraph
MakeConvolution: TypeAlias = Callable[[int, int], nn.Module]


def convolution_maker(settings: Settings) -> MakeConvolution:
    """Return what makes a layer from its numbers of input and output channels."""
    if settings.convolution == "chebyshev":
        return lambda i, o: ChebyshevConvolution(i, o, settings.chebyshev_order)
    if settings.convolution == "gmm":
        return lambda i, o: MixtureConvolution(i, o, dimension=N_VALENCE_COORDINATES, kernels=settings.gmm_kernels)
    if settings.convolution == "gmm-geometric":
        # Coordinates of spread 1 in each of D dimensions lie about sqrt(D) from a centre; narrower kernels would see nothing.
        width = math.sqrt(N_SHAPE_COORDINATES / 2)
        return lambda i, o: MixtureConvolution(i, o, dimension=N_SHAPE_COORDINATES, kernels=settings.gmm_kernels, width=width)
    return GraphConvolution


def graph_for(
    settings: Settings,
    faces: IntArray,
    base: FloatArray,
    device: torch.device | str = "cpu",
    neighbours: sparse.csr_array | None = None,
) -> Graph:
    """Return what the layers of :func:`convolution_maker` take beside the features.

    Args:
        settings: name the convolution.
        faces: (F, 3).
        base: smoothed positions, (V, 3); only the geometric mixture looks at them.
        device: where to put it.
        neighbours: adjacency of the mesh, (V, V), where it is at hand.
    """
    n_vertices = len(base)
    neighbours = adjacency(faces, n_vertices) if neighbours is None else neighbours
    if settings.convolution == "gcn":
        return to_torch(normalised_with_loops(neighbours), device)
    if settings.convolution == "chebyshev":
        return to_torch(scaled_laplacian(faces, n_vertices), device)
    sees_shape = settings.convolution == "gmm-geometric"
    coordinates = shape_coordinates(base, faces) if sees_shape else valence_coordinates(faces, n_vertices)
    return MixtureGraph.of(neighbours, coordinates, device)
