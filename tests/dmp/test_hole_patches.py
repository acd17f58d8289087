"""The parts of filling one hole: its rim is triangulated, and the patch refined and faired."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from dmp.boundary import boundary_loops
from dmp.geometry import face_areas, face_normals
from dmp.hole_filling.closing import close_hole, surroundings
from dmp.hole_filling.fairing import fair, harmonic
from dmp.hole_filling.long_rims import long_rim_triangulation
from dmp.hole_filling.refinement import refine
from dmp.hole_filling.triangulation import minimum_weight_triangulation
from dmp.mesh import BoolArray, FloatArray
from tests.dmp import holed_meshes


def shoelace_area(corners: FloatArray) -> float:
    x, y = corners[:, 0], corners[:, 1]
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


def star(n: int) -> FloatArray:
    angle = 2 * np.pi * np.arange(n) / n
    radius = 1 + 0.6 * np.cos(5 * angle)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)


def all_triangulations(first: int, last: int) -> list[list[tuple[int, int, int]]]:
    if last - first < 2:
        return [[]]
    return [
        [*left, (first, middle, last), *right]
        for middle in range(first + 1, last)
        for left in all_triangulations(first, middle)
        for right in all_triangulations(middle, last)
    ]


def nothing_forbidden(n: int) -> BoolArray:
    return np.zeros((n, n), dtype=bool)


class TestTriangulation:
    @pytest.mark.parametrize("n", [3, 4, 7, 40])
    def test_a_flat_star_is_covered_exactly(self, n: int) -> None:
        corners = star(n)
        triangles = minimum_weight_triangulation(corners, np.zeros((n, 3)), nothing_forbidden(n))
        assert triangles is not None
        assert triangles.shape == (n - 2, 3)
        assert face_areas(corners, triangles).sum() == pytest.approx(shoelace_area(corners))

    @pytest.mark.parametrize("n", [305, 700])
    def test_a_long_flat_star_too(self, n: int) -> None:
        corners = star(n)
        triangles = long_rim_triangulation(corners, np.zeros((n, 3)), np.empty((0, 2), dtype=np.int64))
        assert triangles is not None
        assert triangles.shape == (n - 2, 3)
        assert face_areas(corners, triangles).sum() == pytest.approx(shoelace_area(corners))

    def test_the_smallest_area_is_found_where_angles_do_not_differ(self) -> None:
        random = np.random.default_rng(2)
        angle = 2 * np.pi * np.arange(7) / 7
        options = np.array(all_triangulations(0, 6))
        for _ in range(10):
            # Nearly flat, so that all angles count as equal and the sum of the areas decides.
            corners = np.stack([np.cos(angle), np.sin(angle), 0.001 * random.standard_normal(7)], axis=1)
            triangles = minimum_weight_triangulation(corners, np.zeros((7, 3)), nothing_forbidden(7))
            areas = [face_areas(corners, option).sum() for option in options]
            assert triangles is not None
            assert sorted(triangles.tolist()) == sorted(options[int(np.argmin(areas))].tolist())

    def test_of_two_diagonals_the_one_with_the_flatter_worst_bend_is_taken(self) -> None:
        random = np.random.default_rng(6)
        options = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]])
        taken = []
        for _ in range(60):
            corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) + random.uniform(-0.4, 0.4, (4, 3))
            outside = random.standard_normal((4, 3)) + np.array([0, 0, 2])
            outside /= np.linalg.norm(outside, axis=1, keepdims=True)
            worst = []
            for triangles in options:
                normals = face_normals(corners, triangles)
                beside = [next(k for k in (0, 1) if {i, (i + 1) % 4} <= set(triangles[k].tolist())) for i in range(4)]
                cosines = [*np.einsum("ic,ic->i", normals[beside], outside), normals[0] @ normals[1]]
                worst.append(np.degrees(np.arccos(min(cosines))))
            if abs(worst[0] - worst[1]) < 4:
                continue
            found = minimum_weight_triangulation(corners, outside, nothing_forbidden(4))
            assert found is not None
            best = int(np.argmin(worst))
            assert sorted(map(sorted, found.tolist())) == options[best].tolist()
            taken.append(best)
        assert len(taken) > 20
        assert set(taken) == {0, 1}

    def test_forbidden_edges_are_avoided_or_nothing_is_found(self) -> None:
        corners = star(6)
        forbidden = nothing_forbidden(6)
        forbidden[0, 2] = forbidden[2, 0] = forbidden[3, 5] = forbidden[5, 3] = True
        found = minimum_weight_triangulation(corners, np.zeros((6, 3)), forbidden)
        assert found is not None
        pairs = {frozenset(pair) for triangle in found.tolist() for pair in itertools.combinations(triangle, 2)}
        assert pairs.isdisjoint({frozenset((0, 2)), frozenset((3, 5))})
        assert minimum_weight_triangulation(corners, np.zeros((6, 3)), ~nothing_forbidden(6)) is None
        every = np.array(list(itertools.combinations(range(6), 2)))
        assert long_rim_triangulation(corners, np.zeros((6, 3)), every) is None

    def test_without_a_free_diagonal_a_hole_is_closed_around_a_new_vertex(self) -> None:
        mesh = holed_meshes.sheet_with_square_holes()
        loop = boundary_loops(mesh)[2]
        rim = loop.vertices[::-1]
        start, _ = surroundings(mesh.vertices, mesh.faces[np.isin(mesh.faces, rim).any(axis=1)], rim)
        start.outside_edges = np.array(list(itertools.combinations(range(6), 2)))
        patch, remarks = close_hole(start)
        assert patch.n_inserted == 1
        assert len(patch.triangles) == 6
        assert len(remarks) == 1
        assert remarks[0].startswith("is closed around a new vertex")


class TestFairing:
    @pytest.mark.parametrize("tension", [0.0, 0.5, np.inf])
    def test_membrane_and_plate_reproduce_a_saddle(self, tension: float) -> None:
        # A slight saddle c (x^2 - y^2) solves the equations of both, so what lies inside continues what lies outside.
        mesh = holed_meshes.sheet_with_large_round_hole(40)
        x, y, _ = mesh.vertices.T
        mesh = mesh.with_vertices(np.stack([x, y, 0.03 * (x**2 - y**2)], axis=1))
        loop = min(boundary_loops(mesh), key=lambda item: item.perimeter)
        rim = loop.vertices[::-1]
        start, _ = surroundings(mesh.vertices, mesh.faces[np.isin(mesh.faces, rim).any(axis=1)], rim)
        patch, _ = close_hole(start)
        patch.positions[patch.inserted, 2] = 0
        for _ in range(4):
            fair(patch, tension)
        x, y, z = (patch.positions + patch.origin)[patch.inserted].T
        np.testing.assert_allclose(z, 0.03 * (x**2 - y**2), atol=1e-3)

    def test_values_at_the_rim_are_continued_within_their_range(self) -> None:
        mesh = holed_meshes.sheet_with_square_holes()
        loop = boundary_loops(mesh)[1]
        rim = loop.vertices[::-1]
        start, _ = surroundings(mesh.vertices, mesh.faces[np.isin(mesh.faces, rim).any(axis=1)], rim)
        patch, _ = close_hole(start)
        values = np.stack([np.full(patch.n_rim, 4.0), patch.positions[: patch.n_rim, 0]], axis=1)
        found = harmonic(patch, values)
        np.testing.assert_allclose(found[:, 0], 4.0)
        assert found[:, 1].min() >= values[:, 1].min()
        assert found[:, 1].max() <= values[:, 1].max()

    def test_refining_stops_at_the_limit(self) -> None:
        mesh = holed_meshes.sheet_with_large_round_hole(60)
        loop = min(boundary_loops(mesh), key=lambda item: item.perimeter)
        rim = loop.vertices[::-1]
        start, _ = surroundings(mesh.vertices, mesh.faces[np.isin(mesh.faces, rim).any(axis=1)], rim)
        found = minimum_weight_triangulation(start.positions[:60], np.zeros((60, 3)), nothing_forbidden(60))
        assert found is not None
        start.triangles = found
        assert not refine(start, 1.0, 50)
