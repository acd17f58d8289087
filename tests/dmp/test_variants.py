"""Every variant of the paper's method trains, repeats bit for bit, and goes on from a run folder as if never stopped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dmp.errors import TrainingError
from dmp.mesh import FloatArray, TriangleMesh
from dmp.methods import training_for
from dmp.problem import Problem, denoising
from dmp.runs import Run, record
from dmp.settings import Settings, settings_for

VARIANTS = {
    "chebyshev": {"convolution": "chebyshev", "chebyshev_order": 3},
    "gmm": {"convolution": "gmm"},
    "gmm-geometric": {"convolution": "gmm-geometric", "gmm_kernels": 3},
    "skip": {"skip": True},
    "skip, gmm-geometric": {"skip": True, "convolution": "gmm-geometric"},
    "2021-04": {"preset": "paper-2021-04", "width_divisor": 8},
    "spherical": {"smoothing": "spherical"},
    "positions": {"predict": "position", "scaling": "box"},
    "no Laplacian term": {"laplacian_weight": 0.0},
}


@pytest.fixture(params=VARIANTS.values(), ids=VARIANTS.keys())
def settings(request: pytest.FixtureRequest) -> Settings:
    return settings_for("denoise", **{"steps": 6, "snapshot_every": 3, "log_every": 3, "threads": 1, **request.param})


def _trained(problem: Problem, settings: Settings) -> tuple[FloatArray, dict[str, float]]:
    *_, last = training_for(problem, settings).steps()
    assert last.snapshot is not None
    return last.snapshot.vertices, dict(last.metrics)


def test_training_repeats_bit_for_bit_and_lowers_the_loss(noisy_sphere: TriangleMesh, settings: Settings) -> None:
    problem = denoising(noisy_sphere, settings)
    vertices, metrics = _trained(problem, settings)
    torch.manual_seed(77)  # the caller's own random numbers have no part in it
    again, metrics_again = _trained(denoising(noisy_sphere, settings), settings)
    assert np.array_equal(vertices, again)
    assert metrics == metrics_again
    other, _ = _trained(problem, replace(settings, seed=1))
    assert not np.array_equal(vertices, other)
    first = next(training_for(problem, settings).steps())
    assert metrics["total_loss"] < first.metrics["total_loss"]


def test_going_on_from_the_run_folder_is_bit_exact(noisy_sphere: TriangleMesh, settings: Settings, tmp_path: Path) -> None:
    problem = denoising(noisy_sphere, settings)
    whole, parts = (Run.create(problem, settings, folder=tmp_path / name) for name in ("whole", "parts"))
    for _ in record(whole.resume(), whole):
        pass
    records = record(parts.resume(), parts)
    for item in records:
        if item.step == 4:
            break
    records.close()  # type: ignore[attr-defined]
    stopped = Run.open(parts.folder)
    assert stopped.settings == settings
    for _ in record(stopped.resume(), stopped):
        pass
    assert np.array_equal(Run.open(parts.folder).snapshot(6).vertices, Run.open(whole.folder).snapshot(6).vertices)


def test_a_checkpoint_of_another_convolution_is_refused(noisy_sphere: TriangleMesh) -> None:
    def training(convolution: str) -> object:
        settings = settings_for("denoise", convolution=convolution, threads=1, steps=3)
        return training_for(denoising(noisy_sphere, settings), settings)

    with pytest.raises(TrainingError, match=r"does not fit|another network"):
        training("gmm").load_state(training("chebyshev").state())  # type: ignore[attr-defined]


def test_position_prediction_forgets_the_smoothed_mesh(noisy_sphere: TriangleMesh) -> None:
    """The paper's comparison 'Pos.': the output itself is the position, whatever the base."""
    settings = settings_for("denoise", "paper", predict="position", width_divisor=8, threads=1, steps=4, snapshot_every=4)
    results = [
        _trained(denoising(noisy_sphere, replace(settings, smoothing=kind)), settings)[0] for kind in ("laplacian", "none")
    ]
    assert np.array_equal(*results)
    plain = replace(settings, predict="displacement")
    assert not np.array_equal(_trained(denoising(noisy_sphere, plain), plain)[0], results[0])


def test_without_smoothing_the_untrained_displacement_starts_at_the_input(noisy_sphere: TriangleMesh) -> None:
    settings = settings_for("denoise", "paper", smoothing="none", laplacian_weight=0.0, width_divisor=8, threads=1, steps=60)
    records = [item for item in training_for(denoising(noisy_sphere, settings), settings).steps() if item.metrics]
    # The network soon learns to displace nothing, so nothing is denoised either.
    assert records[-1].metrics["input_distance"] < 0.5 * records[0].metrics["input_distance"]


def test_the_weight_of_the_laplacian_term_is_the_weight_in_the_total(noisy_sphere: TriangleMesh) -> None:
    for weight in (0.0, 0.5):
        settings = settings_for("denoise", laplacian_weight=weight, threads=1)
        losses = next(training_for(denoising(noisy_sphere, settings), settings).steps()).metrics
        assert losses["total_loss"] == pytest.approx(losses["data_loss"] + weight * losses["laplacian_loss"], rel=1e-6)


def test_the_published_code_of_2021_has_its_own_loss(noisy_sphere: TriangleMesh) -> None:
    settings = settings_for("denoise", "paper-2021-04", width_divisor=8, threads=1)
    training = training_for(denoising(noisy_sphere, settings), settings)
    problem = training.problem
    first = next(training.steps())
    assert first.snapshot is not None
    # Written as the code of that time does it, vertex by vertex.
    q, y = (problem.to_training_units(v) for v in (first.snapshot.vertices, problem.target))
    neighbours: list[set[int]] = [set() for _ in q]
    for face in noisy_sphere.faces.tolist():
        for vertex in face:
            neighbours[vertex] |= set(face) - {vertex}
    residuals = [len(around) * q[i] - q[list(around)].sum(axis=0) for i, around in enumerate(neighbours)]
    smoothness = np.mean([np.sqrt((residual**2).sum() + 1e-6) for residual in residuals])
    distance = np.linalg.norm(q - y, axis=1).mean()
    assert first.metrics["data_loss"] == pytest.approx(distance, rel=1e-4)
    assert first.metrics["laplacian_loss"] == pytest.approx(smoothness, rel=1e-4)
    assert first.metrics["total_loss"] == pytest.approx(distance + 0.2 * smoothness, rel=1e-4)
