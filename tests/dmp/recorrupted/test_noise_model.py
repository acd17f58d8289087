from __future__ import annotations

import numpy as np
import pytest
import torch

from dmp.geometry import vertex_normals
from dmp.mesh import TriangleMesh
from dmp.recorrupted.noise_model import NoiseModel, estimate_evenness, estimate_noise, gain_of_estimate, standard_draws
from dmp.recorrupted.outliers import find_outliers, replaced
from tests.meshes import sphere_mesh


def solid_cube(n: int) -> TriangleMesh:
    """The surface of a cube with n x n squares of side 1 on each of its sides."""
    corners: dict[tuple[int, ...], int] = {}
    faces = []
    for axis, far in ((axis, far) for axis in range(3) for far in (0, 1)):
        for i, j in ((i, j) for i in range(n) for j in range(n)):
            square = []
            for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                place = [0, 0, 0]
                place[axis], place[(axis + 1) % 3], place[(axis + 2) % 3] = n * far, i + a, j + b
                square.append(corners.setdefault(tuple(place), len(corners)))
            a, b, c, d = square if far else square[::-1]
            faces += [[a, b, c], [a, c, d]]
    return TriangleMesh(np.array(list(corners), dtype=float), np.array(faces))


@pytest.fixture(scope="module")
def ball() -> TriangleMesh:
    """A sphere with 4098 vertices and mean edge length 1, so that noise is in edge lengths."""
    mesh = sphere_mesh(5)
    lengths = np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)
    return mesh.with_vertices(mesh.vertices / lengths.mean())


@pytest.mark.parametrize("level", [0.1, 0.2, 0.4])
def test_level_of_isotropic_noise_is_found(ball: TriangleMesh, level: float) -> None:
    noise = level * np.random.default_rng(1).standard_normal(ball.vertices.shape)
    found = estimate_noise(ball.vertices + noise, ball.faces)
    assert found.level == pytest.approx(level, rel=0.1)
    assert found.tangential > 0.8


def test_level_of_uniform_noise_is_found(ball: TriangleMesh) -> None:
    noise = np.random.default_rng(1).uniform(-0.35, 0.35, ball.vertices.shape)
    assert estimate_noise(ball.vertices + noise, ball.faces).level == pytest.approx(0.35 / np.sqrt(3), rel=0.1)


def test_noise_along_the_normal_is_told_from_isotropic_noise(ball: TriangleMesh) -> None:
    heights = 0.2 * np.random.default_rng(1).standard_normal((ball.n_vertices, 1))
    found = estimate_noise(ball.vertices + heights * vertex_normals(ball.vertices, ball.faces), ball.faces)
    assert found.level == pytest.approx(0.2, rel=0.1)
    assert found.tangential < 0.6


def test_a_clean_shape_has_hardly_any(ball: TriangleMesh) -> None:
    assert estimate_noise(ball.vertices, ball.faces).level < 0.01


def test_the_corners_and_edges_of_a_clean_cube_are_not_noise() -> None:
    """Most of its vertices lie on flat sides, and the rest is shape."""
    cube = solid_cube(20)
    assert estimate_noise(cube.vertices, cube.faces).level < 1e-6
    assert not find_outliers(cube.vertices, cube.faces).any()


@pytest.mark.parametrize(("share", "level"), [(0.2, 1.0), (0.1, 1.5), (0.3, 0.5)])
def test_impulsive_noise_is_found_and_put_right(ball: TriangleMesh, share: float, level: float) -> None:
    generator = np.random.default_rng(4)
    hit = generator.random(ball.n_vertices) < share
    noisy = ball.vertices + hit[:, None] * level * generator.standard_normal(ball.vertices.shape)
    found = find_outliers(noisy, ball.faces)
    assert abs(found.mean() - share) < 0.25 * share
    repaired = replaced(noisy, ball.faces, found)
    assert np.array_equal(repaired[~found], noisy[~found])
    error = np.linalg.norm(repaired - ball.vertices, axis=1).mean()
    assert error < 0.3 * np.linalg.norm(noisy - ball.vertices, axis=1).mean()
    assert estimate_noise(repaired, ball.faces).level < 0.03


@pytest.mark.parametrize("level", [0.0, 0.1, 0.3, 0.6])
def test_noise_everywhere_is_not_impulsive(ball: TriangleMesh, level: float) -> None:
    generator = np.random.default_rng(5)
    assert not find_outliers(ball.vertices + level * generator.standard_normal(ball.vertices.shape), ball.faces).any()
    assert not find_outliers(ball.vertices + level * generator.uniform(-1, 1, ball.vertices.shape), ball.faces).any()


def test_the_noise_is_told_in_words(ball: TriangleMesh) -> None:
    noise = 0.2 * np.random.default_rng(7).standard_normal(ball.vertices.shape)
    assert estimate_noise(ball.vertices + noise, ball.faces).words() == "noise about 0.20 edge lengths, in all directions"
    assert estimate_noise(ball.vertices, ball.faces).words().startswith("no noise")


def test_little_noise_is_not_mistaken_for_the_edges_of_a_cube() -> None:
    cube = solid_cube(24)
    noise = 0.05 * np.random.default_rng(8).standard_normal(cube.vertices.shape)
    assert estimate_noise(cube.vertices + noise, cube.faces).level == pytest.approx(0.05, rel=0.35)


def test_uniform_noise_is_told_from_normal_noise(ball: TriangleMesh) -> None:
    normals = vertex_normals(ball.vertices, ball.faces)
    generator = np.random.default_rng(3)

    def evenness(noise: np.ndarray) -> float:
        return estimate_evenness(0.2 * (noise * normals).sum(axis=1), normals)

    shape = ball.vertices.shape
    uniform, normal = np.sqrt(3) * generator.uniform(-1, 1, shape), generator.standard_normal(shape)
    assert evenness(uniform) > 0.75
    assert evenness(normal) == 0.0
    assert 0.3 < evenness(np.sqrt(0.6) * uniform + np.sqrt(0.4) * normal) < 0.85
    # Heavy tails are what errors at sharp edges look like.
    assert evenness(generator.standard_t(4, shape)) == 0.0
    assert estimate_evenness(np.zeros(len(normals)), normals) == 0.0


def test_draws_have_mean_zero_and_variance_one() -> None:
    for evenness in (0.0, 0.5, 1.0):
        draws = standard_draws(200_000, evenness, torch.Generator().manual_seed(1)).numpy()
        assert np.abs(draws.mean(axis=0)).max() < 0.01
        assert np.abs(draws.var(axis=0) - 1).max() < 0.01
        # Of independent values the fourth cumulants add; a uniform one has -1.2, weighted by the square of its variance.
        assert (draws**4).mean() - 3 == pytest.approx(-1.2 * evenness**2, abs=0.03)


@pytest.mark.parametrize(("tangential", "evenness"), [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])
def test_what_the_estimate_misses_is_found_by_trying(ball: TriangleMesh, tangential: float, evenness: float) -> None:
    level, normals = 0.4, vertex_normals(ball.vertices, ball.faces)
    assumed = NoiseModel(level, tangential, normals, evenness)
    gain = gain_of_estimate(ball.vertices, ball.faces, assumed)
    found = []
    for seed in range(5, 9):
        draws = standard_draws(ball.n_vertices, evenness, torch.Generator().manual_seed(seed)).numpy().astype(float)
        along = (draws * normals).sum(axis=1, keepdims=True) * normals
        noisy = ball.vertices + level * (along + tangential * (draws - along))
        found.append(estimate_noise(noisy, ball.faces).level)
    assert np.mean(found) / gain == pytest.approx(level, rel=0.025)
