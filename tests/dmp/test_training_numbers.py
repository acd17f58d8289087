"""Numbers that are none stop a training at their step; what was good before stays."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import torch

from dmp.completion import problem_for
from dmp.deep_mesh_prior import DeepMeshPrior
from dmp.errors import TrainingError
from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.runs import Run, record
from dmp.settings import Settings, settings_for
from dmp.shapes.alterations import with_holes
from dmp.training import Training
from tests.meshes import grid_mesh

METHODS = {"prior": ("denoise", "compact"), "recorrupted": ("denoise", "best"), "made-up holes": ("complete", "best")}
Spoil = Callable[[Training], None]


def _set_up(method: str, mesh: TriangleMesh, **changes: object) -> tuple[TriangleMesh, Settings]:
    task, preset = METHODS[method]
    quick = {"steps": 6, "snapshot_every": 2, "log_every": 1, "threads": 1, **changes}
    if method == "recorrupted":
        quick["bilateral_layers"] = 2
    if task == "complete":
        mesh = with_holes(grid_mesh(16, height=0.05), [(7.0, 7.0, 0.0)], [9])
    return mesh, settings_for(task, preset, **quick)


def _spoil_loss(training: Training) -> None:
    if isinstance(training, DeepMeshPrior):
        training._target[0] = float("inf")
        return
    compute = training._compute_gradients

    def spoilt() -> dict[str, torch.Tensor]:
        losses = dict(compute())
        losses["total_loss"] = torch.tensor(float("inf"))
        return losses

    training._compute_gradients = spoilt  # type: ignore[method-assign]


def _spoil_gradient(training: Training) -> None:
    if isinstance(training, DeepMeshPrior):
        # What goes into the linear layers is huge and comes out as before; gradients there are the product of both.
        network = training._network
        with torch.no_grad():
            for huge, tiny in zip(network.normalisations[-1].parameters(), network.hidden.parameters(), strict=True):
                huge.mul_(1e36)
                tiny.mul_(1 if tiny.ndim == 1 else 1e-36)
            network.output.weight.mul_(1e6)
        return
    compute = training._compute_gradients

    def spoilt() -> Mapping[str, torch.Tensor]:
        losses = compute()
        gradient = next(training._network.parameters()).grad
        assert gradient is not None
        gradient.view(-1)[1] = float("nan")
        return losses

    training._compute_gradients = spoilt  # type: ignore[method-assign]


def _spoil_output(training: Training) -> None:
    prediction = training._prediction

    def spoilt() -> torch.Tensor:
        output = prediction().clone()
        output[1] = float("nan")
        return output

    training._prediction = spoilt  # type: ignore[method-assign]


SPOILS: dict[str, tuple[Spoil, str]] = {
    "loss": (_spoil_loss, r"at step 4: the loss is inf\."),
    "gradient": (_spoil_gradient, r"at step 4: the gradient of the loss is not finite\."),
    "output": (_spoil_output, r"at step 4: 1 of \d+ predicted positions are not finite\."),
}


@pytest.mark.parametrize("spoil", SPOILS)
@pytest.mark.parametrize("method", METHODS)
def test_the_run_stops_at_that_step_and_keeps_the_last_good_one(
    method: str, spoil: str, noisy_sphere: TriangleMesh, tmp_path: Path
) -> None:
    mesh, settings = _set_up(method, noisy_sphere)
    run = Run.create(problem_for(mesh, settings), settings, folder=tmp_path / "run")
    training = run.resume()
    records = record(training, run)
    do, words = SPOILS[spoil]
    for item in records:
        if item.step == 3:
            break
    do(training)
    with pytest.raises(TrainingError, match=words):
        next(records)
    opened = Run.open(run.folder)
    assert opened.state == "failed"
    assert "at step 4" in opened.reason
    assert json.loads((run.folder / "run.json").read_text())["reason"] == opened.reason
    assert opened.snapshot_steps() == [0, 2]
    assert [row["step"] for row in opened.curve()] == [0, 1, 2, 3]
    assert np.isfinite(opened.snapshot(2).vertices).all()
    # From the checkpoint of the last snapshot it goes on as if nothing had been.
    again = opened.resume()
    assert again.step == 2
    assert all(torch.isfinite(parameter).all() for parameter in again._network.parameters())
    assert len(list(record(again, opened))) == 4
    assert Run.open(run.folder).state == "finished"
    assert Run.open(run.folder).reason == ""


@pytest.mark.parametrize("spoil", ["loss", "gradient"])
@pytest.mark.parametrize("method", METHODS)
def test_the_weights_are_those_of_the_last_good_step(method: str, spoil: str, noisy_sphere: TriangleMesh) -> None:
    mesh, settings = _set_up(method, noisy_sphere)
    training = training_for(problem_for(mesh, settings), settings)
    steps = training.steps()
    for item in steps:
        if item.step == 3:
            break
    SPOILS[spoil][0](training)
    before = [parameter.detach().clone() for parameter in training._network.parameters()]
    count = training.state()["optimiser"]["state"][0]["step"]
    with pytest.raises(TrainingError):
        next(steps)
    assert training.step == 3
    assert all(torch.equal(now, then) for now, then in zip(training._network.parameters(), before, strict=True))
    assert training.state()["optimiser"]["state"][0]["step"] == count == 3


def test_where_looking_waits_for_the_device_the_right_step_is_named_at_the_next_logged_one(
    noisy_sphere: TriangleMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh, settings = _set_up("prior", noisy_sphere, steps=20, snapshot_every=20, log_every=10)
    training = training_for(problem_for(mesh, settings), settings)
    monkeypatch.setattr(type(training), "_looks_at_each_step", False)
    assert isinstance(training, DeepMeshPrior)
    training.makes_whole_steps = False
    steps = training.steps()
    for item in steps:
        if item.step == 12:
            break
    _spoil_gradient(training)
    reached = []
    with pytest.raises(TrainingError, match="at step 13: the loss or its gradient"):
        reached += [item.step for item in steps]
    assert max(reached, default=13) < 20


def test_a_loss_that_is_none_from_the_start_is_told(noisy_sphere: TriangleMesh) -> None:
    mesh, settings = _set_up("prior", noisy_sphere)
    training = training_for(problem_for(mesh, settings), settings)
    with torch.no_grad():
        next(training._network.parameters()).fill_(float("nan"))
    with pytest.raises(TrainingError, match="at step 0: the loss is nan"):
        next(training.steps())
