"""The series of graph convolutions with its own backward pass, against the same layers with automatic derivatives."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from dmp.compiled.stack_rows import ROWS
from dmp.deep_mesh_prior import DeepMeshPrior
from dmp.layers import ChebyshevConvolution, stack_buffers
from dmp.layers.gcn_stack import gcn_stack
from dmp.layers.stack_buffers import StackBuffers
from dmp.layers.stack_sizes import bytes_per_vertex
from dmp.mesh import TriangleMesh
from dmp.network import LAYOUTS, DisplacementNetwork
from dmp.operators import normalised_adjacency, to_torch
from dmp.problem import denoising
from dmp.settings import settings_for

_LAYOUT = LAYOUTS["2024-06"].divided(8)


def _network(seed: int = 0) -> DisplacementNetwork:
    torch.manual_seed(seed)
    network = DisplacementNetwork(16, _LAYOUT.widths, _LAYOUT.hidden)
    with torch.no_grad():
        for normalisation in network.normalisations:
            normalisation.weight.uniform_(-1.5, 1.5)
            normalisation.bias.uniform_(-0.5, 0.5)
    return network


def _propagation(mesh: TriangleMesh, dtype: torch.dtype = torch.float32) -> Tensor:
    return to_torch(normalised_adjacency(mesh.faces, mesh.n_vertices)).to(dtype)


def _loss_and_gradients(
    network: DisplacementNetwork, features: Tensor, graph: Tensor, buffers: StackBuffers | None
) -> tuple[Tensor, dict[str, Tensor]]:
    network.zero_grad(set_to_none=True)
    output = network(features, graph, buffers)
    (output * torch.linspace(-1, 2, output.numel()).view_as(output)).sum().backward()
    return output.detach(), {name: p.grad.clone() for name, p in network.named_parameters() if p.grad is not None}


def _error(found: Tensor, expected: Tensor) -> float:
    return float((found - expected).abs().max() / expected.abs().max())


@pytest.mark.parametrize(("keep_outputs", "fused"), [(True, True), (True, False), (False, False)])
def test_outputs_and_gradients_equal_those_of_automatic_derivatives(
    sphere: TriangleMesh, keep_outputs: bool, fused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not fused:
        monkeypatch.setattr(stack_buffers, "packing_for", lambda _: None)
    network, graph = _network(), _propagation(sphere)
    features = torch.randn(sphere.n_vertices, 16, generator=torch.Generator().manual_seed(1))
    buffers = network.buffers_for(sphere.n_vertices, keep_outputs=keep_outputs)
    plain, expected = _loss_and_gradients(network, features, graph, None)
    output, found = _loss_and_gradients(network, features, graph, buffers)
    assert _error(output, plain) < 1e-5
    assert found.keys() == expected.keys()
    for name, gradient in expected.items():
        if name.startswith("convolutions") and name.endswith("bias"):
            # Batch normalisation takes a constant off again, so the true gradient is 0.
            assert not found[name].any()
        else:
            assert _error(found[name], gradient) < 1e-5, name


def test_gradients_of_the_features_and_a_second_pass_through_the_same_buffers(sphere: TriangleMesh) -> None:
    network, graph = _network(1), _propagation(sphere)
    buffers = network.buffers_for(sphere.n_vertices)
    for seed in (1, 2):
        values = torch.randn(sphere.n_vertices, 16, generator=torch.Generator().manual_seed(seed))
        first, second = values.clone().requires_grad_(), values.clone().requires_grad_()
        weights = torch.randn(sphere.n_vertices, 3)
        (network(first, graph) * weights).sum().backward()
        (network(second, graph, buffers) * weights).sum().backward()
        assert first.grad is not None and second.grad is not None
        assert _error(second.grad, first.grad) < 1e-5


@pytest.mark.parametrize("widths", [(24, 40, 17, 5), (7, 7, 33)])
def test_any_number_of_channels_and_features_laid_out_otherwise_give_the_same(
    sphere: TriangleMesh, widths: tuple[int, ...]
) -> None:
    torch.manual_seed(3)
    network, graph = DisplacementNetwork(9, widths, 16), _propagation(sphere)
    features = torch.randn(9, sphere.n_vertices).T
    plain, expected = _loss_and_gradients(network, features, graph, None)
    output, found = _loss_and_gradients(network, features, graph, network.buffers_for(sphere.n_vertices))
    assert _error(output, plain) < 1e-5
    for name, gradient in expected.items():
        if not (name.startswith("convolutions") and name.endswith("bias")):
            assert _error(found[name], gradient) < 1e-4, name


def test_outputs_stay_when_the_buffers_are_used_again_and_a_late_backward_pass_is_refused(sphere: TriangleMesh) -> None:
    network, graph = _network(), _propagation(sphere)
    buffers = network.buffers_for(sphere.n_vertices)
    features = torch.randn(sphere.n_vertices, 16)
    stack = gcn_stack(features, graph, network.convolutions, network.normalisations, buffers)
    before = stack.detach().clone()
    gcn_stack(features + 1, graph, network.convolutions, network.normalisations, buffers)
    assert torch.equal(stack.detach(), before)
    with pytest.raises(RuntimeError, match="another forward pass"):
        stack.sum().backward()


def test_bfloat16_keeps_the_direction_of_the_gradient(sphere: TriangleMesh) -> None:
    # Few layers: depth and batch normalisation make rounding grow.
    torch.manual_seed(0)
    network = DisplacementNetwork(16, (32, 64, 32), 16)
    features = torch.randn(sphere.n_vertices, 16)
    _, expected = _loss_and_gradients(network, features, _propagation(sphere), None)
    buffers = StackBuffers(sphere.n_vertices, 16, (32, 64, 32), dtype=torch.bfloat16)
    _, found = _loss_and_gradients(network, features, _propagation(sphere, torch.bfloat16), buffers)
    for name, gradient in expected.items():
        assert found[name].dtype == torch.float32
        if not (name.startswith("convolutions") and name.endswith("bias")):
            cosine = torch.nn.functional.cosine_similarity(found[name].ravel(), gradient.ravel(), dim=0)
            assert cosine > 0.99, name


@pytest.mark.parametrize(("keep_outputs", "dtype"), [(True, torch.bfloat16), (False, torch.bfloat16), (True, torch.float32)])
def test_buffers_take_the_memory_that_is_told_of_them(keep_outputs: bool, dtype: torch.dtype) -> None:
    buffers = StackBuffers(128, 16, _LAYOUT.widths, dtype=dtype, keep_outputs=keep_outputs)
    held = [tensor for value in vars(buffers).values() if isinstance(value, list) for tensor in value if tensor is not None]
    if buffers.fused is not None:
        held.append(buffers.fused._features)
    fused = buffers.fused is not None
    told = bytes_per_vertex(16, _LAYOUT.widths, value_bytes=dtype.itemsize, keep_outputs=keep_outputs, fused=fused)
    # In one launch there is room for another block.
    rows = 128 + (ROWS if fused else 0)
    assert sum(tensor.untyped_storage().nbytes() for tensor in held) == rows * told


def test_other_networks_have_no_use_for_buffers() -> None:
    assert DisplacementNetwork(16, (16, 16, 16), 16).has_use_for_buffers
    assert not DisplacementNetwork(16, (16, 16, 16), 16, skip=True).has_use_for_buffers
    assert not DisplacementNetwork(16, (16, 16), 16, convolution=ChebyshevConvolution).has_use_for_buffers


def test_a_training_gives_its_buffers_back_when_it_ends_or_is_stopped(noisy_sphere: TriangleMesh) -> None:
    settings = settings_for("denoise", "compact", device="cpu", threads=1, steps=4)
    whole, stopped = (DeepMeshPrior(denoising(noisy_sphere, settings), settings) for _ in range(2))
    records = list(whole.steps())
    steps = stopped.steps()
    for _ in range(3):
        next(steps)
    assert stopped._buffers is not None
    steps.close()  # type: ignore[attr-defined]
    assert stopped._buffers is None and whole._buffers is None
    *_, last = stopped.steps()
    assert last.snapshot is not None and records[-1].snapshot is not None
    assert np.array_equal(last.snapshot.vertices, records[-1].snapshot.vertices)
