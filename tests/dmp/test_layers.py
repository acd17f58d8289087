from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch_geometric.nn import ChebConv, GCNConv, GMMConv

from dmp.layers import ChebyshevConvolution, GraphConvolution, MixtureConvolution, MixtureGraph, convolution_maker, graph_for
from dmp.mesh import IntArray, TriangleMesh
from dmp.operators import EdgePattern, normalised_adjacency, scaled_laplacian, to_torch, weighted_product
from dmp.settings import settings_for
from dmp.topology import adjacency

Faces = tuple[IntArray, int]


@pytest.fixture(params=["sphere", "random graph"])
def faces(request: pytest.FixtureRequest, sphere: TriangleMesh) -> Faces:
    """Faces and number of vertices: of a mesh, and of random triples with isolated vertices and uneven valences."""
    if request.param == "sphere":
        return sphere.faces, sphere.n_vertices
    generator = np.random.default_rng(3)
    return (60 * generator.random((70, 3)) ** 1.7).astype(np.int64), 65


def _edge_index(faces: Faces) -> Tensor:
    """Directed edges as torch_geometric wants them, j in the first row and i in the second, in the order of ours."""
    matrix = adjacency(*faces)
    to = np.repeat(np.arange(faces[1]), np.diff(matrix.indptr))
    return torch.from_numpy(np.stack([matrix.indices, to]).astype(np.int64))


def _assert_alike(
    faces: Faces,
    channels: int,
    ours: Callable[[Tensor], Tensor],
    theirs: Callable[[Tensor], Tensor],
    pairs: Callable[[], list[tuple[Tensor | None, Tensor | None]]],
) -> None:
    """Compare results, and the gradients of features and of the pairs of parameters, to 1e-5 of the largest value."""
    generator = torch.Generator().manual_seed(8)
    first = torch.randn(faces[1], channels, generator=generator).requires_grad_()
    second = first.detach().clone().requires_grad_()
    left, right = ours(first), theirs(second)
    weights = torch.randn(left.shape, generator=generator) / faces[1]
    (left * weights).sum().backward()
    (right * weights).sum().backward()
    for mine, other in [(left, right), (first.grad, second.grad), *pairs()]:
        assert mine is not None and other is not None and mine.shape == other.shape
        assert torch.isfinite(other).all() and other.abs().max() > 0
        assert (mine - other).abs().max() <= 1e-5 * max(1.0, float(other.detach().abs().max()))
        assert (mine - other).abs().max() <= 1e-4 * float(other.detach().abs().max())


@pytest.mark.parametrize("channels", [(4, 9), (9, 4)])
def test_graph_convolution_equals_torch_geometric(faces: Faces, channels: tuple[int, int]) -> None:
    ours, theirs = GraphConvolution(*channels), GCNConv(*channels)
    with torch.no_grad():
        theirs.lin.weight.copy_(ours.weight.T)
        ours.bias.copy_(theirs.bias.uniform_(-1, 1))
    propagation = to_torch(normalised_adjacency(*faces))
    _assert_alike(
        faces,
        channels[0],
        lambda x: ours(x, propagation),
        lambda x: theirs(x, _edge_index(faces)),
        lambda: [(ours.weight.grad, theirs.lin.weight.grad.T), (ours.bias.grad, theirs.bias.grad)],
    )


@pytest.mark.parametrize("channels", [(4, 9), (9, 4)])
@pytest.mark.parametrize("terms", [1, 2, 3, 5])
def test_chebyshev_convolution_equals_torch_geometric(faces: Faces, channels: tuple[int, int], terms: int) -> None:
    ours, theirs = ChebyshevConvolution(*channels, terms), ChebConv(*channels, K=terms)
    with torch.no_grad():
        for index, linear in enumerate(theirs.lins):
            linear.weight.copy_(ours.weight[index].T)
        ours.bias.copy_(theirs.bias.uniform_(-1, 1))
    laplacian = to_torch(scaled_laplacian(*faces))
    _assert_alike(
        faces,
        channels[0],
        lambda x: ours(x, laplacian),
        lambda x: theirs(x, _edge_index(faces)),
        lambda: [
            (ours.weight.grad, torch.stack([linear.weight.grad.T for linear in theirs.lins])),
            (ours.bias.grad, theirs.bias.grad),
        ],
    )


@pytest.mark.parametrize("channels", [(4, 9), (9, 4)])
@pytest.mark.parametrize(("dimension", "kernels"), [(2, 5), (5, 3), (3, 1)])
def test_mixture_convolution_equals_torch_geometric(
    faces: Faces, channels: tuple[int, int], dimension: int, kernels: int
) -> None:
    inputs, outputs = channels
    ours = MixtureConvolution(inputs, outputs, dimension=dimension, kernels=kernels)
    theirs = GMMConv(inputs, outputs, dim=dimension, kernel_size=kernels)
    with torch.no_grad():
        # Away from 0, where a Gaussian has no width and both agree on nothing but rounding.
        ours.sigma.copy_(0.4 + ours.sigma.abs())
        theirs.g.copy_(ours.weight.permute(1, 0, 2).reshape(inputs, kernels * outputs))
        theirs.root.weight.copy_(ours.root.T)
        ours.bias.copy_(theirs.bias.uniform_(-1, 1))
        theirs.mu.copy_(ours.mu)
        theirs.sigma.copy_(ours.sigma)
    coordinates = np.random.default_rng(1).normal(size=(_edge_index(faces).shape[1], dimension))
    graph = MixtureGraph.of(adjacency(*faces), coordinates)
    attributes = torch.from_numpy(coordinates).float()
    _assert_alike(
        faces,
        inputs,
        lambda x: ours(x, graph),
        lambda x: theirs(x, _edge_index(faces), attributes),
        lambda: [
            (ours.weight.grad, theirs.g.grad.view(inputs, kernels, outputs).permute(1, 0, 2)),
            (ours.root.grad, theirs.root.weight.grad.T),
            (ours.bias.grad, theirs.bias.grad),
            (ours.mu.grad, theirs.mu.grad),
            (ours.sigma.grad, theirs.sigma.grad),
        ],
    )


def test_first_values_are_distributed_as_in_torch_geometric() -> None:
    def bound(tensor: Tensor) -> float:
        return float(tensor.detach().abs().max())

    mixture = MixtureConvolution(64, 128, dimension=2, kernels=5)
    for ours, theirs in (
        (GraphConvolution(64, 128).weight, GCNConv(64, 128).lin.weight),
        (ChebyshevConvolution(64, 128, 3).weight, ChebConv(64, 128, 3).lins[0].weight),
        (mixture.weight, GMMConv(64, 128, 2, 5).g),
        (mixture.root, GMMConv(64, 128, 2, 5).root.weight),
    ):
        # The largest of thousands of uniform values is the bound of their distribution, nearly.
        assert bound(ours) == pytest.approx(bound(theirs), rel=0.01)


def test_weighted_product_and_its_gradients_equal_the_dense_ones(faces: Faces) -> None:
    matrix = adjacency(*faces)
    pattern = EdgePattern.of(matrix)
    generator = torch.Generator().manual_seed(2)
    to = np.repeat(np.arange(faces[1]), np.diff(matrix.indptr))
    entries, features = torch.randn(matrix.nnz, generator=generator), torch.randn(faces[1], 6, generator=generator)
    weights = torch.randn(faces[1], 6, generator=generator)
    gradients = []
    for product in (
        lambda e, x: weighted_product(e, x, pattern),
        lambda e, x: torch.zeros(faces[1], faces[1]).index_put((torch.from_numpy(to), torch.from_numpy(matrix.indices)), e) @ x,
    ):
        e, x = entries.clone().requires_grad_(), features.clone().requires_grad_()
        result = product(e, x)
        gradients.append((result, *torch.autograd.grad((result * weights).sum(), (e, x))))
    for ours, dense in zip(*gradients, strict=True):
        assert torch.allclose(ours, dense, atol=1e-5)


def test_reverse_leads_from_each_edge_to_the_opposite_one(faces: Faces) -> None:
    matrix = adjacency(*faces)
    to = np.repeat(np.arange(faces[1]), np.diff(matrix.indptr))
    reverse = EdgePattern.of(matrix).reverse.numpy()
    assert np.array_equal(to[reverse], matrix.indices)
    assert np.array_equal(matrix.indices[reverse], to)


@pytest.mark.parametrize("convolution", ["chebyshev", "gmm", "gmm-geometric"])
def test_settings_choose_number_of_terms_and_kernels(noisy_sphere: TriangleMesh, convolution: str) -> None:
    settings = settings_for(convolution=convolution, chebyshev_order=4, gmm_kernels=3)
    layer = convolution_maker(settings)(7, 5)
    weight = layer.weight
    assert isinstance(weight, nn.Parameter)
    assert weight.shape == (4 if convolution == "chebyshev" else 3, 7, 5)
    result = layer(torch.randn(noisy_sphere.n_vertices, 7), graph_for(settings, noisy_sphere.faces, noisy_sphere.vertices))
    assert result.shape == (noisy_sphere.n_vertices, 5)
    assert torch.isfinite(result).all()
