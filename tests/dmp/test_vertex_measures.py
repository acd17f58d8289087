"""Distances between two states of a mesh, vertex by vertex, and robust extents."""

from __future__ import annotations

import numpy as np
import pytest

from dmp.geometry import face_normals
from dmp.mesh import TriangleMesh
from dmp.metrics import mean_angular_difference
from dmp.vertex_fans import VertexFans
from dmp.vertex_measures import distances, extent, normal_angles, signed_distances
from tests.meshes import grid_mesh

BASE = np.zeros((3, 3))
NORMALS = np.array([[0, 0, 1.0], [0, 0, 1], [1, 0, 0]])
MOVED = np.array([[3, 4, 0.0], [0, 0, -2], [0.5, 1, 0]])


def test_distances_are_lengths_of_the_way() -> None:
    assert distances(MOVED, BASE).tolist() == pytest.approx([5, 2, 1.25**0.5])


def test_signed_distances_are_the_part_along_the_normal() -> None:
    assert signed_distances(MOVED, BASE, NORMALS).tolist() == pytest.approx([0, -2, 0.5])


def test_a_tilted_sheet_leans_by_its_angle_everywhere() -> None:
    mesh = grid_mesh(5)
    angle = np.radians(25)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    fans = VertexFans(mesh.faces, mesh.n_vertices)
    assert normal_angles(mesh.vertices @ turn.T, face_normals(mesh.vertices, mesh.faces), fans) == pytest.approx(
        np.full(25, 25.0)
    )


def test_angles_at_the_corners_of_all_faces_average_to_the_mad(sphere: TriangleMesh, noisy_sphere: TriangleMesh) -> None:
    fans = VertexFans(sphere.faces, sphere.n_vertices)
    angles = normal_angles(noisy_sphere.vertices, face_normals(sphere.vertices, sphere.faces), fans)
    counts = np.bincount(sphere.faces.ravel())
    mad = mean_angular_difference(noisy_sphere.vertices, sphere.vertices, sphere.faces)
    assert np.average(angles, weights=counts) == pytest.approx(mad)


def test_a_few_far_values_do_not_take_the_extent() -> None:
    values = np.r_[np.ones(990), np.full(10, 1000.0)]
    assert extent(values) == extent(-values) == 1.0
    assert extent(values, 100.0) == 1000.0


def test_what_is_no_number_does_not_count() -> None:
    assert extent(np.array([np.nan, 2.0, -3.0, np.inf]), 100.0) == 3.0
    assert extent(np.array([np.nan])) == 0.0
