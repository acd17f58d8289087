from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmp.layers import pseudo_coordinates
from dmp.layers.pseudo_coordinates import shape_coordinates, valence_coordinates
from dmp.mesh import TriangleMesh
from dmp.smoothing import laplacian_smoothing
from dmp.topology import adjacency
from tests.meshes import grid_mesh


@pytest.fixture
def bumpy(noisy_sphere: TriangleMesh) -> TriangleMesh:
    """An uneven shape with defined curvature directions."""
    stretched = noisy_sphere.with_vertices(noisy_sphere.vertices * [1.0, 1.4, 2.0])
    return stretched.with_vertices(laplacian_smoothing(stretched, 3))


def _edges(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    """Both ends of the directed edges i <- j: i, then j."""
    matrix = adjacency(mesh.faces, mesh.n_vertices)
    return np.repeat(np.arange(mesh.n_vertices), np.diff(matrix.indptr)), matrix.indices


def test_valence_coordinates_are_the_roots_of_both_valences(cube: TriangleMesh) -> None:
    to, source = _edges(cube)
    valences = np.bincount(to)
    expected = [(valences[j] ** -0.5, valences[i] ** -0.5) for i, j in zip(to, source, strict=True)]
    assert valence_coordinates(cube.faces, cube.n_vertices) == pytest.approx(np.array(expected))


def test_valence_coordinates_do_not_see_the_shape_and_shape_coordinates_do(bumpy: TriangleMesh) -> None:
    other = bumpy.vertices * [2.0, 1.0, 1.0]
    assert np.abs(shape_coordinates(bumpy.vertices, bumpy.faces) - shape_coordinates(other, bumpy.faces)).max() > 0.5
    # The other function is not even given the positions: the same for each edge between vertices of valence 6.
    inner = valence_coordinates(grid_mesh(8).faces, 64)
    assert len(np.unique(inner.round(12), axis=0)) < 20


@pytest.mark.parametrize("seed", range(3))
def test_shape_coordinates_do_not_change_when_the_mesh_is_turned_moved_or_scaled(bumpy: TriangleMesh, seed: int) -> None:
    turn = Rotation.random(random_state=seed).as_matrix()
    moved = 3.7 * bumpy.vertices @ turn.T + [10.0, -20.0, 5.0]
    assert shape_coordinates(moved, bumpy.faces) == pytest.approx(shape_coordinates(bumpy.vertices, bumpy.faces), abs=1e-6)


def test_a_mirror_image_changes_the_sign_of_the_last_one_alone(bumpy: TriangleMesh) -> None:
    # Faces turned round as well, so that they still look outwards.
    mirrored = shape_coordinates(bumpy.vertices * [-1, 1, 1], bumpy.faces[:, ::-1])
    assert mirrored == pytest.approx(shape_coordinates(bumpy.vertices, bumpy.faces) * [1, 1, 1, 1, -1], abs=1e-6)


def test_shape_coordinates_of_a_cylinder_follow_its_curvature(monkeypatch: pytest.MonkeyPatch) -> None:
    """The large curvature of a cylinder runs round it: edges along the axis and round it are opposite."""
    n, m = 24, 16
    angles, heights = np.meshgrid(2 * np.pi * np.arange(n) / n, np.arange(m) * 2 * np.pi / n)
    vertices = np.column_stack([np.cos(angles).ravel(), np.sin(angles).ravel(), heights.ravel()])
    a = np.arange(n * (m - 1))
    right, up, across = a // n * n + (a + 1) % n, a + n, a // n * n + (a + 1) % n + n
    mesh = TriangleMesh(vertices, np.concatenate([np.c_[a, right, across], np.c_[a, across, up]]))
    monkeypatch.setattr(pseudo_coordinates, "_standardised", lambda values: values)
    found = shape_coordinates(mesh.vertices, mesh.faces)
    to, source = _edges(mesh)
    inside = (to // n > 1) & (to // n < m - 2)
    around, along = inside & (to // n == source // n), inside & (to % n == source % n)
    # Straight round and straight along, where only one of the principal curvatures is not 0.
    assert found[around, 3] == pytest.approx(1.0, abs=0.02)
    assert found[along, 3] == pytest.approx(-1.0, abs=0.02)
    assert np.abs(found[around | along, 4]).max() < 0.02
    assert np.abs(found[inside & ~around & ~along, 4]).min() > 0.9
    assert np.abs(found[along, 1:3]).max() < 1e-9
    # Round the cylinder a chord falls by half the angle that the normal turns.
    assert found[around, 1] == pytest.approx(-np.pi / n, abs=1e-9)
    assert found[around, 2] == pytest.approx(2 * np.pi / n, abs=1e-9)


def test_shape_coordinates_are_scaled_alike_and_finite_on_anything(bumpy: TriangleMesh, tetrahedron: TriangleMesh) -> None:
    found = shape_coordinates(bumpy.vertices, bumpy.faces)
    assert found.mean(axis=0) == pytest.approx(0.0, abs=0.1)
    assert found.std(axis=0) == pytest.approx(1.0, abs=0.2)
    assert np.abs(found).max() <= 3.0
    flat = grid_mesh(5)
    double = TriangleMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [1, 2, 3]]))
    for mesh in (tetrahedron, flat, double):
        assert np.isfinite(shape_coordinates(mesh.vertices, mesh.faces)).all()
    # On a regular tetrahedron all edges are alike; rounding must not tell them apart.
    assert np.abs(shape_coordinates(tetrahedron.vertices, tetrahedron.faces)).max() == 0.0
