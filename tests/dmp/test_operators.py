from __future__ import annotations

import numpy as np
import torch
from torch_geometric.nn import GCNConv

from dmp.layers import GraphConvolution
from dmp.mesh import TriangleMesh
from dmp.operators import normalised_adjacency, symmetric_product, to_torch
from dmp.topology import unique_edges


def _edge_index(mesh: TriangleMesh) -> torch.Tensor:
    edges = torch.from_numpy(unique_edges(mesh.faces).T.copy())
    return torch.cat([edges, edges.flip(0)], dim=1)


def test_product_and_its_gradient_equal_the_dense_ones(sphere: TriangleMesh) -> None:
    matrix = normalised_adjacency(sphere.faces, sphere.n_vertices)
    dense = torch.from_numpy(matrix.toarray()).float()
    ours, theirs = (
        torch.randn(sphere.n_vertices, 5, generator=torch.Generator().manual_seed(1)).requires_grad_() for _ in range(2)
    )
    weights = torch.randn(sphere.n_vertices, 5)
    (symmetric_product(to_torch(matrix), ours) * weights).sum().backward()
    ((dense @ theirs) * weights).sum().backward()
    assert torch.allclose(symmetric_product(to_torch(matrix), ours), dense @ theirs, atol=1e-6)
    assert ours.grad is not None and theirs.grad is not None
    assert torch.allclose(ours.grad, theirs.grad, atol=1e-6)


def test_normalised_adjacency_keeps_the_root_of_the_degrees(sphere: TriangleMesh) -> None:
    matrix = normalised_adjacency(sphere.faces, sphere.n_vertices)
    degrees = np.bincount(unique_edges(sphere.faces).ravel()) + 1.0
    assert np.allclose(matrix @ np.sqrt(degrees), np.sqrt(degrees))


def test_graph_convolution_equals_torch_geometric_forward_and_backward(sphere: TriangleMesh) -> None:
    propagation = to_torch(normalised_adjacency(sphere.faces, sphere.n_vertices))
    for channels in ((4, 9), (9, 4)):
        ours, theirs = GraphConvolution(*channels), GCNConv(*channels)
        with torch.no_grad():
            theirs.lin.weight.copy_(ours.weight.T)
            theirs.bias.uniform_(-1, 1)
            ours.bias.copy_(theirs.bias)
        first = torch.randn(sphere.n_vertices, channels[0]).requires_grad_()
        second = first.detach().clone().requires_grad_()
        left, right = ours(first, propagation), theirs(second, _edge_index(sphere))
        assert torch.allclose(left, right, atol=1e-5)
        weights = torch.randn_like(left)
        (left * weights).sum().backward()
        (right * weights).sum().backward()
        assert first.grad is not None and second.grad is not None and ours.weight.grad is not None
        assert torch.allclose(first.grad, second.grad, atol=1e-5)
        assert torch.allclose(ours.weight.grad.T, theirs.lin.weight.grad, atol=1e-4)
