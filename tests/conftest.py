"""Fixtures for all tests: small meshes with known answers, and folders of their own for data and settings."""

from __future__ import annotations

import os
from pathlib import Path

# One thread: the meshes here are small, and results must not depend on the machine's cores.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("QT_API", "pyside6")
# Kernels that were compiled once are good for all tests and the processes that they start.
os.environ.setdefault("NUMBA_CACHE_DIR", str(Path(__file__).resolve().parents[1] / ".pytest_cache"))

import numpy as np
import pytest

from dmp.geometry import mean_edge_length
from dmp.mesh import TriangleMesh
from dmp.topology import unique_edges
from tests.meshes import sphere_mesh

SHARED_MESHES = Path(__file__).resolve().parents[2] / "shared" / "meshes"


@pytest.fixture(autouse=True)
def _own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep runs, settings and logs of the tests out of the user's folders."""
    for name in ("XDG_DATA_HOME", "XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))


@pytest.fixture(scope="session")
def shared_meshes() -> Path:
    """The folder with the meshes of the paper's experiments."""
    if not SHARED_MESHES.is_dir():
        pytest.skip("the meshes of the paper's experiments do not lie beside the project")
    return SHARED_MESHES


@pytest.fixture(scope="session")
def tetrahedron() -> TriangleMesh:
    """A regular tetrahedron with edge length 2 * sqrt(2), faces outward."""
    vertices = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    return TriangleMesh(vertices, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))


@pytest.fixture(scope="session")
def cube() -> TriangleMesh:
    """The unit cube [0, 1]^3 as 12 triangles, faces outward."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    faces = [triangle for a, b, c, d in quads for triangle in ([a, b, c], [a, c, d])]
    return TriangleMesh(corners, np.array(faces))


@pytest.fixture(scope="session")
def sphere() -> TriangleMesh:
    """A unit sphere with 258 vertices."""
    return sphere_mesh(3)


@pytest.fixture(scope="session")
def noisy_sphere(sphere: TriangleMesh) -> TriangleMesh:
    """The sphere with Gaussian noise of a fifth of its mean edge length."""
    noise = np.random.default_rng(5).standard_normal(sphere.vertices.shape)
    edge_length = mean_edge_length(sphere.vertices, unique_edges(sphere.faces))
    return sphere.with_vertices(sphere.vertices + 0.2 * edge_length * noise)
