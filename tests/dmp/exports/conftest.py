"""Runs to export from: one that denoised, one that filled a hole. Trained once for all tests."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from dmp import rendering
from dmp.completion import completion
from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.problem import denoising
from dmp.runs import Run, record
from dmp.settings import settings_for
from dmp.shapes.alterations import with_holes
from tests.meshes import grid_mesh


def _trained(run: Run) -> Run:
    training = training_for(run.problem(), run.settings, run_id=run.run_id)
    for _ in record(training, run):
        pass
    return run


@pytest.fixture(scope="session")
def denoised_once(tmp_path_factory: pytest.TempPathFactory, noisy_sphere: TriangleMesh, sphere: TriangleMesh) -> Path:
    settings = replace(settings_for(steps=20, snapshot_every=5, log_every=5, threads=1, width_divisor=16))
    problem = denoising(noisy_sphere, settings, sphere)
    folder = tmp_path_factory.mktemp("runs") / "denoised"
    _trained(Run.create(problem, settings, folder=folder, name="<ball>"))
    return folder


@pytest.fixture
def denoised(denoised_once: Path, tmp_path: Path) -> Run:
    """A finished run with a ground truth and the snapshots 0, 5, 10, 15 and 20."""
    shutil.copytree(denoised_once, tmp_path / "run")
    return Run.open(tmp_path / "run")


@pytest.fixture(scope="session")
def completed_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    sheet = with_holes(grid_mesh(12), [(6.0, 6.0, 0.0)], [12])
    settings = settings_for("complete", "compact", steps=4, snapshot_every=2, threads=1, width_divisor=16)
    folder = tmp_path_factory.mktemp("runs") / "completed"
    _trained(Run.create(completion(sheet, settings), settings, folder=folder, name="sheet"))
    return folder


@pytest.fixture
def completed(completed_once: Path) -> Run:
    """A finished run that filled one hole of a sheet."""
    return Run.open(completed_once)


@pytest.fixture
def can_draw() -> None:
    if not rendering.can_render():
        pytest.skip("this machine offers no way to draw")
