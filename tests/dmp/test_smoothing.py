from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dmp.geometry import mean_edge_length
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh
from dmp.smoothing import laplacian_smoothing, smooth
from dmp.topology import unique_edges


def test_two_steps_against_a_loop_over_vertices(noisy_sphere: TriangleMesh) -> None:
    neighbours: dict[int, set[int]] = {v: set() for v in range(noisy_sphere.n_vertices)}
    for face in noisy_sphere.faces.tolist():
        for vertex in face:
            neighbours[vertex] |= set(face) - {vertex}
    positions = noisy_sphere.vertices
    for _ in range(2):
        positions = np.array(
            [
                (positions[v] + 2 * sum(positions[j] for j in neighbours[v])) / (1 + 2 * len(neighbours[v]))
                for v in range(len(positions))
            ]
        )
    assert laplacian_smoothing(noisy_sphere, 2) == pytest.approx(positions, abs=1e-13)


def test_a_vertex_without_neighbours_stays() -> None:
    mesh = TriangleMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 6, 7]]), np.array([[0, 1, 2]]))
    assert laplacian_smoothing(mesh, 3)[3] == pytest.approx([5, 6, 7])


def test_a_mesh_far_from_the_origin_is_smoothed_alike(noisy_sphere: TriangleMesh) -> None:
    far = noisy_sphere.with_vertices(noisy_sphere.vertices + 1e7)
    assert laplacian_smoothing(far) - 1e7 == pytest.approx(laplacian_smoothing(noisy_sphere), abs=1e-8)


def test_no_smoothing_returns_the_input(noisy_sphere: TriangleMesh) -> None:
    assert np.array_equal(smooth(noisy_sphere, "none", 30), noisy_sphere.vertices)


@pytest.mark.shared_meshes
@pytest.mark.parametrize("name", ["sharp", "bumpy", "sheep", "dragon"])
def test_published_base_meshes_are_reproduced(shared_meshes: Path, name: str) -> None:
    noisy = read_mesh(shared_meshes / name / "noisy.obj")
    published = read_mesh(shared_meshes / name / "smoothed.obj")
    edge_length = mean_edge_length(noisy.vertices, unique_edges(noisy.faces))
    distance = np.linalg.norm(laplacian_smoothing(noisy) - published.vertices, axis=1).mean()
    assert distance / edge_length < 1e-4
