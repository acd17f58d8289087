"""Fixtures of the batch tests: tiny meshes as files, and one cluster of worker processes for all of them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dmp.batch.cluster import local_client
from dmp.meshio import write_mesh
from tests.meshes import sphere_mesh


@pytest.fixture(scope="session")
def cluster() -> Iterator[Any]:
    """A client of two worker processes."""
    with local_client(2) as client:
        yield client


@pytest.fixture
def scans(tmp_path: Path) -> Path:
    """A folder with three noisy spheres of 66 vertices, and their clean versions in ``truth``."""
    return make_scans(tmp_path / "scans", 3)


def make_scans(folder: Path, count: int, subdivisions: int = 2) -> Path:
    (folder / "truth").mkdir(parents=True)
    ball = sphere_mesh(subdivisions)
    for number in range(count):
        noise = 0.04 * np.random.default_rng(number).standard_normal(ball.vertices.shape)
        write_mesh(folder / f"scan{number}.ply", ball.with_vertices(ball.vertices + noise))
        write_mesh(folder / "truth" / f"scan{number}.ply", ball)
    return folder
