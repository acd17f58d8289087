from __future__ import annotations

import numpy as np
import pytest

from dmp.geometry import face_normals
from dmp.mesh import TriangleMesh
from dmp.recorrupted.face_graph import FaceGraph, face_graph
from tests.meshes import grid_mesh, sphere_mesh


def _graph(mesh: TriangleMesh) -> FaceGraph:
    return face_graph(mesh.faces, face_normals(mesh.vertices, mesh.faces))


def _edges(face: np.ndarray) -> set[frozenset[int]]:
    return {frozenset((int(face[k]), int(face[(k + 1) % 3]))) for k in range(3)}


@pytest.mark.parametrize("mesh", [sphere_mesh(1), grid_mesh(4)], ids=["closed", "boundary"])
def test_neighbours_share_an_edge_and_lead_back(mesh: TriangleMesh) -> None:
    graph = _graph(mesh)
    n_faces = mesh.n_faces
    for slot in range(3):
        for face in range(n_faces):
            other, back = graph.neighbours[slot, face], graph.back[slot, face]
            if graph.signs[slot, face] == 0:
                assert (other, back) == (face, slot * n_faces + face)
                continue
            assert len(_edges(mesh.faces[face]) & _edges(mesh.faces[other])) == 1
            assert back % n_faces == other
            assert graph.back.reshape(-1)[back] == slot * n_faces + face


def test_empty_slots_are_the_boundary_edges() -> None:
    assert np.count_nonzero(_graph(sphere_mesh(1)).signs == 0) == 0
    assert np.count_nonzero(_graph(grid_mesh(5)).signs == 0) == 4 * 4


def test_a_face_turned_over_is_joined_with_the_opposite_sign(tetrahedron: TriangleMesh) -> None:
    faces = tetrahedron.faces.copy()
    faces[2] = faces[2, ::-1]
    graph = _graph(TriangleMesh(tetrahedron.vertices, faces))
    assert (graph.signs[:, 2] == -1).all()
    assert sorted(graph.signs[:, 0]) == [-1, 1, 1]


def test_sheets_that_cross_in_an_edge_are_joined_straight_on() -> None:
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype=float)
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5]])
    graph = _graph(TriangleMesh(vertices, faces))
    assert list(graph.neighbours[0]) == [1, 0, 3, 2]
    assert (graph.signs[0] == 1).all()


def test_between_faces_at_the_same_place_their_order_decides_and_not_the_last_digit() -> None:
    ball = sphere_mesh(1)
    faces = np.vstack([ball.faces, ball.faces[:5], ball.faces[5:8, ::-1]])
    normals = face_normals(ball.vertices, faces)
    expected = face_graph(faces, normals)
    for seed in range(20):
        rounding = 1e-15 * np.random.default_rng(seed).standard_normal(normals.shape)
        assert np.array_equal(face_graph(faces, normals + rounding).neighbours, expected.neighbours)


def test_an_odd_face_at_an_edge_stays_alone() -> None:
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0.1, 0], [0, 1, 0]], dtype=float)
    graph = _graph(TriangleMesh(vertices, np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])))
    assert list(graph.neighbours[0]) == [1, 0, 2]
    assert list(graph.signs[0]) == [1, 1, 0]
