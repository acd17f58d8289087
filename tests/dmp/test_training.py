from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from dmp.errors import MeshError, SettingsError, TrainingError
from dmp.mesh import TriangleMesh
from dmp.methods import train, training_for
from dmp.network import DisplacementNetwork, scaled_widths
from dmp.problem import denoising
from dmp.settings import Settings, settings_for
from dmp.training import Training
from tests.meshes import grid_mesh


def _settings(**overrides: object) -> Settings:
    return settings_for("denoise", **{"steps": 20, "snapshot_every": 10, "log_every": 5, "threads": 1, **overrides})


def _small_training(mesh: TriangleMesh, truth: TriangleMesh | None = None, **overrides: object) -> Training:
    settings = _settings(**overrides)
    return training_for(denoising(mesh, settings, truth), settings)


def test_published_network_has_the_published_number_of_parameters() -> None:
    assert sum(p.numel() for p in DisplacementNetwork().parameters()) == 751_075
    assert scaled_widths(4) == (16, 16, 32, 64, 64, 128, 128, 64, 64, 32, 16, 16, 16)


def test_training_removes_noise(noisy_sphere: TriangleMesh, sphere: TriangleMesh) -> None:
    training = _small_training(noisy_sphere, sphere, steps=150, snapshot_every=50)
    snapshots = [record.snapshot for record in training.steps() if record.snapshot]
    truth = training.problem.ground_truth
    assert truth is not None
    assert [snapshot.step for snapshot in snapshots] == [0, 50, 100, 150]
    before = truth.measures(noisy_sphere.vertices)
    assert snapshots[-1].metrics["mad"] < 0.5 * before["mad"]
    assert snapshots[-1].metrics["mad"] == pytest.approx(truth.mad(snapshots[-1].vertices))


def test_one_seed_gives_one_result_and_another_seed_another(noisy_sphere: TriangleMesh) -> None:
    def result(seed: int) -> np.ndarray:
        *_, last = train(training.problem, _settings(seed=seed))
        return last.vertices

    training = _small_training(noisy_sphere)
    torch.manual_seed(int(np.random.default_rng().integers(1000)))  # whatever the caller did with the global generator
    first = result(1)
    assert np.array_equal(first, result(1))
    assert not np.array_equal(first, result(2))


def test_the_callers_random_numbers_are_left_alone(noisy_sphere: TriangleMesh) -> None:
    torch.manual_seed(3)
    expected = torch.rand(4)
    torch.manual_seed(3)
    list(_small_training(noisy_sphere, steps=2).steps())
    assert torch.equal(torch.rand(4), expected)


@pytest.mark.parametrize("average", [0.0, 0.99])
def test_going_on_from_a_state_is_bit_exact(noisy_sphere: TriangleMesh, average: float) -> None:
    whole = [r for r in _small_training(noisy_sphere, average=average).steps() if r.metrics]
    first = _small_training(noisy_sphere, average=average)
    for record in first.steps():
        if record.step == 10:
            break
    second = _small_training(noisy_sphere, average=average)
    second.load_state(first.state())
    rest = [r for r in second.steps() if r.metrics]
    assert [r.step for r in rest] == [15, 20]
    assert [dict(r.metrics) for r in rest] == [dict(r.metrics) for r in whole[-2:]]
    assert rest[-1].snapshot is not None and whole[-1].snapshot is not None
    assert np.array_equal(rest[-1].snapshot.vertices, whole[-1].snapshot.vertices)


def test_a_state_of_another_network_is_refused(noisy_sphere: TriangleMesh) -> None:
    state = _small_training(noisy_sphere, width_divisor=8).state()
    with pytest.raises(TrainingError, match="does not fit"):
        _small_training(noisy_sphere, width_divisor=2).load_state(state)


def test_results_do_not_depend_on_the_units_and_place_of_the_file(noisy_sphere: TriangleMesh) -> None:
    # Few steps and several seeds: rounding differs, and Adam makes whole steps of gradients next to 0, so differences grow fast
    # with some seeds.
    moved = noisy_sphere.with_vertices(1e-3 * noisy_sphere.vertices + [1e3, -1e3, 5e2])
    moves, losses = [], []
    for seed in range(5):
        settings = _settings(steps=3, seed=seed)
        *_, here = train(denoising(noisy_sphere, settings), settings)
        *_, there = train(denoising(moved, settings), settings)
        moves.append(np.abs((there.vertices - [1e3, -1e3, 5e2]) * 1e3 - here.vertices).max())
        losses.append(abs(there.metrics["data_loss"] / here.metrics["data_loss"] - 1))
    assert np.median(moves) < 1e-5 and np.median(losses) < 1e-5


def test_held_out_vertices_never_enter_the_data_term(noisy_sphere: TriangleMesh) -> None:
    settings = _settings(hold_out=0.1)
    training = training_for(denoising(noisy_sphere, settings), settings)
    assert len(training.held_out) == round(0.1 * noisy_sphere.n_vertices)
    spoiled = noisy_sphere.vertices.copy()
    spoiled[training.held_out] += 50.0
    problem = training.problem
    # The same base and units, so that only the hidden targets differ.
    other = training_for(replace(problem, mesh=noisy_sphere.with_vertices(spoiled)), settings)
    left = [r.snapshot.vertices for r in training.steps() if r.snapshot]
    right = [r.snapshot.vertices for r in other.steps() if r.snapshot]
    assert np.array_equal(left[-1], right[-1])


def test_no_averaging_shows_the_output_itself(noisy_sphere: TriangleMesh) -> None:
    plain, averaged = (
        [r.snapshot for r in _small_training(noisy_sphere, average=a).steps() if r.snapshot][-1] for a in (0.0, 0.99)
    )
    assert plain.metrics["data_loss"] == averaged.metrics["data_loss"]
    assert not np.array_equal(plain.vertices, averaged.vertices)


def test_metrics_of_a_prediction_are_those_of_the_definitions(noisy_sphere: TriangleMesh) -> None:
    training = _small_training(noisy_sphere, hold_out=0.1)
    *_, last = training.steps()
    assert last.snapshot is not None
    problem, vertices = training.problem, last.snapshot.vertices
    residual = (vertices - noisy_sphere.vertices) / problem.edge_length
    assert last.metrics["displacement"] == pytest.approx(
        np.linalg.norm(vertices - problem.base, axis=1).mean() / problem.edge_length
    )
    assert last.metrics["input_distance"] == pytest.approx(np.linalg.norm(residual, axis=1).mean())
    assert last.metrics["held_out_error"] == pytest.approx(np.linalg.norm(residual[training.held_out], axis=1).mean())
    assert last.metrics["held_out_normal_error"] <= last.metrics["held_out_error"]


def test_numbers_out_of_range_stop_the_training_in_words(noisy_sphere: TriangleMesh) -> None:
    training = _small_training(noisy_sphere, steps=50)
    steps = training.steps()
    next(steps)
    with torch.no_grad():
        next(training._network.parameters()).fill_(float("nan"))
    with pytest.raises(TrainingError, match="step 1"):
        next(steps)


@pytest.mark.parametrize("form", ["mean", "sum"])
@pytest.mark.parametrize("predict", ["displacement", "position"])
def test_the_published_variants_train(noisy_sphere: TriangleMesh, form: str, predict: str) -> None:
    records = list(_small_training(noisy_sphere, laplacian_form=form, predict=predict, steps=15).steps())
    assert records[-1].metrics["total_loss"] < records[0].metrics["total_loss"]


def test_open_and_non_manifold_meshes_with_several_pieces_train() -> None:
    sheet = grid_mesh(6, height=0.1)
    faces = np.vstack([sheet.faces, sheet.faces + sheet.n_vertices, [[0, 1, 20], [0, 1, 30]]])
    mesh = TriangleMesh(np.vstack([sheet.vertices, sheet.vertices + np.array([0, 0, 5])]), faces)
    records = list(_small_training(mesh, steps=3).steps())
    assert np.isfinite(records[-1].metrics["total_loss"])


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (TriangleMesh(np.eye(3), np.zeros((0, 3), dtype=int)), "no faces"),
        (TriangleMesh(np.outer(np.arange(4.0), np.ones(3)), np.array([[0, 1, 2], [1, 2, 3]])), "no area"),
        (TriangleMesh(np.zeros((4, 3)), np.array([[0, 1, 2], [1, 2, 3]])), "units large"),
    ],
)
def test_what_cannot_be_trained_on_is_refused_in_one_line(mesh: TriangleMesh, words: str) -> None:
    with pytest.raises(MeshError, match=words) as caught:
        denoising(mesh, _settings())
    assert "\n" not in str(caught.value)


def test_a_device_that_is_not_there_is_refused(noisy_sphere: TriangleMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(SettingsError, match="--device cuda"):
        _small_training(noisy_sphere, device="cuda")
