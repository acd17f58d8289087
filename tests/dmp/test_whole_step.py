"""A training step in one launch, against the same step as a series of operations, which have tests of their own."""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

import numpy as np
import pytest
import torch

from dmp.adam import Adam
from dmp.benchmark.meshes import noisy_torus
from dmp.compiled.phase_table import PhaseTable
from dmp.deep_mesh_prior import DeepMeshPrior
from dmp.errors import TrainingError
from dmp.layers import stack_buffers
from dmp.layers.gcn_stack import layer_parameters
from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.problem import denoising
from dmp.settings import settings_for
from dmp.whole_step import Trained, WholeStep

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


# Blocks of 128, 113 and 119 rows; the last of the latter has 97.
@pytest.mark.parametrize("n_vertices", [300, 1350, 2600])
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
    for number in range(4):
        for group in (training._optimiser.param_groups[0], reference.param_groups[0]):
            group["lr"] = 0.003 / (1 + number)
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
    assert _parts(training) == 2
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        found = [next(steps).metrics["total_loss"] for _ in range(3)]
    finally:
        torch.set_num_threads(before)
    assert _parts(training) == 1
    alone = [item.metrics["total_loss"] for item in _training(noisy_torus(1350), threads=1).steps()]
    assert found == pytest.approx(alone[3:6], rel=1e-3)


def _parts(training: DeepMeshPrior) -> int:
    assert training._whole_step is not None and training._whole_step._table is not None
    return training._whole_step._table.parts


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf"), -3.4e38, 1e-45])
def test_one_gradient_that_is_not_finite_keeps_all_parameters_as_they_are(value: float, threads: int) -> None:
    training = _training(noisy_torus(1350), threads=threads)
    steps = training.steps()
    for _ in range(2):
        next(steps)
    step = training._whole_step
    assert step is not None
    # The two last phases alone, so that gradients are what they are set to.
    table, flags = PhaseTable(_parts(training)), np.zeros(3, dtype=np.int32)
    step._add_update(table, flags)
    table.place()
    n_gradients = len(step._gradients)
    for place in (0, 15, 16, n_gradients // 3, n_gradients // 2, n_gradients // 3 * 2, n_gradients - 2, n_gradients - 1):
        step._gradients.fill_(0.5)
        step._gradients[place] = value
        before = _values(training)
        table.run()
        assert flags.any() == (not np.isfinite(value))
        assert torch.equal(_values(training), before) == (not np.isfinite(value))


def test_a_loss_that_is_not_finite_keeps_all_parameters_as_they_are() -> None:
    training = _training(noisy_torus(1350))
    steps = training.steps()
    for _ in range(3):
        next(steps)
    # Its square is infinite, and what a distance pulls with is divided by its length.
    training._target[0] = 1e30
    before = _values(training)
    with pytest.raises(TrainingError, match="at step 3: the loss is"):
        next(steps)
    assert torch.equal(_values(training), before)
    assert float(training.state()["optimiser"]["state"][0]["step"]) == 2


def _values(training: DeepMeshPrior) -> torch.Tensor:
    return torch.cat([parameter.detach().flatten().clone() for parameter in training._network.parameters()])


@pytest.mark.parametrize("whole", [True, False])
def test_after_a_step_that_failed_the_last_good_one_is_shown_and_can_be_gone_on_from(whole: bool) -> None:
    training, reference = (_training(noisy_torus(400), whole=whole, average=0.0) for _ in range(2))
    expected = [item.metrics["total_loss"] for item in reference.steps()]
    steps = training.steps()
    for _ in range(4):
        next(steps)
    shown, target = training._prediction().clone(), training._target[0].clone()
    training._target[0] = float("nan")
    with pytest.raises(TrainingError):
        next(steps)
    if whole:
        assert torch.equal(training._prediction(), shown)
    training._target[0] = target
    assert [item.metrics["total_loss"] for item in training.steps()] == expected[4:]


@pytest.mark.parametrize("whole", [True, False])
def test_a_step_that_is_broken_off_is_not_gone_on_from(whole: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    training = _training(noisy_torus(400), whole=whole)
    steps = training.steps()
    for item in steps:
        if item.step == 3:
            break
    kept = copy.deepcopy(training.state())

    def interrupted() -> None:
        raise KeyboardInterrupt

    # Between the update of the weights and that of the average.
    monkeypatch.setattr(training, "_update_average", interrupted)
    with pytest.raises(KeyboardInterrupt):
        next(steps)
    monkeypatch.undo()
    for use in (training.state, lambda: next(training.steps())):
        with pytest.raises(TrainingError, match="Step 4 was broken off half-way"):
            use()
    training.load_state(kept)
    losses = [item.metrics["total_loss"] for item in training.steps()]
    assert losses == [item.metrics["total_loss"] for item in _training(noisy_torus(400), whole=whole).steps()][4:]


def test_a_backward_pass_from_before_a_whole_step_is_refused() -> None:
    training = _training(noisy_torus(400))
    steps = training.steps()
    for _ in range(2):
        next(steps)
    loss = training._forward()["total_loss"]
    next(steps)
    with pytest.raises(RuntimeError, match="used by another forward pass"):
        loss.backward()  # type: ignore[no-untyped-call]


def test_another_forward_pass_through_the_same_memory_changes_no_step() -> None:
    training, reference = (_training(noisy_torus(400)) for _ in range(2))
    expected = [item.metrics["total_loss"] for item in reference.steps()]
    found = []
    for item in training.steps():
        found.append(item.metrics["total_loss"])
        if training._buffers is not None:
            assert isinstance(training._graph, torch.Tensor)
            with torch.no_grad():
                training._network(training._features + 1, training._graph, training._buffers)
    assert found == expected


def test_what_does_not_go_together_is_refused() -> None:
    training = _training(noisy_torus(400))
    other = _training(noisy_torus(300))
    buffers, graph, losses = training._layer_buffers(), training._graph, training._losses_on_processor()
    network, optimiser = training._network, training._optimiser
    assert buffers is not None and isinstance(graph, torch.Tensor) and network.hidden is not None
    layers = layer_parameters(network.convolutions, network.normalisations)
    ends = [network.hidden.weight, network.hidden.bias, network.output.weight, network.output.bias]
    fits = Trained(buffers, graph, training._features, layers, ends, training._base)
    assert float(WholeStep(fits, losses, optimiser)()[0]) > 0
    wide = [torch.zeros(500, ends[0].shape[1]), torch.zeros(500), torch.zeros(3, 500), torch.zeros(3)]
    refused: list[tuple[dict[str, Any], Any, Any, str]] = [
        ({"ends": wide}, losses, optimiser, "linear layers do not go together"),
        ({"ends": [*ends[:2], ends[2].detach().T, ends[3]]}, losses, optimiser, "linear layers do not go together"),
        ({"base": training._base[:-1]}, losses, optimiser, "must have its size"),
        ({"base": training._base.double()}, losses, optimiser, "float32 and contiguous"),
        ({"features": training._features[:-1], "base": None}, losses, optimiser, "positions|features"),
        ({"propagation": other._graph}, losses, optimiser, "the matrix has"),
        ({}, other._losses_on_processor(), optimiser, "positions in float32"),
        ({}, losses, Adam(network.convolutions.parameters(), lr=0.1), "other parameters"),
    ]
    for changes, its_losses, its_optimiser, words in refused:
        with pytest.raises(ValueError, match=words):
            WholeStep(dataclasses.replace(fits, **changes), its_losses, its_optimiser)()


@pytest.mark.parametrize("overrides", [{"skip": True}, {"convolution": "chebyshev"}, {"precision": "bfloat16"}])
def test_what_cannot_be_one_launch_goes_as_before(overrides: dict[str, Any], noisy_sphere: TriangleMesh) -> None:
    training = _training(noisy_sphere, **overrides)
    steps = training.steps()
    for _ in range(3):
        next(steps)
    assert training._whole_step is None


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
