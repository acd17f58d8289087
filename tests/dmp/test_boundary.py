"""Boundary loops: found, separated where they touch, told apart from broken boundaries and outer rims."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from dmp.boundary import CROWDED, TWISTED, BoundaryLoop, boundary_loops, outer_rims
from dmp.mesh import TriangleMesh
from tests.dmp import holed_meshes
from tests.meshes import grid_mesh, sphere_mesh


def boundary_half_edges(mesh: TriangleMesh) -> set[tuple[int, int]]:
    """Count by hand which half-edges have no other face at their edge."""
    count: Counter[frozenset[int]] = Counter()
    sides = [(int(f[k]), int(f[(k + 1) % 3])) for f in mesh.faces for k in range(3)]
    count.update(frozenset(side) for side in sides)
    return {side for side in sides if count[frozenset(side)] == 1}


def assert_closed_cycle(loop: BoundaryLoop) -> None:
    np.testing.assert_array_equal(loop.edges[:, 1], np.roll(loop.edges[:, 0], -1))
    assert len(np.unique(loop.vertices)) == loop.n_edges


def sheets_side_by_side(*meshes: TriangleMesh) -> TriangleMesh:
    vertices, faces, n = [], [], 0
    for k, mesh in enumerate(meshes):
        vertices.append(mesh.vertices + np.array([100.0 * k, 0, 0]))
        faces.append(mesh.faces + n)
        n += mesh.n_vertices
    return TriangleMesh(np.concatenate(vertices), np.concatenate(faces))


class TestLoops:
    def test_a_closed_mesh_has_none(self, cube: TriangleMesh) -> None:
        assert boundary_loops(cube) == ()

    def test_a_mesh_without_faces_has_none(self) -> None:
        assert boundary_loops(TriangleMesh(np.zeros((3, 3)), np.empty((0, 3), dtype=np.int64))) == ()

    def test_a_missing_face_leaves_its_outline_backwards(self, tetrahedron: TriangleMesh) -> None:
        (loop,) = boundary_loops(TriangleMesh(tetrahedron.vertices, tetrahedron.faces[1:]))
        missing = {(0, 1), (1, 2), (2, 0)}
        assert {(int(b), int(a)) for a, b in loop.edges} == missing
        assert loop.vertices.tolist() == [0, 2, 1]
        assert loop.is_simple
        assert loop.problem == ""
        assert loop.perimeter == pytest.approx(3 * 2 * np.sqrt(2))
        np.testing.assert_allclose(loop.center, tetrahedron.vertices[:3].mean(axis=0))

    def test_measures_of_a_sheet(self) -> None:
        (loop,) = boundary_loops(grid_mesh(5))
        assert loop.n_edges == 16
        assert loop.perimeter == pytest.approx(16)
        assert loop.size == pytest.approx(np.sqrt(32))
        np.testing.assert_allclose(loop.center, [2, 2, 0])
        assert loop.vertices[0] == 0

    def test_the_longest_comes_first(self) -> None:
        loops = boundary_loops(holed_meshes.sheet_with_square_holes())
        assert [loop.n_edges for loop in loops] == [52, 18, 6]
        assert loops[1].perimeter > loops[2].perimeter

    @pytest.mark.parametrize("seed", range(6))
    def test_random_holes_against_counting_by_hand(self, seed: int) -> None:
        sphere = sphere_mesh(3)
        gone = np.random.default_rng(seed).random(sphere.n_faces) < (0.02, 0.1, 0.3, 0.5, 0.7, 0.9)[seed]
        holed = holed_meshes.without_faces(sphere, gone)
        loops = boundary_loops(holed)
        found = [(int(a), int(b)) for loop in loops for a, b in loop.edges]
        assert len(found) == len(set(found))
        assert set(found) == boundary_half_edges(holed)
        for loop in loops:
            assert_closed_cycle(loop)

    def test_faces_that_name_a_vertex_twice_are_overlooked(self) -> None:
        sheet = grid_mesh(4)
        with_spikes = TriangleMesh(sheet.vertices, np.concatenate([sheet.faces, [[0, 0, 1], [5, 6, 6], [9, 9, 9]]]))
        assert [loop.edges.tolist() for loop in boundary_loops(with_spikes)] == [
            loop.edges.tolist() for loop in boundary_loops(sheet)
        ]


class TestTouchingLoops:
    def test_holes_that_touch_are_separated(self) -> None:
        loops = boundary_loops(holed_meshes.touching_holes(3))
        assert [loop.n_edges for loop in loops] == [68, 12, 12, 12]
        for loop in loops[1:]:
            assert_closed_cycle(loop)
            assert loop.size < 5

    def test_a_piece_that_hangs_on_four_vertices_separates_four_holes(self) -> None:
        loops = boundary_loops(holed_meshes.ring_of_touching_holes())
        assert [loop.n_edges for loop in loops] == [60, 12, 12, 12, 12]
        for loop in loops[1:]:
            assert_closed_cycle(loop)

    def test_sheets_that_touch_in_a_corner_have_a_rim_each(self) -> None:
        sheet = grid_mesh(3)
        joined = TriangleMesh(
            np.concatenate([sheet.vertices, sheet.vertices[1:] + np.array([2, 2, 0])]),
            np.concatenate([sheet.faces, np.where(sheet.faces == 0, 8, sheet.faces + 8)]),
        )
        loops = boundary_loops(joined)
        assert [loop.n_edges for loop in loops] == [8, 8]
        for loop in loops:
            assert_closed_cycle(loop)
        assert loops[0].vertices.max() <= 8
        assert outer_rims(joined, loops) in {(0,), (1,)}

    def test_three_triangles_around_one_vertex(self) -> None:
        angle = np.arange(6) * np.pi / 3
        points = np.concatenate([[[0, 0, 0]], np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)])
        loops = boundary_loops(TriangleMesh(points, np.array([[0, 1, 2], [0, 3, 4], [0, 5, 6]])))
        assert [loop.n_edges for loop in loops] == [3, 3, 3]
        assert all(loop.is_simple for loop in loops)


class TestBrokenBoundaries:
    def test_a_fin_at_the_rim(self) -> None:
        loops = boundary_loops(holed_meshes.hole_with_a_fin())
        assert [loop.problem for loop in loops] == ["", CROWDED, ""]
        assert loops[1].n_edges == 20
        assert not loops[1].is_simple
        np.testing.assert_array_equal(loops[1].vertices, np.unique(loops[1].edges))

    def test_a_face_turned_over_at_the_rim(self) -> None:
        loops = boundary_loops(holed_meshes.hole_with_a_turned_face())
        assert [loop.problem for loop in loops] == ["", TWISTED, ""]

    def test_a_moebius_strip_has_no_outside(self) -> None:
        n = 20
        turn = np.arange(n) * 2 * np.pi / n
        across = np.array([-0.3, 0.3])
        radius = 1 + across[None] * np.cos(turn / 2)[:, None]
        height = across[None] * np.sin(turn / 2)[:, None]
        points = np.stack([radius * np.cos(turn)[:, None], radius * np.sin(turn)[:, None], height], axis=2).reshape(-1, 3)
        faces = []
        for i in range(n):
            a, b = 2 * i, 2 * i + 1
            c, d = (2 * i + 2, 2 * i + 3) if i < n - 1 else (1, 0)
            faces += [[a, c, b], [b, c, d]]
        loops = boundary_loops(TriangleMesh(points, np.array(faces)))
        assert sum(loop.n_edges for loop in loops) == 2 * n
        assert [loop.problem for loop in loops] == [TWISTED]
        assert outer_rims(TriangleMesh(points, np.array(faces)), loops) == ()


class TestOuterRims:
    def test_of_a_sheet_with_holes(self) -> None:
        mesh = holed_meshes.sheet_with_square_holes()
        assert outer_rims(mesh, boundary_loops(mesh)) == (0,)

    def test_of_a_narrow_ring_the_outer_one(self) -> None:
        ring = holed_meshes.sheet_with_large_round_hole(60)
        loops = boundary_loops(ring)
        (rim,) = outer_rims(ring, loops)
        assert np.linalg.norm(ring.vertices[loops[rim].vertices][:, :2], axis=1).min() > 1.05

    def test_a_ragged_hole_longer_than_the_rim_stays_a_hole(self) -> None:
        mesh = holed_meshes.sheet_with_winding_slit()
        loops = boundary_loops(mesh)
        assert loops[0].perimeter > 2 * loops[1].perimeter
        assert outer_rims(mesh, loops) == (1,)

    @pytest.mark.parametrize(("height", "is_sheet"), [(0.9, False), (0.5, False), (-0.3, True), (-0.7, True)])
    def test_a_sphere_becomes_a_sheet_when_more_than_half_is_gone(self, height: float, is_sheet: bool) -> None:
        mesh = holed_meshes.sphere_without_cap(height)
        assert outer_rims(mesh, boundary_loops(mesh)) == ((0,) if is_sheet else ())

    def test_a_tube_has_none(self) -> None:
        tube = holed_meshes.open_tube()
        assert outer_rims(tube, boundary_loops(tube)) == ()

    def test_a_closed_mesh_has_none(self, cube: TriangleMesh) -> None:
        assert outer_rims(cube, boundary_loops(cube)) == ()

    def test_every_piece_has_its_own(self) -> None:
        holed_sphere = holed_meshes.sphere_without_cap(0.8)
        mesh = sheets_side_by_side(grid_mesh(4), holed_sphere, holed_meshes.sheet_with_square_holes())
        loops = boundary_loops(mesh)
        rims = outer_rims(mesh, loops)
        assert sorted(loops[index].n_edges for index in rims) == [12, 52]

    def test_turning_all_faces_over_changes_nothing(self) -> None:
        mesh = holed_meshes.sheet_with_square_holes()
        turned = TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
        loops = boundary_loops(turned)
        assert [loops[index].n_edges for index in outer_rims(turned, loops)] == [52]

    def test_noise_does_not_hide_a_sheet(self) -> None:
        sheet = grid_mesh(20, height=0.5)
        assert outer_rims(sheet, boundary_loops(sheet)) == (0,)
