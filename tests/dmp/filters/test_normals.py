from __future__ import annotations

import numpy as np
import pytest

from dmp.filters import filtered
from dmp.filters.guided import Guidance
from dmp.filters.neighbours import MOST_FACES, around_vertices, over_edges
from dmp.geometry import face_normals
from dmp.mesh import TriangleMesh
from dmp.metrics import mean_angular_difference
from dmp.noise import add_noise
from tests.dmp.filters import plain_loops
from tests.meshes import grid_mesh, sphere_mesh

NORMAL_FILTERS = ("bilateral_normal", "guided_normal")


def cube_mesh(n: int) -> TriangleMesh:
    """The surface of a cube with n x n squares a side, faces outward."""
    side = grid_mesh(n + 1)
    square = (side.vertices[:, :2] / n * 2 - 1).T
    top = np.column_stack([*square, np.ones(side.n_vertices)])
    turns = [np.eye(3), np.diag([1, -1, -1])]
    turns += [np.array([[1, 0, 0], [0, 0, s], [0, -s, 0]]) for s in (1, -1)]
    turns += [np.array([[0, 0, s], [0, 1, 0], [-s, 0, 0]]) for s in (1, -1)]
    soup = np.vstack([top @ np.array(turn, dtype=float).T for turn in turns])
    faces = np.vstack([side.faces + index * side.n_vertices for index in range(6)])
    vertices, inverse = np.unique(np.round(soup, 9), axis=0, return_inverse=True)
    return TriangleMesh(vertices, inverse.reshape(-1)[faces])


MESHES = {
    "closed": add_noise(sphere_mesh(1), 0.2),
    "open": grid_mesh(5, height=0.4),
    "far away": add_noise(sphere_mesh(1), 0.2).with_vertices(20 * add_noise(sphere_mesh(1), 0.2).vertices + 1000),
}


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES.keys())
@pytest.mark.parametrize(("neighbourhood", "least_common"), [("vertex", 1), ("edge", 2)])
def test_bilateral_filtering_is_the_formula_of_the_paper(mesh: TriangleMesh, neighbourhood: str, least_common: int) -> None:
    expected = plain_loops.bilateral(mesh, 3, 0.5, least_common, 4)
    found = filtered(mesh, "bilateral_normal", iterations=3, sigma=0.5, neighbourhood=neighbourhood, vertex_steps=4)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert np.abs(expected - mesh.vertices).max() > 0.01


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES.keys())
@pytest.mark.parametrize("radius", [1.2, 2.0])
def test_guided_filtering_is_the_formula_of_the_paper(mesh: TriangleMesh, radius: float) -> None:
    expected = plain_loops.guided(mesh, 2, 0.4, radius, 3)
    found = filtered(mesh, "guided_normal", iterations=2, sigma=0.4, radius=radius, vertex_steps=3)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert np.abs(expected - mesh.vertices).max() > 0.01


def test_a_patch_is_the_less_consistent_the_more_its_normals_differ_at_one_edge() -> None:
    # A flat strip, a strip bent at one edge, and one bent as much in all, evenly.
    def strip(heights: list[float]) -> TriangleMesh:
        x = np.arange(4.0)
        rows = [np.column_stack([x, np.full(4, y), heights]) for y in (0.0, 1.0)]
        faces = [face for i in range(3) for face in ([i, i + 1, 5 + i], [i, 5 + i, 4 + i])]
        return TriangleMesh(np.vstack(rows), np.array(faces))

    def measure(mesh: TriangleMesh) -> float:
        guidance = Guidance(around_vertices(mesh.faces), over_edges(mesh.faces))
        # The patch of the third face holds all six.
        return float(guidance.inconsistency(face_normals(mesh.vertices, mesh.faces))[2])

    flat, sharp = measure(strip([0, 0, 0, 0])), measure(strip([0, 0, 0, 1]))
    even = measure(strip([0, 0, np.tan(np.pi / 8), np.tan(np.pi / 8) + 1]))
    assert flat == pytest.approx(0)
    # Turned by 45 degrees at one edge: the difference of the normals is 2 sin(22.5 degrees), all of it at that edge.
    assert sharp == pytest.approx(2 * np.sin(np.pi / 8), rel=1e-6)
    assert even == pytest.approx(2 * np.sin(np.pi / 8) / 2, rel=1e-6)


@pytest.mark.parametrize("name", NORMAL_FILTERS)
def test_a_plane_stays_as_it_is(name: str) -> None:
    flat = grid_mesh(7)
    inner = (np.abs(flat.vertices[:, :2] - 3) < 2.5).all(axis=1)
    shifts = np.random.default_rng(0).uniform(-0.2, 0.2, (flat.n_vertices, 2)) * inner[:, None]
    uneven = flat.with_vertices(flat.vertices + np.column_stack([shifts, np.zeros(flat.n_vertices)]))
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    turned = uneven.with_vertices(uneven.vertices @ turn)
    np.testing.assert_allclose(filtered(turned, name), turned.vertices, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", NORMAL_FILTERS)
def test_a_noisy_cube_comes_closer_to_the_true_cube_than_by_plain_smoothing(name: str) -> None:
    cube = cube_mesh(12)
    noisy = add_noise(cube, 0.15, "normal", seed=1)

    def angle(vertices: np.ndarray) -> float:
        return mean_angular_difference(vertices, cube.vertices, cube.faces)

    found = angle(filtered(noisy, name))
    assert found < 0.4 * angle(noisy.vertices)
    assert found < 0.6 * min(angle(filtered(noisy, "laplacian", steps=steps)) for steps in range(1, 6))


def test_neighbours_are_the_faces_with_common_vertices_or_edges() -> None:
    book = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [4, 5, 6], [7, 8, 9], [0, 0, 1]])
    by_edge = {(int(a), int(b)) for a, b in zip(over_edges(book).first, over_edges(book).second, strict=True)}
    assert by_edge == {(0, 1), (0, 2), (1, 2), (0, 5), (1, 5), (2, 5)}
    by_vertex = around_vertices(book)
    assert {(int(a), int(b)) for a, b in zip(by_vertex.first, by_vertex.second, strict=True)} == by_edge | {(2, 3)}


def test_around_the_tip_of_a_cone_of_many_triangles_faces_are_neighbours_over_edges_only() -> None:
    n = MOST_FACES + 1
    rim = np.arange(n)
    cone = np.column_stack([np.zeros(n, dtype=int), 1 + rim, 1 + (rim + 1) % n])
    assert len(around_vertices(cone).first) == n
    assert len(around_vertices(cone[:-1]).first) == (n - 1) * (n - 2) // 2
