from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmp.errors import NoSphereError
from dmp.geometry import mean_edge_length
from dmp.mesh import FloatArray, IntArray, TriangleMesh
from dmp.noise import add_noise
from dmp.problem import denoising
from dmp.settings import settings_for
from dmp.shapes.spheres import bumpy_sphere, icosphere
from dmp.smoothing import smooth
from dmp.spherical import spherical_embedding, spherical_smoothing
from dmp.topology import adjacency, unique_edges
from tests.meshes import grid_mesh


def _signed_volumes(places: FloatArray, faces: IntArray) -> FloatArray:
    return np.linalg.det(places[faces])


def _tube(around: int, along: int, period: bool = False) -> TriangleMesh:
    """A closed tube with cone-shaped ends; or, with ``period``, a torus without ends."""
    turns, rows = np.meshgrid(np.arange(around), np.arange(along))
    angles = 2 * np.pi * turns.ravel() / around
    if period:
        other = 2 * np.pi * rows.ravel() / along
        ring = 3.0 + np.cos(angles)
        vertices = np.column_stack([ring * np.cos(other), ring * np.sin(other), np.sin(angles)])
    else:
        vertices = np.column_stack([np.cos(angles), np.sin(angles), 2 * np.pi / around * rows.ravel()])
    a = np.arange(around * (along if period else along - 1))
    right, up = a // around * around + (a + 1) % around, (a + around) % (around * along)
    across = (right + around) % (around * along)
    faces = np.concatenate([np.c_[a, right, across], np.c_[a, across, up]])
    if not period:
        first, last = around * along, around * along + 1
        vertices = np.concatenate([vertices, [[0, 0, -0.5], [0, 0, vertices[-1, 2] + 0.5]]])
        start, end = np.arange(around), np.arange(around) + around * (along - 1)
        faces = np.concatenate(
            [
                faces,
                np.c_[np.full(around, first), np.roll(start, -1), start],
                np.c_[np.full(around, last), end, np.roll(end, -1)],
            ]
        )
    return TriangleMesh(vertices, faces)


def _bumpy() -> TriangleMesh:
    return add_noise(bumpy_sphere(10), 0.4, kind="gaussian", seed=3)


@pytest.mark.parametrize(
    "make", [lambda: icosphere(7), _bumpy, lambda: _tube(9, 30)], ids=["icosphere", "bumpy, noisy", "tube"]
)
def test_all_faces_look_outwards_on_one_sphere(make: object) -> None:
    mesh = make()  # type: ignore[operator]
    base = spherical_smoothing(mesh)
    centre = mesh.vertices.mean(axis=0)
    radii = np.linalg.norm(base - centre, axis=1)
    assert radii == pytest.approx(np.linalg.norm(mesh.vertices - centre, axis=1).mean())
    assert _signed_volumes(base - centre, mesh.faces).min() > 0
    # Once around and no more: the faces of a closed convex body inscribed in the sphere, so hardly less than its area.
    corners = base[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert 0.9 < area / (4 * np.pi * radii[0] ** 2) < 1.0


def test_each_vertex_lies_in_the_middle_of_its_neighbours() -> None:
    mesh = _bumpy()
    places = spherical_embedding(mesh.faces, mesh.n_vertices)
    matrix = adjacency(mesh.faces, mesh.n_vertices)
    middles = matrix @ places
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    assert np.linalg.norm(middles - places, axis=1).max() < 1e-3 * mean_edge_length(places, unique_edges(mesh.faces))
    assert places.mean(axis=0) == pytest.approx(0.0, abs=1e-10)


def test_no_place_nearby_on_the_sphere_has_shorter_edges() -> None:
    mesh = _bumpy()
    places = spherical_embedding(mesh.faces, mesh.n_vertices)
    edges = unique_edges(mesh.faces)

    def energy(positions: FloatArray) -> float:
        return float(((positions[edges[:, 0]] - positions[edges[:, 1]]) ** 2).sum())

    generator = np.random.default_rng(0)
    neighbours = adjacency(mesh.faces, mesh.n_vertices)
    for _ in range(20):
        shift = generator.standard_normal(places.shape)
        for _ in range(int(generator.integers(0, 20))):
            shift = (neighbours @ shift) / neighbours.sum(axis=1)[:, None]
        shift *= 0.02 / np.abs(shift).max()
        # Moves of the kind that would gather all vertices on one side are kept out, as the method does.
        moved = places + shift - places * (shift * places).sum(axis=1, keepdims=True)
        moved -= moved.mean(axis=0)
        moved /= np.linalg.norm(moved, axis=1, keepdims=True)
        assert energy(moved) > energy(places)


def test_a_sphere_is_left_almost_as_it_is() -> None:
    mesh = icosphere(8)
    assert np.linalg.norm(spherical_smoothing(mesh) - mesh.vertices, axis=1).max() < 0.03


def test_the_sphere_turns_moves_and_grows_with_the_mesh() -> None:
    mesh = _bumpy()
    turn = Rotation.random(random_state=1).as_matrix()
    moved = mesh.with_vertices(2.5 * mesh.vertices @ turn.T + [100.0, 0.0, -7.0])
    expected = 2.5 * spherical_smoothing(mesh) @ turn.T + [100.0, 0.0, -7.0]
    assert spherical_smoothing(moved) == pytest.approx(expected, abs=1e-9)


def test_a_mesh_turned_inside_out_gives_a_sphere_turned_inside_out() -> None:
    mesh = _bumpy()
    inverted = TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
    base = spherical_smoothing(inverted)
    assert _signed_volumes(base - mesh.vertices.mean(axis=0), inverted.faces).max() < 0
    assert np.abs(base - spherical_smoothing(mesh)).max() < 1e-2


def test_the_smallest_mesh_and_isolated_vertices(tetrahedron: TriangleMesh) -> None:
    vertices = np.concatenate([[[50.0, 0, 0]], tetrahedron.vertices, [[0.0, 70, 0]]])
    base = spherical_smoothing(TriangleMesh(vertices, np.concatenate([tetrahedron.faces + 1, [[0, 0, 5]]])))
    assert base == pytest.approx(vertices, abs=1e-9)


def test_places_repeat_bit_for_bit() -> None:
    mesh = _bumpy()
    assert np.array_equal(spherical_smoothing(mesh), spherical_smoothing(mesh))


def _glued(first: TriangleMesh, second: TriangleMesh, pairs: list[tuple[int, int]]) -> TriangleMesh:
    """Both meshes as one, with vertices of the second put in the place of those of the first."""
    number = np.arange(second.n_vertices) + first.n_vertices
    for left, right in pairs:
        number[right] = left
    faces = np.concatenate([first.faces, number[second.faces]])
    used, faces = np.unique(faces, return_inverse=True)
    vertices = np.concatenate([first.vertices, second.vertices])
    return TriangleMesh(vertices[used], faces.reshape(-1, 3))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: _tube(8, 12, period=True), "1 handle, as a ring"),
        (lambda: grid_mesh(4), "open: it has 12 boundary edges"),
        (lambda: TriangleMesh(icosphere(2).vertices, icosphere(2).faces[1:]), "open: it has 3 boundary edges"),
        (lambda: _glued(icosphere(2), icosphere(2), []), "2 separate pieces"),
        (lambda: _glued(icosphere(2), icosphere(2), [(0, 0)]), "at 1 vertex it has no definite inside"),
        # Euler's characteristic is that of a sphere here.
        (lambda: _glued(icosphere(3), icosphere(3), [(0, 0), (40, 40)]), "at 2 vertices it has no definite inside"),
        (lambda: _glued(icosphere(2), icosphere(2), [(0, 0), (1, 1)]), "1 edge where more than two faces meet"),
        (
            lambda: TriangleMesh(icosphere(2).vertices, np.vstack([icosphere(2).faces[:1, ::-1], icosphere(2).faces[1:]])),
            "disagree",
        ),
    ],
)
def test_what_is_no_sphere_is_refused_with_the_reason(make: object, words: str) -> None:
    mesh = make()  # type: ignore[operator]
    with pytest.raises(NoSphereError, match=words) as caught:
        smooth(mesh, "spherical")
    assert str(caught.value).lower().endswith("use the smoothing 'laplacian'.")
    assert "\n" not in str(caught.value)


def test_what_is_too_long_and_thin_is_refused_and_what_is_not_is_not() -> None:
    assert np.isfinite(spherical_smoothing(_tube(12, 80))).all()
    with pytest.raises(NoSphereError, match="too long and thin"):
        spherical_smoothing(_tube(6, 300))


def test_it_is_a_base_of_displacements_of_large_meshes_too() -> None:
    settings = settings_for("denoise", "paper", smoothing="spherical")
    mesh = icosphere(30)
    mesh = mesh.with_vertices(mesh.vertices * (1 + 0.3 * mesh.vertices[:, :1] ** 2))
    started = time.perf_counter()
    problem = denoising(mesh, settings)
    assert time.perf_counter() - started < 20
    assert np.linalg.norm(problem.base - mesh.vertices.mean(axis=0), axis=1).std() < 1e-9
    plain = denoising(mesh, replace(settings, smoothing="none"))
    assert np.array_equal(plain.base, mesh.vertices)
