from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dmp.errors import MeshError
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh
from dmp.metrics import GroundTruth, align, mean_angular_difference


def test_turning_a_triangle_by_an_angle_gives_that_angle() -> None:
    faces = np.array([[0, 1, 2]])
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    angle = np.radians(30)
    turned = flat @ np.array([[1, 0, 0], [0, np.cos(angle), np.sin(angle)], [0, -np.sin(angle), np.cos(angle)]])
    assert mean_angular_difference(turned, flat, faces) == pytest.approx(30)
    assert mean_angular_difference(flat[[0, 2, 1]], flat, faces) == pytest.approx(180)
    assert mean_angular_difference(flat, flat, faces) == pytest.approx(0, abs=1e-6)


def test_alignment_finds_scale_and_shift_exactly(sphere: TriangleMesh) -> None:
    found = align(sphere.vertices, 2.5 * sphere.vertices + [1, -2, 3])
    assert found.scale == pytest.approx(2.5)
    assert found.shift == pytest.approx([1, -2, 3])


def test_measures_do_not_depend_on_the_scale_and_place_of_the_truth(sphere: TriangleMesh, noisy_sphere: TriangleMesh) -> None:
    here = GroundTruth.for_input(sphere, noisy_sphere).measures(noisy_sphere.vertices)
    elsewhere = sphere.with_vertices(3.7 * sphere.vertices - [5, 6, 1000])
    there = GroundTruth.for_input(elsewhere, noisy_sphere).measures(noisy_sphere.vertices)
    assert there == pytest.approx(here, rel=1e-6)
    # Isotropic noise of 0.2 edges moves a vertex by 0.2 * sqrt(8 / pi) on average; the mesh is not quite uniform.
    assert here["vertex_error"] == pytest.approx(0.2 * np.sqrt(8 / np.pi), rel=0.1)


def test_a_truth_with_other_faces_is_refused(sphere: TriangleMesh, tetrahedron: TriangleMesh) -> None:
    with pytest.raises(MeshError, match="same faces"):
        GroundTruth.for_input(tetrahedron, sphere)


@pytest.mark.shared_meshes
@pytest.mark.parametrize(
    ("name", "mad", "error"),
    [("sharp", 24.81, 0.161), ("bumpy", 28.66, 0.311), ("sheep", 33.27, 0.372), ("dragon", 43.33, 0.480)],
)
def test_published_inputs_have_their_published_angles(shared_meshes: Path, name: str, mad: float, error: float) -> None:
    noisy = read_mesh(shared_meshes / name / "noisy.obj")
    truth = GroundTruth.for_input(read_mesh(shared_meshes / name / "ground_truth.obj"), noisy)
    assert truth.mad(noisy.vertices) == pytest.approx(mad, abs=0.006)
    assert truth.vertex_error(noisy.vertices) == pytest.approx(error, abs=0.001)
