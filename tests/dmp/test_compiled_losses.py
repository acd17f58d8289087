"""The loss of Deep Mesh Prior in compiled kernels, against the same terms written with torch."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from dmp.compiled_losses import CompiledLosses
from dmp.losses import data_loss, laplacian_loss
from dmp.mesh import TriangleMesh
from dmp.operators import to_torch
from dmp.settings import Settings, settings_for
from dmp.topology import adjacency


def _settings(**changes: Any) -> Settings:
    return replace(settings_for("denoise", "compact", device="cpu"), **changes)


def _graph(mesh: TriangleMesh) -> tuple[Tensor, Tensor]:
    matrix = adjacency(mesh.faces, mesh.n_vertices)
    return to_torch(matrix), torch.from_numpy(matrix.sum(axis=1)[:, None]).float().clamp(min=1)


def _positions(mesh: TriangleMesh, seed: int) -> Tensor:
    noise = torch.randn(mesh.n_vertices, 3, generator=torch.Generator().manual_seed(seed))
    return torch.tensor(mesh.vertices, dtype=torch.float32) + 0.05 * noise


@pytest.mark.parametrize("form", ["mean", "sum"])
@pytest.mark.parametrize("of", ["prediction", "change"])
@pytest.mark.parametrize("epsilon", [1e-12, 1e-6])
@pytest.mark.parametrize("some_only", [False, True])
def test_losses_and_gradient_equal_those_of_torch(
    noisy_sphere: TriangleMesh, form: str, of: str, epsilon: float, some_only: bool
) -> None:
    settings = _settings(laplacian_form=form, laplacian_of=of, laplacian_epsilon=epsilon, laplacian_weight=0.7)
    graph, valence = _graph(noisy_sphere)
    target, fitted = _positions(noisy_sphere, 1), torch.arange(3, noisy_sphere.n_vertices, 2) if some_only else None
    first, second = (_positions(noisy_sphere, 2).requires_grad_() for _ in range(2))

    data = data_loss(first, target, fitted)
    laplacian = laplacian_loss(first if of == "prediction" else first - target, graph, valence, form, epsilon)  # type: ignore[arg-type]
    (3 * (data + 0.7 * laplacian)).backward()
    found = CompiledLosses(settings, target, graph, valence, fitted)(second)
    (3 * found[0]).backward()

    assert [loss.item() for loss in found] == pytest.approx([(data + 0.7 * laplacian).item(), data.item(), laplacian.item()])
    assert not found[1].requires_grad and not found[2].requires_grad
    assert first.grad is not None and second.grad is not None
    assert float((first.grad - second.grad).abs().max()) < 1e-6 * float(first.grad.abs().max())


def test_the_gradient_is_finite_where_nothing_is_left_to_do_and_lonely_vertices_count() -> None:
    faces = torch.tensor([[0, 1, 2]])
    mesh = TriangleMesh(torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]]).numpy(), faces.numpy())
    graph, valence = _graph(mesh)
    target = torch.tensor(mesh.vertices, dtype=torch.float32)
    losses = CompiledLosses(_settings(laplacian_of="change"), target, graph, valence, None)
    found, gradient = losses.compute(target)
    assert found[:].tolist() == pytest.approx([0, 0, 0], abs=1e-5) and torch.isfinite(gradient).all()
    # Without neighbours the Laplacian is the vertex itself.
    settings = _settings(laplacian_of="prediction")
    found, _ = CompiledLosses(settings, target, graph, valence, None).compute(target)
    assert found[2].item() == pytest.approx(laplacian_loss(target, graph, valence).item())


def test_no_digit_depends_on_the_number_of_threads() -> None:
    from dmp.benchmark.meshes import noisy_torus

    mesh, before, results = noisy_torus(9_000), torch.get_num_threads(), []
    graph, valence = _graph(mesh)
    losses = CompiledLosses(_settings(), _positions(mesh, 1), graph, valence, None)
    for threads in (1, 2, 3):
        torch.set_num_threads(threads)
        results.append(losses.compute(_positions(mesh, 2)))
    torch.set_num_threads(before)
    for values, gradient in results[1:]:
        assert torch.equal(values, results[0][0]) and torch.equal(gradient, results[0][1])
