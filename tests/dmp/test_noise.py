from __future__ import annotations

import numpy as np
import pytest

from dmp.errors import MeshError, SettingsError
from dmp.geometry import mean_edge_length, vertex_normals
from dmp.mesh import FloatArray, TriangleMesh
from dmp.noise import NoiseKind, add_noise
from dmp.shapes.spheres import icosphere
from dmp.topology import adjacency, unique_edges

KINDS: tuple[NoiseKind, ...] = ("normal", "gaussian", "uniform", "impulsive", "scanner")


@pytest.fixture(scope="module")
def ball() -> TriangleMesh:
    """2,562 vertices, 300 times as large as the unit sphere and away from the origin."""
    sphere = icosphere(16)
    return sphere.with_vertices(300 * sphere.vertices + [1000, 0, 0]).with_attributes(quality=np.arange(sphere.n_vertices))


def offsets(clean: TriangleMesh, noisy: TriangleMesh) -> FloatArray:
    """Displacements in mean edge lengths of the clean mesh."""
    return (noisy.vertices - clean.vertices) / mean_edge_length(clean.vertices, unique_edges(clean.faces))


def neighbour_correlation(mesh: TriangleMesh, values: FloatArray) -> float:
    first, second = unique_edges(mesh.faces).T
    return float(np.corrcoef(values[first], values[second])[0, 1])


@pytest.mark.parametrize("kind", KINDS)
def test_only_positions_change_and_a_seed_repeats_them(ball: TriangleMesh, kind: NoiseKind) -> None:
    noisy = add_noise(ball, 0.3, kind, seed=5)
    assert noisy.same_connectivity(ball)
    assert noisy.vertex_attributes["quality"].tolist() == ball.vertex_attributes["quality"].tolist()
    assert np.array_equal(noisy.vertices, add_noise(ball, 0.3, kind, seed=5).vertices)
    assert not np.array_equal(noisy.vertices, add_noise(ball, 0.3, kind, seed=6).vertices)
    assert np.array_equal(add_noise(ball, 0.0, kind).vertices, ball.vertices)


@pytest.mark.parametrize("kind", KINDS)
def test_noise_grows_in_proportion_to_its_level(ball: TriangleMesh, kind: NoiseKind) -> None:
    weak, strong = (offsets(ball, add_noise(ball, level, kind)) for level in (0.1, 0.4))
    np.testing.assert_allclose(strong, 4 * weak, atol=1e-9)


def test_gaussian_noise_has_the_level_as_deviation_in_each_coordinate(ball: TriangleMesh) -> None:
    moved = offsets(ball, add_noise(ball, 0.2, "gaussian"))
    np.testing.assert_allclose(moved.std(axis=0), 0.2, rtol=0.06)
    assert np.abs(moved.mean(axis=0)).max() < 0.02
    assert np.abs(np.corrcoef(moved.T) - np.eye(3)).max() < 0.08
    # A normal distribution has 31.7 % of its values beyond one deviation, a uniform one 42.3 %.
    assert np.mean(np.abs(moved) > 0.2) == pytest.approx(0.317, abs=0.02)
    assert abs(neighbour_correlation(ball, moved[:, 0])) < 0.05


def test_normal_noise_stays_on_the_normals(ball: TriangleMesh) -> None:
    moved = offsets(ball, add_noise(ball, 0.2, "normal"))
    normals = vertex_normals(ball.vertices, ball.faces)
    along = (moved * normals).sum(axis=1)
    np.testing.assert_allclose(moved, along[:, None] * normals, atol=1e-9)
    assert along.std() == pytest.approx(0.2, rel=0.06)


def test_uniform_noise_fills_a_cube_of_the_same_deviation(ball: TriangleMesh) -> None:
    moved = offsets(ball, add_noise(ball, 0.2, "uniform"))
    np.testing.assert_allclose(moved.std(axis=0), 0.2, rtol=0.04)
    assert 0.99 * 0.2 * np.sqrt(3) < np.abs(moved).max() <= 0.2 * np.sqrt(3) + 1e-9


def test_impulsive_noise_hits_a_share_and_leaves_the_rest_exact(ball: TriangleMesh) -> None:
    noisy = add_noise(ball, 2.0, "impulsive", share=0.05)
    hit = (noisy.vertices != ball.vertices).any(axis=1)
    assert np.count_nonzero(hit) == round(0.05 * ball.n_vertices)
    assert offsets(ball, noisy)[hit].std() == pytest.approx(2.0, rel=0.12)


def test_scanner_noise_is_alike_among_neighbours_and_has_the_level_exactly(ball: TriangleMesh) -> None:
    normals = vertex_normals(ball.vertices, ball.faces)
    correlations = []
    for steps in (0, 2, 8):
        moved = offsets(ball, add_noise(ball, 0.25, "scanner", correlation_steps=steps))
        depth = (moved * normals).sum(axis=1)
        np.testing.assert_allclose(moved, depth[:, None] * normals, atol=1e-9)
        assert np.sqrt((depth**2).mean()) == pytest.approx(0.25, rel=1e-9)
        correlations.append(neighbour_correlation(ball, depth))
    assert abs(correlations[0]) < 0.05
    assert 0.5 < correlations[1] < correlations[2] < 1.0


def test_scanner_noise_is_the_average_its_formula_gives(ball: TriangleMesh) -> None:
    still = offsets(ball, add_noise(ball, 1.0, "scanner", view=(0, 0, 1), correlation_steps=0))[:, 2]
    once = offsets(ball, add_noise(ball, 1.0, "scanner", view=(0, 0, 1), correlation_steps=1))[:, 2]
    neighbours = adjacency(ball.faces, ball.n_vertices)
    rows = np.split(neighbours.indices, neighbours.indptr[1:-1])
    expected = np.array([0.5 * still[i] + 0.5 * still[row].mean() for i, row in enumerate(rows)])
    np.testing.assert_allclose(once, expected / np.sqrt((expected**2).mean()), atol=1e-9)


def test_scanner_noise_follows_the_view_of_any_length(ball: TriangleMesh) -> None:
    moved = offsets(ball, add_noise(ball, 0.2, "scanner", view=(0, 3, 4)))
    np.testing.assert_allclose(moved, (moved @ [0, 0.6, 0.8])[:, None] * [0, 0.6, 0.8], atol=1e-9)
    assert np.sqrt((moved**2).sum(axis=1).mean()) == pytest.approx(0.2, rel=1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"level": -0.1}, "level"),
        ({"level": float("nan")}, "level"),
        ({"kind": "salt"}, "normal, gaussian, uniform, impulsive, scanner"),
        ({"share": 0.0}, "share"),
        ({"share": 1.1}, "share"),
        ({"seed": -1}, "seed"),
        ({"view": (0, 0, 0)}, "view"),
        ({"view": (0, 1)}, "view"),
        ({"correlation_steps": -1}, "correlation"),
    ],
)
def test_values_outside_their_range_are_refused(ball: TriangleMesh, arguments: dict, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        add_noise(ball, **{"level": 0.2, **arguments})


def test_a_point_cloud_has_no_edge_length() -> None:
    with pytest.raises(MeshError, match="no faces"):
        add_noise(TriangleMesh(np.zeros((4, 3)), np.zeros((0, 3), dtype=int)), 0.2)
