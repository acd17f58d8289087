"""Filling holes: hard ones are closed or left open with a reason, and what is inserted fits its surroundings."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from dmp import meshlab
from dmp.boundary import boundary_loops
from dmp.errors import MeshError
from dmp.geometry import face_areas, face_normals, mean_edge_length
from dmp.hole_filling.patch import inner_edges
from dmp.holes import OUTER_RIM, FilledMesh, fill_holes
from dmp.mesh import FloatArray, IntArray, TriangleMesh
from dmp.meshio import read_mesh
from dmp.surface_distance import distance_to_surface
from dmp.topology import edge_face_counts, unique_edges
from tests.dmp import holed_meshes
from tests.meshes import grid_mesh, sphere_mesh

# Name, mesh, and the numbers of edges of the holes that have to be closed; an empty tuple where it may be refused.
HARD: dict[str, tuple[Callable[[], TriangleMesh], tuple[int, ...]]] = {
    "large and strongly curved": (lambda: holed_meshes.sphere_without_cap(0.3), (56,)),
    "several in one mesh": (holed_meshes.sphere_with_six_holes, (24,) * 6),
    "a sheet with inner holes": (holed_meshes.sheet_with_square_holes, (18, 6)),
    "three that touch in a row": (holed_meshes.touching_holes, (12, 12, 12)),
    "four that touch around a piece": (holed_meshes.ring_of_touching_holes, (12, 12, 12, 12)),
    "a tube cut open": (holed_meshes.open_tube, (24, 24)),
    "across a sharp edge": (holed_meshes.cube_with_hole_across_an_edge, (26,)),
    "a corner broken off": (holed_meshes.cube_without_a_corner, (27,)),
    "a noisy rim": (holed_meshes.sphere_with_ragged_hole, (65,)),
    "a noisier rim": (lambda: holed_meshes.sphere_with_ragged_hole(0.5, 3), (56,)),
    "1,076 edges": (holed_meshes.sheet_with_winding_slit, (1076, 112)),
    "300 edges and ten thousand faces": (lambda: holed_meshes.sheet_with_large_round_hole(300), (300,)),
    "every diagonal taken": (holed_meshes.seven_vertex_torus_without_a_vertex, ()),
    "a fin at the rim": (holed_meshes.hole_with_a_fin, (6,)),
    "a turned face at the rim": (holed_meshes.hole_with_a_turned_face, (6,)),
    "an unwelded seam": (holed_meshes.sheet_with_unwelded_seam, ()),
}


def assert_sound(mesh: TriangleMesh, filled: FilledMesh) -> None:
    """Check what holds for every filling."""
    n, m = mesh.n_vertices, mesh.n_faces
    result = filled.mesh
    np.testing.assert_array_equal(result.vertices[:n], mesh.vertices)
    np.testing.assert_array_equal(result.faces[:m], mesh.faces)
    assert np.flatnonzero(filled.inserted_vertices).tolist() == list(range(n, result.n_vertices))
    assert np.flatnonzero(filled.inserted_faces).tolist() == list(range(m, result.n_faces))
    assert sorted(np.concatenate([[], *(patch.vertices for patch in filled.patches)])) == list(range(n, result.n_vertices))
    assert sorted(np.concatenate([[], *(patch.faces for patch in filled.patches)])) == list(range(m, result.n_faces))
    # What is still open is exactly what was left open, and no edge got a third face.
    still_open = {(int(a), int(b)) for loop in boundary_loops(result) for a, b in loop.edges}
    left_open = {(int(a), int(b)) for boundary in filled.left_open for a, b in boundary.loop.edges}
    assert still_open == left_open
    assert edge_face_counts(result.faces)[1].max() <= max(2, edge_face_counts(mesh.faces)[1].max())
    sides = np.concatenate([result.faces[:, [0, 1]], result.faces[:, [1, 2]], result.faces[:, [2, 0]]])
    inserted = np.tile(filled.inserted_faces, 3)
    all_sides, counts = np.unique(sides, axis=0, return_counts=True)
    doubled = {tuple(side) for side in all_sides[counts > 1].tolist()}
    assert doubled.isdisjoint(map(tuple, sides[inserted].tolist()))
    # Nothing loose, nothing without area, nothing that is no number.
    assert np.isin(np.arange(n, result.n_vertices), result.faces).all()
    assert (face_areas(result.vertices, result.faces[m:]) > 0).all()
    for boundary in filled.left_open:
        assert boundary.reason.endswith(".")
    assert filled.notes


def relative_edge_lengths(filled: FilledMesh, mesh: TriangleMesh) -> FloatArray:
    """Lengths of the edges with an inserted end, over the mean length of the edges at the ten nearest rim vertices."""
    ratios = []
    edges = unique_edges(mesh.faces)
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    around = np.bincount(edges.ravel(), np.repeat(lengths, 2)) / np.bincount(edges.ravel())
    for patch in filled.patches:
        new = unique_edges(filled.mesh.faces[patch.faces])
        ends = filled.mesh.vertices[new[(new >= mesh.n_vertices).any(axis=1)]]
        rim = patch.loop.vertices
        _, nearest = cKDTree(mesh.vertices[rim]).query(ends.mean(axis=1), k=min(10, len(rim)))
        ratios.append(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / around[rim][nearest].mean(axis=1))
    return np.concatenate(ratios)


def bends(filled: FilledMesh) -> FloatArray:
    """Angles in degrees between the normals of neighbouring faces, at least one of them inserted."""
    faces = filled.mesh.faces
    normals = face_normals(filled.mesh.vertices, faces)
    pairs = inner_edges(faces, filled.mesh.n_vertices).triangles
    pairs = pairs[filled.inserted_faces[pairs].any(axis=1)]
    cosines = np.einsum("ec,ec->e", normals[pairs[:, 0]], normals[pairs[:, 1]])
    return np.degrees(np.arccos(np.clip(cosines, -1, 1)))


class TestHardHoles:
    @pytest.mark.parametrize("name", HARD)
    def test_filled_or_left_open_with_a_reason(self, name: str) -> None:
        make, expected = HARD[name]
        mesh = make()
        begin = time.process_time()
        filled = fill_holes(mesh)
        assert time.process_time() - begin < 10
        assert_sound(mesh, filled)
        done = [patch.loop.n_edges for patch in filled.patches]
        for n_edges in set(expected):
            assert done.count(n_edges) >= expected.count(n_edges)

    @pytest.mark.parametrize(
        "name",
        [
            "large and strongly curved",
            "several in one mesh",
            "a sheet with inner holes",
            "a tube cut open",
            "a corner broken off",
        ],
    )
    def test_inserted_edges_are_as_long_as_those_around_and_no_face_is_folded(self, name: str) -> None:
        mesh = HARD[name][0]()
        filled = fill_holes(mesh)
        ratios = relative_edge_lengths(filled, mesh)
        assert ratios.min() > 0.5
        assert ratios.max() < 2
        assert 0.8 < ratios.mean() < 1.2
        assert bends(filled).max() < 80
        assert not any(patch.remarks for patch in filled.patches)

    def test_a_hole_larger_than_what_is_left(self) -> None:
        mesh = holed_meshes.sphere_without_cap(-0.4)
        filled = fill_holes(mesh, boundary_loops(mesh))
        assert_sound(mesh, filled)
        assert edge_face_counts(filled.mesh.faces)[1].min() == 2
        assert bends(filled).max() < 60

    def test_broken_boundaries_are_named(self) -> None:
        filled = fill_holes(holed_meshes.hole_with_a_fin())
        assert "more than two faces" in " ".join(boundary.reason for boundary in filled.left_open)
        filled = fill_holes(holed_meshes.hole_with_a_turned_face())
        assert "which side is outside" in " ".join(boundary.reason for boundary in filled.left_open)
        filled = fill_holes(holed_meshes.sheet_with_unwelded_seam())
        assert "no area" in " ".join(boundary.reason for boundary in filled.left_open)

    @pytest.mark.parametrize("seed", range(4))
    def test_faces_missing_at_random(self, seed: int) -> None:
        sphere = sphere_mesh(3)
        gone = np.random.default_rng(seed).random(sphere.n_faces) < (0.05, 0.15, 0.3, 0.5)[seed]
        mesh = holed_meshes.without_faces(sphere, gone)
        assert_sound(mesh, fill_holes(mesh))

    def test_the_outline_of_a_single_triangle_is_not_doubled(self) -> None:
        triangle = TriangleMesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
        filled = fill_holes(triangle, boundary_loops(triangle))
        assert not filled.patches
        assert "single triangle" in filled.left_open[0].reason

    def test_a_hole_in_one_point(self) -> None:
        sphere = sphere_mesh(2)
        vertices = sphere.vertices.copy()
        vertices[sphere.faces[0]] = [0.6, 0.6, 0.6]
        mesh = TriangleMesh(vertices, sphere.faces[1:])
        filled = fill_holes(mesh)
        assert [boundary.reason for boundary in filled.left_open] == ["All its vertices lie in one point."]

    def test_many_remarks_are_counted(self) -> None:
        sphere = sphere_mesh(4)
        apart = np.arange(0, sphere.n_faces, 40)
        rough = sphere.vertices + 0.3 * np.random.default_rng(0).standard_normal(sphere.vertices.shape)
        gone = np.isin(sphere.faces, sphere.faces[apart]).any(axis=1)
        filled = fill_holes(holed_meshes.without_faces(sphere.with_vertices(rough), gone))
        n_remarks = sum(len(patch.remarks) for patch in filled.patches)
        assert n_remarks > 6
        assert filled.notes[-1] == f"There are {n_remarks - 5} more such remarks about single holes."

    def test_the_rim_of_a_flat_sheet_cannot_be_closed(self) -> None:
        sheet = TriangleMesh(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
        filled = fill_holes(sheet, boundary_loops(sheet))
        assert not filled.patches
        assert "lie on" in filled.left_open[0].reason


class TestShape:
    def test_a_missing_face_is_put_back(self, sphere: TriangleMesh) -> None:
        filled = fill_holes(TriangleMesh(sphere.vertices, sphere.faces[1:]))
        assert set(filled.mesh.faces[-1].tolist()) == set(sphere.faces[0].tolist())
        np.testing.assert_allclose(
            face_normals(sphere.vertices, filled.mesh.faces[-1:]), face_normals(sphere.vertices, sphere.faces[:1])
        )
        assert not filled.inserted_vertices.any()

    def test_a_plane_stays_a_plane(self) -> None:
        sheet = grid_mesh(24)
        random = np.random.default_rng(1)
        inside = (sheet.vertices[:, :2] > 0).all(axis=1) & (sheet.vertices[:, :2] < 23).all(axis=1)
        crooked = sheet.vertices.copy()
        crooked[inside, :2] += random.uniform(-0.25, 0.25, (np.count_nonzero(inside), 2))
        hole = np.linalg.norm(crooked[:, :2] - 11.5, axis=1) < 6.3
        mesh = holed_meshes.without_vertices(sheet.with_vertices(crooked), hole)
        filled = fill_holes(mesh)
        assert np.abs(filled.mesh.vertices[:, 2]).max() < 1e-9
        # Flat and without overlap: the areas add up to the whole square.
        assert face_areas(filled.mesh.vertices, filled.mesh.faces).sum() == pytest.approx(23**2)
        assert np.count_nonzero(filled.inserted_vertices) == pytest.approx(np.count_nonzero(hole), rel=0.25)

    def test_a_sphere_stays_nearly_a_sphere(self) -> None:
        mesh = holed_meshes.sphere_without_cap(0.9)
        filled = fill_holes(mesh)
        edge_length = mean_edge_length(mesh.vertices, unique_edges(mesh.faces))
        off = np.abs(np.linalg.norm(filled.mesh.vertices[filled.inserted_vertices], axis=1) - 1)
        # A flat lid over this hole would be off by up to 0.1, that is 1.3 edge lengths.
        assert off.max() < 0.15 * edge_length

    def test_the_patch_leaves_the_rim_without_a_crease(self) -> None:
        tube = holed_meshes.open_tube(40, 12)
        filled = fill_holes(tube)
        # Flat lids would bend by 90 degrees; neighbouring faces of the tube do by 9.
        assert bends(filled).max() < 35
        new = filled.mesh.vertices[filled.inserted_vertices]
        assert new[:, 2].max() > tube.vertices[:, 2].max() + 0.2
        assert new[:, 2].min() < -0.2

    @pytest.mark.parametrize("scale", [2.0**-20, 2.0**20])
    def test_the_unit_does_not_matter(self, scale: float) -> None:
        mesh = holed_meshes.sphere_with_ragged_hole()
        here = fill_holes(mesh)
        there = fill_holes(mesh.with_vertices(scale * mesh.vertices))
        np.testing.assert_array_equal(here.mesh.faces, there.mesh.faces)
        np.testing.assert_allclose(there.mesh.vertices / scale, here.mesh.vertices, rtol=1e-12)

    def test_the_place_does_not_matter(self) -> None:
        mesh = holed_meshes.sphere_with_ragged_hole()
        away = np.array([1e6, -3e6, 2e6])
        here = fill_holes(mesh).mesh
        there = fill_holes(mesh.with_vertices(mesh.vertices + away)).mesh
        np.testing.assert_array_equal(here.faces, there.faces)
        np.testing.assert_allclose(there.vertices - away, here.vertices, atol=1e-6)

    def test_attributes_are_continued(self) -> None:
        sheet = holed_meshes.sheet_with_square_holes()
        height = sheet.vertices[:, 0]
        mesh = sheet.with_attributes(
            warmth=height,
            color=np.stack([10 * height, 0 * height, 255 + 0 * height], axis=1).astype(np.uint8),
            part=np.where(height < 8, 3, 7),
        )
        filled = fill_holes(mesh)
        new = filled.inserted_vertices
        attributes = filled.mesh.vertex_attributes
        np.testing.assert_array_equal(attributes["part"][~new], mesh.vertex_attributes["part"])
        np.testing.assert_allclose(attributes["warmth"][new], filled.mesh.vertices[new, 0], atol=1.0)
        assert attributes["color"].dtype == np.uint8
        assert (attributes["color"][new, 1:] == [0, 255]).all()
        np.testing.assert_allclose(attributes["color"][new, 0], 10 * filled.mesh.vertices[new, 0], atol=12)
        assert set(attributes["part"][new]) == {3, 7}


class TestChoice:
    def test_a_mesh_without_holes_gets_a_sentence(self, cube: TriangleMesh) -> None:
        filled = fill_holes(cube)
        assert filled.notes == ("The mesh has no holes.",)
        assert filled.mesh.same_connectivity(cube)
        assert not filled.inserted_vertices.any()
        assert not filled.patches

    def test_the_outer_rim_of_a_sheet_is_left_open_unless_asked_for(self) -> None:
        mesh = holed_meshes.sphere_without_cap(-0.4)
        (boundary,) = fill_holes(mesh).left_open
        assert boundary.reason == OUTER_RIM
        assert len(fill_holes(mesh, boundary_loops(mesh)).patches) == 1

    def test_large_holes_can_be_left_open(self) -> None:
        mesh = holed_meshes.sheet_with_square_holes()
        filled = fill_holes(mesh, max_hole_edges=6)
        assert [patch.loop.n_edges for patch in filled.patches] == [6]
        assert [boundary.loop.n_edges for boundary in filled.left_open] == [52, 18]
        assert "18 edges" in filled.left_open[1].reason
        assert_sound(mesh, filled)

    def test_only_chosen_holes_are_filled(self) -> None:
        mesh = holed_meshes.sphere_with_six_holes()
        filled = fill_holes(mesh, boundary_loops(mesh)[2:4])
        assert len(filled.patches) == 2
        assert len(boundary_loops(filled.mesh)) == 4

    def test_filling_twice_finds_nothing_more(self) -> None:
        filled = fill_holes(holed_meshes.sphere_with_six_holes())
        assert fill_holes(filled.mesh).notes == ("The mesh has no holes.",)

    def test_the_same_again_gives_the_same(self) -> None:
        mesh = holed_meshes.sphere_with_ragged_hole()
        first, second = fill_holes(mesh).mesh, fill_holes(mesh).mesh
        np.testing.assert_array_equal(first.faces, second.faces)
        np.testing.assert_array_equal(first.vertices, second.vertices)

    def test_loops_of_another_mesh_are_refused(self, cube: TriangleMesh) -> None:
        loops = boundary_loops(holed_meshes.sheet_with_square_holes())
        with pytest.raises(MeshError, match="no boundaries of this mesh"):
            fill_holes(cube, loops)
        with pytest.raises(MeshError, match="no boundaries of this mesh"):
            fill_holes(sphere_mesh(3), loops[2:])

    def test_the_same_hole_twice_is_refused(self) -> None:
        mesh = holed_meshes.sheet_with_square_holes()
        with pytest.raises(MeshError, match="no boundaries of this mesh"):
            fill_holes(mesh, [boundary_loops(mesh)[1]] * 2)

    def test_wrong_arguments_are_refused(self, cube: TriangleMesh) -> None:
        with pytest.raises(MeshError, match="not 'magic'"):
            fill_holes(cube, method="magic")  # type: ignore[arg-type]
        with pytest.raises(MeshError, match="at least 3"):
            fill_holes(cube, max_hole_edges=2)
        with pytest.raises(MeshError, match="no faces"):
            fill_holes(TriangleMesh(np.zeros((3, 3)), np.empty((0, 3), dtype=np.int64)))


class TestMeshlab:
    def test_its_patches_are_taken_over(self) -> None:
        mesh = holed_meshes.sphere_with_six_holes()
        filled = fill_holes(mesh, method="meshlab")
        assert_sound(mesh, filled)
        assert len(filled.patches) == 6
        assert "meshlab" in {patch.method for patch in filled.patches}

    def test_where_it_fails_the_holes_are_filled_all_the_same(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def crash(*_arguments: object, **_more: object) -> None:
            raise MeshError("MeshLab crashed (SIGSEGV).")

        monkeypatch.setattr(meshlab, "close_holes", crash)
        mesh = holed_meshes.sphere_with_six_holes()
        filled = fill_holes(mesh, method="meshlab")
        assert_sound(mesh, filled)
        assert {patch.method for patch in filled.patches} == {"own"}
        assert any("MeshLab crashed (SIGSEGV)." in note for note in filled.notes)

    @pytest.mark.parametrize("damage", ["gap", "doubled", "turned"])
    def test_patches_that_do_not_fit_are_replaced(self, damage: str, monkeypatch: pytest.MonkeyPatch) -> None:
        mesh = holed_meshes.sphere_with_six_holes()
        good = fill_holes(mesh).mesh

        def damaged(*_arguments: object, **_more: object) -> tuple[FloatArray, IntArray]:
            new = good.faces[mesh.n_faces :]
            new = {"gap": new[2:], "doubled": np.concatenate([new, new[:1]]), "turned": new[:, ::-1]}[damage]
            return good.vertices, np.concatenate([mesh.faces, new])

        monkeypatch.setattr(meshlab, "close_holes", damaged)
        filled = fill_holes(mesh, method="meshlab")
        assert_sound(mesh, filled)
        assert len(filled.patches) == 6
        assert any(note.endswith("without MeshLab, which could not close it properly.") for note in filled.notes)


@pytest.mark.shared_meshes
class TestMeasured:
    def test_two_holes_in_the_bumpy_sphere(self, shared_meshes: Path) -> None:
        truth = read_mesh(shared_meshes / "bumpy" / "ground_truth.obj")
        centers = truth.vertices[[100, 3000]]
        gone = (np.linalg.norm(truth.vertices[:, None] - centers, axis=2) < 0.13).any(axis=1)
        filled = fill_holes(holed_meshes.without_vertices(truth, gone))
        distance = distance_to_surface(filled.mesh.vertices[filled.inserted_vertices], truth).mean()
        # 0.47 for the patches of MeshLab without fairing.
        assert distance / mean_edge_length(truth.vertices, unique_edges(truth.faces)) < 0.33

    def test_the_hole_in_the_dragon(self, shared_meshes: Path) -> None:
        filled_by_others = read_mesh(shared_meshes / "dragon_hole" / "filled.obj")
        gone = np.zeros(filled_by_others.n_vertices, dtype=bool)
        gone[np.loadtxt(shared_meshes / "dragon_hole" / "inserted_vertices.txt", dtype=int)] = True
        filled = fill_holes(holed_meshes.without_vertices(filled_by_others, gone))
        truth = read_mesh(shared_meshes / "dragon" / "ground_truth.obj")
        truth = truth.with_vertices(truth.vertices + np.array([0.0321, -0.0326, 8.6836]))
        distance = distance_to_surface(filled.mesh.vertices[filled.inserted_vertices], truth).mean()
        # 0.434 for the published filling.
        assert distance / mean_edge_length(truth.vertices, unique_edges(truth.faces)) < 0.38
