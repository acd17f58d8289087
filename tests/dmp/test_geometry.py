from __future__ import annotations

import numpy as np
import pytest

from dmp.geometry import face_areas, face_normals, mean_edge_length, vertex_normals
from dmp.mesh import TriangleMesh
from dmp.topology import unique_edges


def test_areas_and_normals_of_one_triangle() -> None:
    vertices = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])
    faces = np.array([[0, 1, 2]])
    assert face_areas(vertices, faces) == pytest.approx([6.0])
    assert face_normals(vertices, faces) == pytest.approx(np.array([[0, 0, 1.0]]))


def test_a_face_without_area_has_normal_zero_and_no_warning() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    assert (face_normals(vertices, np.array([[0, 1, 2]])) == 0).all()


def test_cube_has_area_six_and_outward_normals(cube: TriangleMesh) -> None:
    assert face_areas(cube.vertices, cube.faces).sum() == pytest.approx(6.0)
    centres = cube.vertices[cube.faces].mean(axis=1) - 0.5
    assert (np.einsum("fc,fc->f", centres, face_normals(cube.vertices, cube.faces)) > 0).all()


def test_vertex_normals_of_a_sphere_point_outward(sphere: TriangleMesh) -> None:
    normals = vertex_normals(sphere.vertices, sphere.faces)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(sphere.n_vertices))
    assert np.einsum("vc,vc->v", normals, sphere.vertices).min() > 0.995


def test_mean_edge_length_of_a_tetrahedron(tetrahedron: TriangleMesh) -> None:
    assert mean_edge_length(tetrahedron.vertices, unique_edges(tetrahedron.faces)) == pytest.approx(2 * np.sqrt(2))
