from __future__ import annotations

import numpy as np
import pytest
import torch

from dmp.losses import data_loss, laplacian_loss
from dmp.mesh import TriangleMesh
from dmp.operators import to_torch
from dmp.topology import adjacency


def _graph(mesh: TriangleMesh) -> tuple[torch.Tensor, torch.Tensor]:
    matrix = adjacency(mesh.faces, mesh.n_vertices)
    return to_torch(matrix), torch.from_numpy(matrix.sum(axis=1)[:, None]).float()


def test_data_loss_is_the_mean_norm_of_the_fitted_vertices() -> None:
    predicted, target = torch.zeros(3, 3), torch.tensor([[3.0, 4, 0], [0, 0, 1], [0, 0, 8]])
    assert data_loss(predicted, target).item() == pytest.approx((5 + 1 + 8) / 3)
    assert data_loss(predicted, target, torch.tensor([0, 1])).item() == pytest.approx(3)


def test_gradient_is_finite_where_the_residual_is_zero() -> None:
    predicted = torch.zeros(2, 3, requires_grad=True)
    data_loss(predicted, torch.zeros(2, 3)).backward()
    assert predicted.grad is not None
    assert torch.isfinite(predicted.grad).all()


@pytest.mark.parametrize("form", ["mean", "sum"])
def test_laplacian_loss_against_a_loop_over_vertices(noisy_sphere: TriangleMesh, form: str) -> None:
    matrix = adjacency(noisy_sphere.faces, noisy_sphere.n_vertices)
    norms = []
    for vertex in range(noisy_sphere.n_vertices):
        neighbours = matrix.indices[matrix.indptr[vertex] : matrix.indptr[vertex + 1]]
        total = noisy_sphere.vertices[neighbours].sum(axis=0)
        here = noisy_sphere.vertices[vertex]
        norms.append(np.linalg.norm(here - total / len(neighbours) if form == "mean" else len(neighbours) * here - total))
    positions = torch.tensor(noisy_sphere.vertices, dtype=torch.float32)
    assert laplacian_loss(positions, *_graph(noisy_sphere), form).item() == pytest.approx(np.mean(norms), rel=1e-4)  # type: ignore[arg-type]


@pytest.mark.parametrize("form", ["mean", "sum"])
def test_laplacian_gradient_against_finite_differences(tetrahedron: TriangleMesh, form: str) -> None:
    graph, valence = _graph(tetrahedron)
    points = torch.from_numpy(tetrahedron.vertices * [1.0, 1.3, 0.7]).float().requires_grad_()
    laplacian_loss(points, graph, valence, form).backward()  # type: ignore[arg-type]
    assert points.grad is not None
    for index in ((0, 0), (2, 1), (3, 2)):
        step = torch.zeros_like(points)
        step[index] = 1e-2
        with torch.no_grad():
            slope = (
                laplacian_loss(points + step, graph, valence, form) - laplacian_loss(points - step, graph, valence, form)
            ) / 2e-2  # type: ignore[arg-type]
        assert points.grad[index].item() == pytest.approx(slope.item(), abs=2e-3)
