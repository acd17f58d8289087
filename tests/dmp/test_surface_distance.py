"""Distances from points to a surface, against closed forms and against comparing everything with everything."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from dmp.errors import MeshError
from dmp.mesh import FloatArray, TriangleMesh
from dmp.surface_distance import distance_to_surface, nearest_on_surface
from tests.meshes import grid_mesh, sphere_mesh


def by_brute_force(points: FloatArray, mesh: TriangleMesh) -> FloatArray:
    """Distances of all pairs by another implementation of the distance to a triangle."""
    triangles = mesh.vertices[mesh.faces]
    nearest = [trimesh.triangles.closest_point(triangles, np.tile(point, (len(triangles), 1))) for point in points]
    return np.array([np.linalg.norm(foot - point, axis=1).min() for foot, point in zip(nearest, points, strict=True)])


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((0.5, 0.25, 3), 3.0),  # above the inside
        ((0.5, 0.25, -2), 2.0),  # below it
        ((1, -4, 3), 5.0),  # beyond a side
        ((-3, -4, 0), 5.0),  # beyond a corner
        ((2, 2, 0), np.sqrt(2)),  # beyond the slanted side
        ((0.25, 0.25, 0), 0.0),
    ],
)
def test_one_triangle(point: tuple[float, float, float], expected: float) -> None:
    triangle = TriangleMesh(np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0]]), np.array([[0, 1, 2]]))
    assert distance_to_surface([point], triangle)[0] == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("spread", [0.02, 1.0, 50.0])
def test_against_all_pairs(spread: float) -> None:
    sphere = sphere_mesh(3)
    random = np.random.default_rng(3)
    rough = sphere.with_vertices(sphere.vertices * random.uniform(0.5, 1.5, (sphere.n_vertices, 1)))
    points = rough.vertices[:40] + spread * random.standard_normal((40, 3))
    np.testing.assert_allclose(distance_to_surface(points, rough), by_brute_force(points, rough), rtol=1e-9, atol=1e-12)


def test_triangles_of_very_different_sizes() -> None:
    random = np.random.default_rng(4)
    sizes = 10.0 ** random.uniform(-4, 1, (400, 1, 1))
    corners = random.uniform(-3, 3, (400, 1, 3)) + sizes * random.standard_normal((400, 3, 3))
    soup = TriangleMesh(corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3))
    points = random.uniform(-4, 4, (60, 3))
    np.testing.assert_allclose(distance_to_surface(points, soup), by_brute_force(points, soup), rtol=1e-9)


def test_many_points_with_the_whole_surface_equally_far() -> None:
    sphere = sphere_mesh(4)
    points = 1e-3 * np.random.default_rng(0).standard_normal((700, 3))
    distance = distance_to_surface(points, sphere)
    assert distance.max() <= 1
    assert distance.min() > 0.98
    np.testing.assert_allclose(distance[:20], by_brute_force(points[:20], sphere), rtol=1e-12)


def test_the_face_is_the_one_measured_to() -> None:
    sphere = sphere_mesh(3)
    centers = sphere.vertices[sphere.faces].mean(axis=1)
    distance, face = nearest_on_surface(1.05 * centers, sphere)
    np.testing.assert_array_equal(face, np.arange(sphere.n_faces))
    np.testing.assert_allclose(distance, 0.05 * np.linalg.norm(centers, axis=1), rtol=0.02)


def test_of_equally_near_faces_the_first_is_named() -> None:
    sheet = grid_mesh(4)
    _, face = nearest_on_surface([[1, 1, 2.0]], sheet)
    assert face[0] == np.flatnonzero((sheet.faces == 5).any(axis=1)).min()


def test_faces_without_area_are_segments_and_points() -> None:
    flat = TriangleMesh(np.array([[0, 0, 0], [4, 0, 0], [1, 0, 0], [0, 9, 0]]), np.array([[0, 1, 2], [3, 3, 3]]))
    distance, face = nearest_on_surface([[2, 2, 0], [0, 8, 1], [-3, 4, 0]], flat)
    np.testing.assert_allclose(distance, [2, np.sqrt(2), 5])
    assert face.tolist()[:2] == [0, 1]


def test_far_from_the_origin_nothing_is_lost() -> None:
    sphere = sphere_mesh(2)
    points = 1.3 * sphere.vertices[:50]
    away = np.array([1e7, -2e7, 5e6])
    moved = distance_to_surface(points + away, sphere.with_vertices(sphere.vertices + away))
    np.testing.assert_allclose(moved, distance_to_surface(points, sphere), atol=1e-7)


def test_no_points_give_no_distances() -> None:
    distance, face = nearest_on_surface(np.empty((0, 3)), sphere_mesh(1))
    assert distance.shape == face.shape == (0,)


@pytest.mark.parametrize("points", [np.zeros(3), np.zeros((4, 2)), [[np.nan, 0, 0]]])
def test_points_that_are_none_are_refused(points: object) -> None:
    with pytest.raises(MeshError, match="finite numbers in an array of shape"):
        distance_to_surface(points, sphere_mesh(1))  # type: ignore[arg-type]


def test_a_mesh_without_faces_is_refused() -> None:
    with pytest.raises(MeshError, match="no faces"):
        distance_to_surface(np.zeros((1, 3)), TriangleMesh(np.zeros((3, 3)), np.empty((0, 3), dtype=np.int64)))
