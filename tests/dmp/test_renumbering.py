from __future__ import annotations

import numpy as np
import pytest

from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.noise import add_noise
from dmp.problem import denoising
from dmp.renumbering import inverse_of, locality_order
from dmp.settings import settings_for
from dmp.topology import adjacency
from tests.meshes import grid_mesh


def _shuffled(mesh: TriangleMesh, seed: int) -> tuple[TriangleMesh, np.ndarray]:
    """Return the mesh with its vertices in another order, and the old number of each."""
    order = np.random.default_rng(seed).permutation(mesh.n_vertices)
    return TriangleMesh(mesh.vertices[order], inverse_of(order)[mesh.faces]), order


def test_the_order_is_a_permutation_that_brings_neighbours_together() -> None:
    mesh, _ = _shuffled(grid_mesh(30, height=0.1), 0)
    neighbours = adjacency(mesh.faces, mesh.n_vertices)
    order = locality_order(neighbours)
    assert np.array_equal(np.sort(order), np.arange(mesh.n_vertices))
    assert np.array_equal(inverse_of(order)[order], np.arange(mesh.n_vertices))
    rows, columns = neighbours[order][:, order].nonzero()
    assert np.abs(rows - columns).max() < 4 * 31


def test_separate_pieces_and_lonely_vertices_are_kept() -> None:
    faces = np.array([[0, 4, 2], [1, 5, 7]])
    order = locality_order(adjacency(faces, 9))
    assert np.array_equal(np.sort(order), np.arange(9))


@pytest.mark.parametrize("seed", [1, 2])
def test_the_order_of_the_file_changes_a_result_no_more_than_a_seed_does(sphere: TriangleMesh, seed: int) -> None:
    noisy = add_noise(sphere, 0.3, seed=1)
    settings = settings_for("denoise", steps=120, snapshot_every=120, log_every=120, threads=1)

    def error(mesh: TriangleMesh, truth: TriangleMesh) -> float:
        *_, last = training_for(denoising(mesh, settings, truth), settings).steps()
        assert last.snapshot is not None
        return float(last.snapshot.metrics["vertex_error"])

    other, order = _shuffled(noisy, seed)
    truth = TriangleMesh(sphere.vertices[order], other.faces)
    # A result in the wrong order would be off by the size of the sphere, tens of edge lengths.
    assert error(other, truth) == pytest.approx(error(noisy, sphere), abs=0.05)
