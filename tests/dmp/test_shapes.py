from __future__ import annotations

import numpy as np
import pytest

from dmp.errors import MeshError, SettingsError
from dmp.geometry import face_area_vectors, face_areas, face_normals
from dmp.mesh import FloatArray, TriangleMesh
from dmp.shapes import mechanical, organic, solids
from dmp.shapes.alterations import (
    cut_open,
    placed,
    sharp_edges,
    shuffled_along_surface,
    together,
    with_holes,
    with_slivers,
    without_vertices,
)
from dmp.shapes.development import DEVELOPMENT_SHAPES, development_set
from dmp.shapes.separation import is_closed_surface
from dmp.shapes.sharp_curves import find_sharp_curves
from dmp.shapes.sheets import wavy_sheet
from dmp.shapes.solids import Solid
from dmp.shapes.spheres import bumpy_sphere, icosphere
from dmp.shapes.surface_mesh import mesh_solid
from dmp.shapes.surface_sampling import grid_crossings, project, surface_area
from dmp.topology import topology_report, unique_edges


def volume(mesh: TriangleMesh) -> float:
    """Signed volume by the divergence theorem: positive where the faces look outwards."""
    return float((face_area_vectors(mesh.vertices, mesh.faces) * mesh.vertices[mesh.faces].mean(axis=1)).sum() / 6)


def smallest_angles(mesh: TriangleMesh) -> FloatArray:
    """Smallest angle of each face in degrees."""
    corners = mesh.vertices[mesh.faces]
    sides = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(sides, axis=2)
    cosines = -(sides * np.roll(sides, 1, axis=1)).sum(axis=2) / (lengths * np.roll(lengths, 1, axis=1))
    return np.degrees(np.arccos(np.clip(cosines, -1, 1))).min(axis=1)


def edge_lengths(mesh: TriangleMesh) -> FloatArray:
    first, second = unique_edges(mesh.faces).T
    return np.linalg.norm(mesh.vertices[first] - mesh.vertices[second], axis=1)


def fold_angles(mesh: TriangleMesh) -> dict[tuple[int, int], float]:
    """Angle in degrees between the normals at each inner edge, by a plain loop."""
    normals = face_normals(mesh.vertices, mesh.faces)
    at_edge: dict[tuple[int, int], list[int]] = {}
    for index, face in enumerate(mesh.faces.tolist()):
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            at_edge.setdefault((min(a, b), max(a, b)), []).append(index)
    pairs = {edge: owners for edge, owners in at_edge.items() if len(owners) == 2}
    return {edge: float(np.degrees(np.arccos(np.clip(normals[i] @ normals[j], -1, 1)))) for edge, (i, j) in pairs.items()}


def each_edge_runs_both_ways(mesh: TriangleMesh) -> bool:
    """Whether neighbouring faces agree about which side is outside."""
    half_edges = {(a, b) for face in mesh.faces.tolist() for a, b in zip(face, face[1:] + face[:1], strict=True)}
    return len(half_edges) == 3 * mesh.n_faces and all((b, a) in half_edges for a, b in half_edges)


@pytest.fixture(scope="module")
def cube_mesh() -> TriangleMesh:
    return mesh_solid(mechanical.cube(), 800)


@pytest.mark.parametrize("frequency", [1, 2, 5, 8])
def test_the_geodesic_sphere_has_the_counts_of_its_formula(frequency: int) -> None:
    mesh = icosphere(frequency)
    report = topology_report(mesh)
    assert (mesh.n_vertices, mesh.n_faces) == (10 * frequency**2 + 2, 20 * frequency**2)
    assert report.is_closed
    assert report.euler_characteristic == 2
    assert each_edge_runs_both_ways(mesh)
    assert np.count_nonzero(np.bincount(unique_edges(mesh.faces).ravel()) == 5) == 12
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1.0, atol=1e-15)


def test_the_geodesic_sphere_converges_to_the_ball() -> None:
    defects = [4 / 3 * np.pi - volume(icosphere(frequency)) for frequency in (6, 12)]
    assert 0 < defects[1] < defects[0]
    assert defects[0] / defects[1] == pytest.approx(4, rel=0.05)


def test_the_bumpy_sphere_has_equal_bumps_between_its_two_radii() -> None:
    mesh = bumpy_sphere(12, 2, height=0.2, width=0.25)
    radii = np.linalg.norm(mesh.vertices, axis=1)
    centres = icosphere(2).vertices
    angles = np.arccos(np.clip((mesh.vertices / radii[:, None] @ centres.T).max(axis=1), -1, 1))
    np.testing.assert_allclose(radii, 1 + 0.2 * np.maximum(0, 1 - (angles / 0.25) ** 2) ** 2, atol=1e-9)
    assert radii.max() > 1.17
    assert topology_report(mesh).euler_characteristic == 2
    assert volume(mesh) > 0
    assert smallest_angles(mesh).min() > 25


@pytest.mark.parametrize(
    ("solid", "area", "content", "euler"),
    [
        (solids.ball((0.1, 0, 0), 0.9), 4 * np.pi * 0.81, 4 / 3 * np.pi * 0.729, 2),
        (solids.torus((0, 0, 0), 1, 0.7, 0.3), 4 * np.pi**2 * 0.21, 2 * np.pi**2 * 0.7 * 0.09, 0),
        (mechanical.cube(), 6 * 1.6**2, 1.6**3, 2),
        (
            solids.box((-0.8, -0.8, -0.4), (0.8, 0.8, 0.4)) - solids.cylinder((0, 0, 0), 2, 0.5),
            2 * 1.6**2 + 4 * 1.6 * 0.8 - 2 * np.pi * 0.25 + 2 * np.pi * 0.5 * 0.8,
            0.8 * (1.6**2 - np.pi * 0.25),
            0,
        ),
        (mechanical.stairs(4), 2 * 1.2 * 3.0 + 2 * 1.6 * 1.4 * 10 / 16, 1.2 * 1.6 * 1.4 * 10 / 16, 2),
    ],
    ids=["ball", "torus", "cube", "bored block", "stairs"],
)
def test_meshes_of_solids_have_the_area_and_volume_of_the_solid(solid: Solid, area: float, content: float, euler: int) -> None:
    mesh = mesh_solid(solid, 900, relaxation_steps=25)
    report = topology_report(mesh)
    assert is_closed_surface(mesh.faces, mesh.n_vertices)
    assert each_edge_runs_both_ways(mesh)
    assert report.components == 1
    assert report.euler_characteristic == euler
    assert mesh.n_vertices == pytest.approx(900, rel=0.15)
    assert face_areas(mesh.vertices, mesh.faces).sum() == pytest.approx(area, rel=0.02)
    assert volume(mesh) == pytest.approx(content, rel=0.02)
    assert np.abs(solid.value(mesh.vertices)).max() < 1e-9


@pytest.mark.parametrize(
    "solid", [solids.ball((0, 0, 0), 0.9), mechanical.prism(6), organic.jug()], ids=["ball", "prism", "jug"]
)
def test_relaxed_triangles_are_even(solid: Solid) -> None:
    mesh = mesh_solid(solid, 1200)
    lengths = edge_lengths(mesh)
    assert smallest_angles(mesh).min() > 18
    assert np.percentile(smallest_angles(mesh), 1) > 30
    assert lengths.std() / lengths.mean() < 0.17
    assert topology_report(mesh).valence_mean == pytest.approx(6, abs=0.02)
    ragged = mesh_solid(solid, 1200, relaxation_steps=0)
    assert edge_lengths(ragged).std() / edge_lengths(ragged).mean() > 1.3 * lengths.std() / lengths.mean()


def test_a_mesh_of_a_solid_is_made_the_same_each_time(cube_mesh: TriangleMesh) -> None:
    again = mesh_solid(mechanical.cube(), 800)
    assert np.array_equal(again.vertices, cube_mesh.vertices)
    assert np.array_equal(again.faces, cube_mesh.faces)
    assert not np.array_equal(mesh_solid(mechanical.cube(), 800, seed=1).vertices, again.vertices)


def test_the_cube_is_folded_by_90_degrees_along_its_edges_and_flat_elsewhere(cube_mesh: TriangleMesh) -> None:
    angles = fold_angles(cube_mesh)
    folded = [edge for edge, angle in angles.items() if angle > 1]
    np.testing.assert_allclose([angles[edge] for edge in folded], 90, atol=1e-6)
    first, second = cube_mesh.vertices[np.array(folded)].transpose(1, 0, 2)
    assert np.linalg.norm(first - second, axis=1).sum() == pytest.approx(12 * 1.6, rel=1e-9)
    assert (np.isclose(np.abs(cube_mesh.vertices), 0.8, atol=1e-9).sum(axis=1) == 3).sum() == 8


def test_sharp_edges_of_a_bored_block_are_lines_and_circles() -> None:
    block = solids.box((-0.8, -0.8, -0.4), (0.8, 0.8, 0.4)) - solids.cylinder((0.1, 0, 0), 2, 0.5)
    curves = find_sharp_curves(block, project(block, grid_crossings(block, 1.0, 0.05)), 0.04)
    loops = [curve for curve in curves if curve.is_loop]
    assert (len(curves), len(loops)) == (14, 2)
    for loop in loops:
        divided = loop.divided(0.05)
        np.testing.assert_allclose(np.hypot(divided[:, 0] - 0.1, divided[:, 1]), 0.5, atol=1e-12)
        np.testing.assert_allclose(np.abs(divided[:, 2]), 0.4, atol=1e-12)
        steps = np.linalg.norm(divided - np.roll(divided, -1, axis=0), axis=1)
        assert steps.max() / steps.min() < 1.02
    straight = sorted(round(curve.length(), 9) for curve in curves if not curve.is_loop)
    assert straight == [0.8] * 4 + [1.6] * 8


def test_the_edge_between_a_plane_and_a_tangent_cylinder_is_not_sharp() -> None:
    rounded = solids.half_space((0, 0, 1), 0.5) & solids.cylinder((0, 0, 0), 1, 0.5)
    assert find_sharp_curves(rounded, project(rounded, grid_crossings(rounded, 0.8, 0.05)), 0.05) == []


def test_the_area_is_estimated_from_grid_crossings() -> None:
    ball = solids.ball((0, 0, 0), 0.8)
    assert surface_area(ball, grid_crossings(ball, 1.0, 0.03), 0.03) == pytest.approx(4 * np.pi * 0.64, rel=0.01)


def test_blending_is_exact_away_from_the_seam_and_rounds_it() -> None:
    parts = [solids.half_space((1, 0, 0), 0.0), solids.half_space((0, 1, 0), 0.0)]
    blended = solids.blend(parts, 0.3)
    points = np.array([[0.5, 0.1, 0], [0.0, 0.6, 0], [0.2, 0.2, 0]])
    # min - w / 6 on the seam itself.
    np.testing.assert_allclose(blended.value(points), [0.1, 0.0, 0.2 - 0.05], atol=1e-12)


def test_a_turned_solid_is_the_solid_at_turned_points() -> None:
    egg = solids.ellipsoid((0.5, 0, 0), (0.5, 0.2, 0.2))
    upright = solids.turned(egg, (0, 0, 0), 2, np.pi / 2)
    np.testing.assert_allclose(upright.value(np.array([[0.0, 1.0, 0], [0, 0.5, 0.2], [0.2, 0.5, 0]])), 0, atol=1e-12)


def test_a_shape_too_fine_for_its_mesh_is_refused_in_words() -> None:
    sieve = mechanical.cube() - solids.union([solids.cylinder((x, 0, 0), 2, 0.05) for x in np.linspace(-0.6, 0.6, 9)])
    with pytest.raises(MeshError, match="too fine"):
        mesh_solid(sieve, 150, relaxation_steps=2)


def test_removed_vertices_take_their_faces_and_lonely_neighbours_along(cube: TriangleMesh) -> None:
    marked = cube.with_attributes(number=np.arange(8))
    smaller = without_vertices(marked, np.arange(8) == 7)
    assert not (smaller.vertices == [1, 1, 1]).all(axis=1).any()
    assert smaller.vertex_attributes["number"].tolist() == list(range(7))
    assert np.array_equal(cube.vertices[smaller.vertex_attributes["number"]], smaller.vertices)
    assert topology_report(smaller).unreferenced_vertices == 0
    with pytest.raises(MeshError, match="No face"):
        without_vertices(cube, np.ones(8, dtype=bool))


def test_holes_remove_the_nearest_vertices_and_leave_one_boundary_each() -> None:
    sphere = icosphere(10)
    holed = with_holes(sphere, [(0, 0, 1), (1, 0, 0)], [30, 20])
    report = topology_report(holed)
    assert holed.n_vertices == sphere.n_vertices - 50
    assert report.euler_characteristic == 0
    assert report.components == 1
    assert holed.vertices[:, 2].max() < sphere.vertices[:, 2].max()


def test_cutting_and_joining_give_boundaries_and_components() -> None:
    sphere = icosphere(6)
    bowl = cut_open(sphere, (0, 0, 1), 0.2)
    assert bowl.vertices[:, 2].max() <= 0.2
    assert topology_report(bowl).euler_characteristic == 1
    both = together([sphere, placed(bowl, 2.0, (5, 0, 0))])
    assert topology_report(both).components == 2
    np.testing.assert_allclose(both.vertices[sphere.n_vertices :], 2 * bowl.vertices + [5, 0, 0])


def test_slivers_change_the_triangles_and_nothing_else(cube_mesh: TriangleMesh) -> None:
    spiky = with_slivers(cube_mesh, 0.1, seed=3)
    assert smallest_angles(spiky).min() < 3
    assert volume(spiky) == pytest.approx(volume(cube_mesh), rel=1e-12)
    assert face_areas(spiky.vertices, spiky.faces).min() > 0
    assert each_edge_runs_both_ways(spiky)
    assert spiky.n_faces == cube_mesh.n_faces + 2 * round(0.1 * cube_mesh.n_faces)


def test_shuffling_keeps_flat_faces_flat_and_sharp_edges_in_place(cube_mesh: TriangleMesh) -> None:
    shuffled = shuffled_along_surface(cube_mesh, 0.3, seed=1)
    assert np.abs(mechanical.cube().value(shuffled.vertices)).max() < 1e-9
    sharp = np.unique(sharp_edges(cube_mesh, 30))
    assert np.array_equal(shuffled.vertices[sharp], cube_mesh.vertices[sharp])
    others = np.setdiff1d(np.arange(cube_mesh.n_vertices), sharp)
    assert (shuffled.vertices[others] != cube_mesh.vertices[others]).any(axis=1).all()
    assert volume(shuffled) == pytest.approx(volume(cube_mesh), rel=1e-9)


def test_sharp_edges_agree_with_a_plain_loop() -> None:
    mesh = mesh_solid(mechanical.pipe(), 600, relaxation_steps=10)
    expected = sorted(edge for edge, angle in fold_angles(mesh).items() if angle > 40)
    assert [tuple(edge) for edge in sharp_edges(mesh, 40).tolist()] == expected
    assert len(expected) > 50


def test_the_wavy_sheet_is_a_disc_of_almost_even_triangles_with_its_height_formula() -> None:
    sheet = wavy_sheet(20)
    report = topology_report(sheet)
    x, y, z = sheet.vertices.T
    np.testing.assert_allclose(z, 0.12 * (np.sin(5 * x) + np.cos(7 * y)), atol=1e-15)
    assert report.euler_characteristic == 1
    assert report.non_manifold_edges == 0
    assert [x.min(), x.max(), y.min(), y.max()] == [-1, 1, -1, 1]
    assert (face_normals(sheet.vertices, sheet.faces)[:, 2] > 0).all()
    assert smallest_angles(sheet).min() > 15


def test_graded_meshes_have_finer_triangles_where_asked() -> None:
    mesh = mesh_solid(organic.blob(1), 900, size=lambda p: np.where(p[:, 0] > 0, 1.5, 0.7), relaxation_steps=5)
    edges = unique_edges(mesh.faces)
    middles = mesh.vertices[edges].mean(axis=1)[:, 0]
    lengths = edge_lengths(mesh)
    assert lengths[middles > 0.2].mean() > 1.6 * lengths[middles < -0.2].mean()


def test_the_development_set_makes_what_it_is_asked_for() -> None:
    made = dict(development_set(["sphere", "wavy-sheet", "sparse-bumps"]))
    assert list(made) == ["sphere", "wavy-sheet", "sparse-bumps"]
    assert made["sphere"].n_vertices == 4002
    assert len(DEVELOPMENT_SHAPES) >= 25
    with pytest.raises(SettingsError, match=r"'teapot'.*cube"):
        next(development_set(["teapot"]))


def test_touching_tetrahedra_are_no_closed_surface(tetrahedron: TriangleMesh) -> None:
    assert is_closed_surface(tetrahedron.faces, 4)
    # A second one that shares only vertex 0: every edge has two faces, but vertex 0 joins two fans.
    second = np.where(tetrahedron.faces == 0, 0, tetrahedron.faces + 3)
    assert not is_closed_surface(np.concatenate([tetrahedron.faces, second]), 7)
    assert not is_closed_surface(tetrahedron.faces[1:], 4)
    assert not is_closed_surface(tetrahedron.faces, 5)
