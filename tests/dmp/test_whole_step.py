"""A training step in one launch, against the same step as a series of operations, which have tests of their own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from dmp.benchmark.meshes import noisy_torus
from dmp.deep_mesh_prior import DeepMeshPrior
from dmp.layers import stack_buffers
from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.problem import denoising
from dmp.settings import settings_for

pytestmark = pytest.mark.skipif(stack_buffers.packing_for(torch.float32) is None, reason="torch brings no MKL along here")


def _training(mesh: TriangleMesh, preset: str = "compact", *, whole: bool = True, **overrides: Any) -> DeepMeshPrior:
    few = {"steps": 12, "snapshot_every": 4, "log_every": 1, "threads": 2, "device": "cpu", "precision": "float32", **overrides}
    settings = settings_for("denoise", preset, **few)
    training = training_for(denoising(mesh, settings), settings)
    assert isinstance(training, DeepMeshPrior)
    training.makes_whole_steps = whole
    return training


def _shaken(training: DeepMeshPrior) -> DeepMeshPrior:
    """Change what begins as 0 or 1, so that a confusion of them would be seen."""
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for parameter in training._network.parameters():
            if parameter.ndim == 1:
                parameter.add_(torch.randn(parameter.shape, generator=generator), alpha=0.3)
    return training


VARIANTS: dict[str, dict[str, Any]] = {
    "compact": {},
    "paper": {"preset": "paper"},
    "2021-04, wide linear layers": {"architecture": "2021-04"},
    "positions": {"predict": "position"},
    "sum": {"laplacian_form": "sum", "laplacian_of": "change"},
    "held out": {"hold_out": 0.2},
    "one thread": {"threads": 1},
    "three threads": {"threads": 3},
}


@pytest.mark.parametrize("n_vertices", [300, 1350])
@pytest.mark.parametrize("variant", VARIANTS)
def test_losses_gradients_and_output_are_those_of_a_series_of_operations(variant: str, n_vertices: int) -> None:
    whole, apart = (
        _shaken(_training(noisy_torus(n_vertices), whole=is_whole, **VARIANTS[variant])) for is_whole in (True, False)
    )
    torch.set_num_threads(whole.threads)
    expected = apart._compute_gradients()
    found = whole._update()
    for name, value in expected.items():
        torch.testing.assert_close(found[name], value, rtol=1e-6, atol=1e-7)
    torch.testing.assert_close(whole._output, apart._output, rtol=1e-5, atol=1e-6)
    step = whole._whole_step
    assert step is not None and step.is_finite
    gradients = step.gradients()
    assert len(gradients) == len(list(whole._network.parameters()))
    for (name, mine), other in zip(whole._network.named_parameters(), apart._network.parameters(), strict=True):
        assert other.grad is not None
        assert gradients[mine].shape == mine.shape
        assert float((gradients[mine] - other.grad).abs().max()) <= 1e-5 * float(other.grad.abs().max()), name


@pytest.mark.parametrize("threads", [1, 2])
def test_the_update_is_adam_with_these_gradients(threads: int) -> None:
    training = _training(noisy_torus(1350), threads=threads, learning_rate=0.003)
    parameters = list(training._network.parameters())
    theirs = [torch.nn.Parameter(parameter.detach().clone()) for parameter in parameters]
    reference = torch.optim.Adam(theirs, lr=0.003, foreach=False, fused=False)
    steps = training.steps()
    next(steps)
    for _ in range(4):
        next(steps)
        assert training._whole_step is not None
        of = training._whole_step.gradients()
        for mine, other in zip(parameters, theirs, strict=True):
            other.grad = of[mine].clone()
        reference.step()
        for mine, other in zip(parameters, theirs, strict=True):
            torch.testing.assert_close(mine, other, rtol=1e-5, atol=1e-7)


def test_it_goes_the_same_way_as_a_series_of_operations() -> None:
    mesh = noisy_torus(1350)
    whole, apart = (list(_training(mesh, whole=is_whole).steps()) for is_whole in (True, False))
    assert [item.step for item in whole] == [item.step for item in apart]
    # Rounding grows from step to step.
    for mine, other in zip(whole[:6], apart[:6], strict=True):
        for name, value in other.metrics.items():
            assert mine.metrics[name] == pytest.approx(value, rel=2e-3), (mine.step, name)


@pytest.mark.parametrize("threads", [1, 2])
def test_two_trainings_agree_to_the_last_bit(threads: int, noisy_sphere: TriangleMesh) -> None:
    one, other = (_training(noisy_sphere, threads=threads) for _ in range(2))
    for mine, its in zip(one.steps(), other.steps(), strict=True):
        assert dict(mine.metrics) == dict(its.metrics)
        assert (mine.snapshot is None) == (its.snapshot is None)
        if mine.snapshot is not None and its.snapshot is not None:
            assert np.array_equal(mine.snapshot.vertices, its.snapshot.vertices)


def test_going_on_from_a_state_changes_no_bit(noisy_sphere: TriangleMesh) -> None:
    through, first, second = (_training(noisy_sphere) for _ in range(3))
    *_, last = through.steps()
    for item in first.steps():
        if item.step == 5:
            break
    second.load_state(first.state())
    *_, again = second.steps()
    # And in the training that has made its table already.
    first.load_state(first.state())
    *_, once_more = first.steps()
    assert last.snapshot is not None and again.snapshot is not None and once_more.snapshot is not None
    assert np.array_equal(last.snapshot.vertices, again.snapshot.vertices)
    assert np.array_equal(last.snapshot.vertices, once_more.snapshot.vertices)


def test_another_number_of_threads_is_taken_up_between_two_steps() -> None:
    # As another training in this process would change it.
    training = _training(noisy_torus(1350), threads=2)
    steps = training.steps()
    for _ in range(3):
        next(steps)
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        found = [next(steps).metrics["total_loss"] for _ in range(3)]
    finally:
        torch.set_num_threads(before)
    alone = [item.metrics["total_loss"] for item in _training(noisy_torus(1350), threads=1).steps()]
    assert found == pytest.approx(alone[3:6], rel=1e-3)


@pytest.mark.parametrize(
    "overrides", [{"skip": True}, {"convolution": "chebyshev"}, {"precision": "bfloat16"}, {"average": 0.0}]
)
def test_what_cannot_be_one_launch_goes_as_before(overrides: dict[str, Any], noisy_sphere: TriangleMesh) -> None:
    training = _training(noisy_sphere, **overrides)
    for item in training.steps():
        if item.step == 3:
            assert (training._whole_step is None) == ("average" not in overrides)


def test_without_a_product_it_goes_as_before(noisy_sphere: TriangleMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stack_buffers, "packing_for", lambda _: None)
    training = _training(noisy_sphere)
    *_, last = training.steps()
    assert training._whole_step is None and last.step == 12


def test_the_memory_is_given_back_when_a_training_is_stopped(noisy_sphere: TriangleMesh) -> None:
    training = _training(noisy_sphere)
    steps = training.steps()
    for _ in range(3):
        next(steps)
    assert training._whole_step is not None
    steps.close()  # type: ignore[attr-defined]
    assert training._whole_step is None
