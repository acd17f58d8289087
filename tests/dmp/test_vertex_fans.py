"""Normals and mean curvature against closed forms, a loop over the neighbours, and trimesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from dmp.geometry import face_normals, vertex_normals
from dmp.mesh import TriangleMesh
from dmp.vertex_fans import VertexFans
from tests.meshes import grid_mesh, sphere_mesh


def torus(large: float, small: float, n_around: int, n_across: int) -> tuple[TriangleMesh, np.ndarray]:
    """Return a torus with faces outward, and its mean curvature at the vertices."""
    around, across = np.meshgrid(
        2 * np.pi * np.arange(n_around) / n_around, 2 * np.pi * np.arange(n_across) / n_across, indexing="ij"
    )
    distance = large + small * np.cos(across)
    points = np.stack([distance * np.cos(around), distance * np.sin(around), small * np.sin(across)], axis=-1)
    index = np.arange(n_around * n_across).reshape(n_around, n_across)
    right, up, both = np.roll(index, -1, 0), np.roll(index, -1, 1), np.roll(index, (-1, -1), (0, 1))
    faces = np.vstack([np.c_[index.ravel(), right.ravel(), both.ravel()], np.c_[index.ravel(), both.ravel(), up.ravel()]])
    curvature = (large + 2 * small * np.cos(across)) / (2 * small * distance)
    return TriangleMesh(points.reshape(-1, 3), faces), curvature.ravel()


@pytest.mark.parametrize("radius", [1.0, 1e-3, 250.0])
def test_a_sphere_has_the_curvature_of_its_radius(radius: float) -> None:
    mesh = sphere_mesh(4)
    curvature = VertexFans(mesh.faces, mesh.n_vertices).mean_curvature(radius * mesh.vertices)
    assert curvature * radius == pytest.approx(np.ones(mesh.n_vertices), rel=0.02)


def test_a_sphere_seen_from_inside_is_hollow() -> None:
    mesh = sphere_mesh(3)
    fans = VertexFans(mesh.faces[:, ::-1], mesh.n_vertices)
    assert fans.mean_curvature(mesh.vertices) == pytest.approx(-np.ones(mesh.n_vertices), rel=0.05)


def test_a_torus_has_its_closed_form_and_gets_closer_with_finer_meshes() -> None:
    worst = []
    for size in (30, 60):
        mesh, expected = torus(3.0, 1.0, 2 * size, size)
        found = VertexFans(mesh.faces, mesh.n_vertices).mean_curvature(mesh.vertices)
        worst.append(np.abs(found - expected).max())
    assert worst[1] < 0.005
    assert worst[1] < worst[0] / 3


def test_a_plane_is_flat_and_its_rim_is_not_defined() -> None:
    mesh = grid_mesh(6)
    fans = VertexFans(mesh.faces, mesh.n_vertices)
    curvature = fans.mean_curvature(mesh.vertices)
    rim = (mesh.vertices[:, :2] % 5 == 0).any(axis=1)
    assert np.isnan(curvature[rim]).all()
    assert curvature[~rim] == pytest.approx(np.zeros((~rim).sum()), abs=1e-12)
    assert np.array_equal(fans.at_boundary, rim)


def test_curvature_is_that_of_a_loop_over_the_corners() -> None:
    """Cotangents and areas of Meyer et al., corner by corner, on a mesh with acute and obtuse faces."""
    mesh = grid_mesh(7, height=0.6, seed=3)
    fans = VertexFans(mesh.faces, mesh.n_vertices)
    gradient, area = np.zeros((mesh.n_vertices, 3)), np.zeros(mesh.n_vertices)
    for face in mesh.faces:
        points = mesh.vertices[face]
        sides = [points[(k + 2) % 3] - points[(k + 1) % 3] for k in range(3)]
        angles = [
            np.arccos(-(sides[(k + 1) % 3] @ sides[(k + 2) % 3]) / np.linalg.norm(sides[(k + 1) % 3])
                      / np.linalg.norm(sides[(k + 2) % 3])) for k in range(3)
        ]  # fmt: skip
        face_area = 0.5 * np.linalg.norm(np.cross(sides[0], sides[1]))
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            gradient[face[k]] += 0.5 * (
                (points[k] - points[a]) / np.tan(angles[b]) + (points[k] - points[b]) / np.tan(angles[a])
            )
            if max(angles) <= np.pi / 2:
                area[face[k]] += (sides[a] @ sides[a] / np.tan(angles[a]) + sides[b] @ sides[b] / np.tan(angles[b])) / 8
            else:
                area[face[k]] += face_area / (2 if angles[k] > np.pi / 2 else 4)
    expected = np.einsum("vc,vc->v", gradient, vertex_normals(mesh.vertices, mesh.faces)) / (2 * area)
    inner = ~fans.at_boundary
    assert fans.mean_curvature(mesh.vertices)[inner] == pytest.approx(expected[inner], rel=1e-9)


def test_the_areas_of_all_vertices_are_the_area_of_the_surface() -> None:
    mesh = sphere_mesh(3)
    fans = VertexFans(mesh.faces, mesh.n_vertices)
    total = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).area
    sides = fans._sides(mesh.vertices)
    doubled = np.linalg.norm(np.cross(sides[1].T, sides[2].T), axis=1)
    dots = [-(sides[(k + 1) % 3] * sides[(k + 2) % 3]).sum(axis=0) for k in range(3)]
    assert fans._mixed_areas(sides, dots, doubled, 1 / doubled).sum() == pytest.approx(total)


def test_faces_without_area_leave_no_number() -> None:
    mesh = sphere_mesh(1)
    collapsed = mesh.vertices.copy()
    collapsed[mesh.faces[0]] = collapsed[mesh.faces[0, 0]]
    curvature = VertexFans(mesh.faces, mesh.n_vertices).mean_curvature(collapsed)
    assert not np.isinf(curvature).any()
    nowhere = VertexFans(mesh.faces, mesh.n_vertices).mean_curvature(np.zeros_like(mesh.vertices))
    assert np.isnan(nowhere).all()


def test_normals_are_those_of_the_geometry() -> None:
    mesh = grid_mesh(9, height=0.4)
    fans = VertexFans(mesh.faces, mesh.n_vertices)
    assert np.allclose(fans.normals(mesh.vertices), vertex_normals(mesh.vertices, mesh.faces))
    assert np.allclose(fans.face_normals(mesh.vertices), face_normals(mesh.vertices, mesh.faces))


def test_means_are_over_the_faces_of_a_vertex(tetrahedron: TriangleMesh) -> None:
    values = np.array([1.0, 2.0, 3.0, 4.0])
    expected = [values[(tetrahedron.faces == vertex).any(axis=1)].mean() for vertex in range(4)]
    assert VertexFans(tetrahedron.faces, 4).means(values).tolist() == pytest.approx(expected)
    assert VertexFans(tetrahedron.faces, 5).means(values)[4] == 0
