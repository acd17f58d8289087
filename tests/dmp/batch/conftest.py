"""Fixtures of the batch tests: tiny meshes as files, and two clusters of worker processes for all of them."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dmp.batch import cluster as clusters
from dmp.batch.asking import ask
from dmp.batch.cluster import local_client
from dmp.meshio import write_mesh
from tests.dmp.batch import works
from tests.meshes import sphere_mesh

LIGHT_MEMORY_LIMIT = 400 * 2**20


@pytest.fixture(scope="session")
def _trainers() -> Iterator[Any]:
    with local_client(2) as client:
        yield client


@pytest.fixture(scope="session")
def _light_workers() -> Iterator[Any]:
    with pytest.MonkeyPatch.context() as patch:
        as_ever = clusters.dask_config
        changes = {"distributed.worker.preload": [], "distributed.scheduler.allowed-failures": 1}
        patch.setattr(clusters, "dask_config", lambda ttl: {**as_ever(ttl), **changes})
        with local_client(2, memory_limit=LIGHT_MEMORY_LIMIT) as client:
            yield client


@pytest.fixture
def cluster(_trainers: Any) -> Any:
    """A client of two worker processes that tell ten times a second how far they are; what a test did to them is over."""
    return _ready(_trainers)


@pytest.fixture
def light_cluster(_light_workers: Any) -> Any:
    """Two workers that have loaded nothing, so that they start fast; they have little memory, and two losses are enough."""
    return _ready(_light_workers)


def _ready(client: Any) -> Any:
    deadline = time.monotonic() + 60
    while len(ask(client, works.tell_often, seconds=5)) < 2:
        assert time.monotonic() < deadline, "The workers do not come back."
        time.sleep(0.1)
    return client


@pytest.fixture
def halted() -> Iterator[list[int]]:
    """Numbers of processes that a test has halted; those that are still there are ended."""
    found: list[int] = []
    yield found
    for pid in found:
        with suppress(ProcessLookupError):
            works.send(pid, signal.SIGKILL)


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
