from __future__ import annotations

import numpy as np

from dmp.mesh import TriangleMesh
from dmp.topology import (
    adjacency,
    connected_vertices,
    edge_face_counts,
    n_components,
    proper_faces,
    topology_report,
    unique_edges,
)
from tests.meshes import grid_mesh


def test_edges_against_a_loop_over_faces(sphere: TriangleMesh) -> None:
    expected = {tuple(sorted((int(a), int(b)))) for face in sphere.faces for a, b in zip(face, np.roll(face, -1), strict=True)}
    edges = unique_edges(sphere.faces)
    assert [tuple(edge) for edge in edges.tolist()] == sorted(expected)


def test_adjacency_is_symmetric_and_counts_neighbours_once(sphere: TriangleMesh) -> None:
    matrix = adjacency(sphere.faces, sphere.n_vertices)
    assert (matrix != matrix.T).nnz == 0
    assert set(matrix.data) == {1.0}
    neighbours = {v: set() for v in range(sphere.n_vertices)}
    for a, b, c in sphere.faces.tolist():
        for u, v in ((a, b), (b, c), (c, a)):
            neighbours[u].add(v)
            neighbours[v].add(u)
    assert matrix.sum(axis=1).tolist() == [len(neighbours[v]) for v in range(sphere.n_vertices)]


def test_a_face_with_a_repeated_vertex_gives_no_self_loop() -> None:
    assert adjacency(np.array([[0, 0, 1]]), 2).diagonal().tolist() == [0, 0]


def test_report_of_closed_open_and_non_manifold_meshes(cube: TriangleMesh) -> None:
    report = topology_report(cube)
    assert (report.edges, report.euler_characteristic, report.is_closed, report.components) == (18, 2, True, 1)
    sheet = topology_report(grid_mesh(4))
    assert (sheet.boundary_edges, sheet.euler_characteristic, sheet.is_closed) == (12, 1, False)
    fan = TriangleMesh(
        np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0], [9, 9, 9]]),
        np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]),
    )
    report = topology_report(fan)
    assert (report.non_manifold_edges, report.boundary_edges, report.unreferenced_vertices, report.components) == (1, 6, 1, 1)


def test_collapsed_faces_are_counted_and_join_nothing(tetrahedron: TriangleMesh) -> None:
    faces = np.vstack([tetrahedron.faces, [[0, 0, 1], [2, 2, 2], [4, 4, 0]]])
    mesh = TriangleMesh(np.vstack([tetrahedron.vertices, [[5.0, 5, 5]]]), faces)
    report = topology_report(mesh)
    assert (report.collapsed_faces, report.faces, report.edges, report.is_closed) == (3, 7, 6, True)
    assert (report.unreferenced_vertices, report.components, report.euler_characteristic) == (1, 1, 2)
    assert proper_faces(faces).tolist() == tetrahedron.faces.tolist()
    assert proper_faces(tetrahedron.faces) is tetrahedron.faces
    assert connected_vertices(faces, 5).tolist() == [True] * 4 + [False]
    assert adjacency(faces, 5).sum() == 12


def test_two_pieces_are_two_components(tetrahedron: TriangleMesh) -> None:
    faces = np.vstack([tetrahedron.faces, tetrahedron.faces + 4])
    assert n_components(faces, 8) == 2
    assert edge_face_counts(faces)[1].tolist() == [2] * 12
