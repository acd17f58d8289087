from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from dmp.errors import MeshError
from dmp.geometry import mean_edge_length
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh
from dmp.metrics import GroundTruth, align, mean_angular_difference, surface_measures
from dmp.topology import unique_edges
from tests.meshes import grid_mesh


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


def test_surface_distances_of_two_parallel_sheets_are_their_distance() -> None:
    low = grid_mesh(5)
    high = grid_mesh(9)
    high = high.with_vertices(high.vertices * [0.5, 0.5, 1] + [0, 0, 0.25])
    edge_length = mean_edge_length(low.vertices, unique_edges(low.faces))
    values = surface_measures(high, low)
    assert values.pop("hausdorff") == pytest.approx(0.25 / edge_length)
    assert set(values) == {f"surface_distance{back}{kind}" for back in ("", "_back") for kind in ("", "_rms", "_max")}
    assert list(values.values()) == pytest.approx([0.25 / edge_length] * 6)


def test_surface_distances_differ_by_direction_when_one_surface_is_a_part_of_the_other() -> None:
    whole = grid_mesh(9)
    inside = (whole.vertices[:, 0] <= 4).astype(bool)
    part = TriangleMesh(whole.vertices, whole.faces[inside[whole.faces].all(axis=1)])
    values = surface_measures(part, whole)
    edge_length = mean_edge_length(whole.vertices, unique_edges(whole.faces))
    assert values["surface_distance_max"] == pytest.approx(0, abs=1e-12)
    # The columns x = 5, 6, 7, 8 of 9 are 1 to 4 away from the part; the vertices that it no longer uses don't count.
    assert values["surface_distance_back_max"] == values["hausdorff"] == pytest.approx(4 / edge_length)
    assert values["surface_distance_back"] == pytest.approx(10 / 9 / edge_length)
    assert values["surface_distance_back_rms"] == pytest.approx(np.sqrt(30 / 9) / edge_length)


def test_full_measures_agree_with_trimesh_and_with_loops(sphere: TriangleMesh, noisy_sphere: TriangleMesh) -> None:
    truth = GroundTruth.for_input(sphere, noisy_sphere)
    values = truth.full_measures(noisy_sphere.vertices)
    found, true = (trimesh.Trimesh(mesh.vertices, mesh.faces, process=False) for mesh in (noisy_sphere, truth.mesh))
    edge_length = float(true.edges_unique_length.mean())

    cosines = [float(a @ b) for a, b in zip(found.face_normals, true.face_normals, strict=True)]
    angles = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    assert values["mad"] == pytest.approx(angles.mean())
    assert values["mad_area_weighted"] == pytest.approx(np.average(angles, weights=true.area_faces))

    moved = [float(np.sqrt(((a - b) ** 2).sum())) / edge_length for a, b in zip(found.vertices, true.vertices, strict=True)]
    assert values["vertex_error"] == pytest.approx(np.mean(moved))
    assert values["vertex_error_rms"] == pytest.approx(np.sqrt(np.mean(np.square(moved))))
    assert values["vertex_error_max"] == pytest.approx(max(moved))

    there, back = (
        np.linalg.norm(points - _nearest_of_all_triangles(other, points), axis=1) / edge_length
        for points, other in ((found.vertices, true), (true.vertices, found))
    )
    for name, distances in (("surface_distance", there), ("surface_distance_back", back)):
        assert values[name] == pytest.approx(distances.mean())
        assert values[f"{name}_rms"] == pytest.approx(np.sqrt((distances**2).mean()))
        assert values[f"{name}_max"] == pytest.approx(distances.max())
    assert values["hausdorff"] == pytest.approx(max(there.max(), back.max()))


def _nearest_of_all_triangles(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """The nearest point on the mesh, by comparing each of ``points`` with every triangle."""
    nearest = []
    for point in points:
        candidates = trimesh.triangles.closest_point(mesh.triangles, np.tile(point, (len(mesh.triangles), 1)))
        nearest.append(candidates[np.linalg.norm(candidates - point, axis=1).argmin()])
    return np.array(nearest)


def test_flipped_faces_are_those_more_than_90_degrees_off() -> None:
    sheet = grid_mesh(4)
    truth = GroundTruth.for_input(sheet, sheet)
    assert truth.full_measures(sheet.vertices)["flipped_faces"] == 0
    assert truth.full_measures(sheet.vertices * [-1, 1, 1])["flipped_faces"] == 1

    # Two triangles, one folded onto the other.
    pair = TriangleMesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    folded = pair.vertices.copy()
    folded[3] = [0.9, 0.1, 0]
    assert GroundTruth.for_input(pair, pair).full_measures(folded)["flipped_faces"] == 0.5


def test_a_face_without_area_is_not_flipped(tetrahedron: TriangleMesh) -> None:
    truth = GroundTruth.for_input(tetrahedron, tetrahedron)
    flat = tetrahedron.vertices.copy()
    flat[0] = flat[1]
    values = truth.full_measures(flat)
    assert values["flipped_faces"] == 0
    assert np.isfinite(list(values.values())).all()


def test_a_truth_without_any_length_is_refused() -> None:
    point = TriangleMesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(MeshError, match="no edge of any length"):
        GroundTruth.for_input(point, point)
    with pytest.raises(MeshError, match="no faces"):
        surface_measures(TriangleMesh(np.eye(3), np.zeros((0, 3))), TriangleMesh(np.eye(3), np.array([[0, 1, 2]])))


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
