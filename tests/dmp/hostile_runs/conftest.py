"""An honest run, and copies of it to damage."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from dmp.problem import denoising
from dmp.runs import Run, record
from dmp.settings import settings_for
from tests.meshes import sphere_mesh


@pytest.fixture(scope="session")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 4 of its 8 steps, with a kept step; not to be changed."""
    sphere = sphere_mesh(2)
    noisy = sphere.with_vertices(sphere.vertices + 0.03 * np.random.default_rng(0).standard_normal(sphere.vertices.shape))
    settings = settings_for("denoise", steps=8, snapshot_every=2, log_every=1, threads=1, width_divisor=16)
    folder = tmp_path_factory.mktemp("honest") / "run"
    run = Run.create(denoising(noisy, settings, sphere), settings, folder=folder)
    records = record(run.resume(), run)
    for item in records:
        if item.step == 4:
            break
    records.close()  # type: ignore[attr-defined]
    run.keep(2)
    return folder


@pytest.fixture
def folder(honest: Path, tmp_path: Path) -> Path:
    """A copy of it to damage."""
    shutil.copytree(honest, tmp_path / "run")
    return tmp_path / "run"
