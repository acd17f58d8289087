"""Training in patches: its output is that of the whole mesh, its gradient nearly, and it is taken only where memory asks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.sparse.csgraph import dijkstra
from torch import Tensor

from dmp import deep_mesh_prior, memory_needs
from dmp.benchmark.meshes import noisy_torus
from dmp.commands.options import DenoiseSettings
from dmp.commands.restoring import denoise
from dmp.deep_mesh_prior import DeepMeshPrior
from dmp.errors import SettingsError, TrainingError
from dmp.memory_needs import check_memory, least_memory, memory_needed, memory_needed_in_patches, patch_vertices_for
from dmp.mesh import TriangleMesh
from dmp.meshio import write_mesh
from dmp.methods import training_for
from dmp.network import DisplacementNetwork
from dmp.operators import normalised_with_loops, to_torch
from dmp.patches.gradients import PatchedNetwork
from dmp.patches.partition import partition
from dmp.problem import denoising
from dmp.settings import settings_for
from dmp.topology import adjacency

_WIDTHS = (16, 32, 16, 16)


def _network() -> DisplacementNetwork:
    torch.manual_seed(2)
    network = DisplacementNetwork(16, _WIDTHS, 16)
    with torch.no_grad():
        for normalisation in network.normalisations:
            normalisation.weight.uniform_(0.5, 1.5)
            normalisation.bias.uniform_(-0.5, 0.5)
    return network


def _gradients(network: DisplacementNetwork, output: Tensor) -> Tensor:
    network.zero_grad(set_to_none=True)
    output.backward(torch.randn(output.shape, generator=torch.Generator().manual_seed(5)))
    found = [parameter.grad for name, parameter in network.named_parameters() if not _is_idle(name)]
    return torch.cat([gradient.reshape(-1) for gradient in found if gradient is not None])


def _is_idle(name: str) -> bool:
    return name.startswith("convolutions") and name.endswith("bias")


def _case(mesh: TriangleMesh, patch_vertices: int) -> tuple[DisplacementNetwork, Tensor, Tensor, PatchedNetwork]:
    neighbours = adjacency(mesh.faces, mesh.n_vertices)
    graph = to_torch(normalised_with_loops(neighbours))
    network = _network()
    features = torch.randn(mesh.n_vertices, 16, generator=torch.Generator().manual_seed(1))
    return network, features, graph, PatchedNetwork(network, graph, mesh.vertices, patch_vertices)


def test_parts_cover_the_mesh_once_and_halos_hold_what_is_near() -> None:
    mesh = noisy_torus(900)
    neighbours = adjacency(mesh.faces, mesh.n_vertices)
    patches = partition(mesh.vertices, neighbours, 200, 3)
    cores = np.concatenate([patch.vertices[patch.core] for patch in patches])
    assert np.array_equal(np.sort(cores), np.arange(mesh.n_vertices))
    for patch in patches:
        assert 100 <= patch.core.sum() <= 200
        distance = dijkstra(neighbours, indices=patch.vertices[patch.core], unweighted=True, min_only=True)
        assert np.array_equal(patch.vertices, np.flatnonzero(distance <= 3))


def test_vertices_in_one_place_are_divided_too() -> None:
    mesh = noisy_torus(300)
    patches = partition(np.zeros((mesh.n_vertices, 3)), adjacency(mesh.faces, mesh.n_vertices), 50, 1)
    assert sum(patch.core.sum() for patch in patches) == mesh.n_vertices


def test_output_on_whole_mesh_and_on_each_patch_is_that_of_the_network() -> None:
    mesh = noisy_torus(900)
    network, features, graph, patched = _case(mesh, 250)
    assert patched.n_patches >= 4
    with torch.no_grad():
        expected = network(features, graph, network.buffers_for(mesh.n_vertices))
    found, moments = patched.whole_output(features)
    assert torch.allclose(found, expected, atol=1e-5)
    for number in range(patched.n_patches):
        vertices, core, output = patched.patch_output(number, features, moments)
        core = core[:, 0]
        assert torch.allclose(output[core], expected[vertices[core]], atol=1e-5)


def test_gradient_of_one_patch_is_exact_and_of_several_nearly() -> None:
    mesh = noisy_torus(3000)
    for patch_vertices, least_cosine in ((mesh.n_vertices, 1 - 1e-6), (800, 0.98)):
        network, features, graph, patched = _case(mesh, patch_vertices)
        expected = _gradients(network, network(features, graph, network.buffers_for(mesh.n_vertices)))
        found = _gradients(network, patched(features))
        assert torch.nn.functional.cosine_similarity(found, expected, dim=0) > least_cosine
        assert 0.9 < found.norm() / expected.norm() < 1.1


def test_bfloat16_takes_the_same_way() -> None:
    mesh = noisy_torus(900)
    neighbours = adjacency(mesh.faces, mesh.n_vertices)
    graph, network = to_torch(normalised_with_loops(neighbours)), _network()
    features = torch.randn(mesh.n_vertices, 16, generator=torch.Generator().manual_seed(1))
    exact = _gradients(network, network(features, graph, network.buffers_for(mesh.n_vertices)))
    patched = PatchedNetwork(network, graph, mesh.vertices, 400, dtype=torch.bfloat16)
    assert torch.nn.functional.cosine_similarity(_gradients(network, patched(features)), exact, dim=0) > 0.95


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    def set_free(needed: float) -> None:
        monkeypatch.setattr(memory_needs, "free_memory", lambda: int(needed / 0.9) + 1)

    return set_free


def test_a_training_in_patches_follows_the_one_on_the_whole_mesh(
    noisy_sphere: TriangleMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = settings_for(
        "denoise", "compact", device="cpu", threads=1, precision="float32", steps=30, snapshot_every=30, log_every=30
    )
    problem = denoising(noisy_sphere, settings)
    whole = training_for(problem, settings)
    losses = [record.metrics["total_loss"] for record in whole.steps() if record.metrics]
    monkeypatch.setattr(deep_mesh_prior, "patch_vertices_for", lambda *_: 150)
    first, second = (training_for(problem, settings) for _ in range(2))
    in_patches = [record.metrics["total_loss"] for record in first.steps() if record.metrics]
    assert in_patches[0] == pytest.approx(losses[0], rel=1e-5)
    assert in_patches[-1] == pytest.approx(losses[-1], rel=0.1) and in_patches[-1] < 0.8 * in_patches[0]

    half = second.steps()
    for _ in range(11):
        next(half)
    # No memory for the whole mesh.
    assert isinstance(second, DeepMeshPrior)
    assert second._patched is not None and second._buffers is None and second._whole_step is None
    # Also where there is more memory by now.
    monkeypatch.setattr(deep_mesh_prior, "patch_vertices_for", lambda *_: 0)
    resumed = training_for(problem, settings)
    resumed.load_state(second.state())
    *_, last = resumed.steps()
    final = first.current()
    assert last.snapshot is not None and final is not None and final.snapshot is not None
    assert np.array_equal(last.snapshot.vertices, final.snapshot.vertices)


def test_patches_are_taken_and_told_only_where_memory_asks(free: Callable[[float], None]) -> None:
    settings, size = settings_for("denoise", "compact", device="cpu"), 1_000_000
    whole = memory_needed(settings, size, keep_outputs=False)
    free(whole)
    assert patch_vertices_for(settings, size) == 0 and check_memory(settings, size) is None
    free(whole - 10)
    assert patch_vertices_for(settings, size) == 200_000
    assert "patches of 200,000 vertices" in (check_memory(settings, size) or "")
    free(memory_needed_in_patches(settings, size, 50_000))
    assert patch_vertices_for(settings, size) == 50_000
    assert least_memory(settings, size) < 0.6 * whole
    free(least_memory(settings, size) - 10)
    with pytest.raises(SettingsError, match="needs about"):
        check_memory(settings, size)
    # Other layers, other methods and small meshes have no such way.
    free(1e9)
    assert patch_vertices_for(settings_for("denoise", "compact", device="cpu", convolution="chebyshev"), size) == 0
    assert patch_vertices_for(settings_for("denoise", "best", device="cpu"), size) == 0
    free(1e7)
    assert patch_vertices_for(settings, 15_000) == 0


def test_impossible_patches_of_a_checkpoint_are_refused(noisy_sphere: TriangleMesh) -> None:
    settings = settings_for("denoise", "compact", device="cpu", threads=1)
    training = training_for(denoising(noisy_sphere, settings), settings)
    for value in (-1, 10**12, "many", True):
        with pytest.raises(TrainingError, match="impossible patches"):
            training.load_state({**training.state(), "patch_vertices": value})


def test_the_command_says_that_it_goes_the_longer_way(
    noisy_sphere: TriangleMesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_mesh(tmp_path / "noisy.ply", noisy_sphere)
    monkeypatch.setattr(memory_needs, "check_memory", lambda *_: "It is done in patches.")
    options = DenoiseSettings(steps=2, threads=1)
    denoise(tmp_path / "noisy.ply", output=tmp_path / "out.ply", run=tmp_path / "run", options=options)
    assert "It is done in patches." in capsys.readouterr().err
