from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.noise import add_noise
from dmp.problem import denoising
from dmp.renumbering import inverse_of, locality_order, renumbered
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


def test_a_renumbered_matrix_has_its_entries_in_their_new_places() -> None:
    generator = np.random.default_rng(3)
    dense = generator.normal(size=(7, 7)) * (generator.random((7, 7)) < 0.4)
    order = generator.permutation(7)
    found = renumbered(sparse.csr_array(dense), order)
    assert np.array_equal(found.toarray(), dense[np.ix_(order, order)])
    assert found.has_sorted_indices


def test_separate_pieces_and_lonely_vertices_are_kept() -> None:
    faces = np.array([[0, 4, 2], [1, 5, 7]])
    order = locality_order(adjacency(faces, 9))
    assert np.array_equal(np.sort(order), np.arange(9))


def test_the_order_of_the_file_changes_a_result_no_more_than_a_seed_does(sphere: TriangleMesh) -> None:
    noisy = add_noise(sphere, 0.3, seed=1)
    settings = settings_for("denoise", steps=80, snapshot_every=80, log_every=80, threads=1)

    def error(mesh: TriangleMesh, truth: TriangleMesh) -> float:
        *_, last = training_for(denoising(mesh, settings, truth), settings).steps()
        assert last.snapshot is not None
        return float(last.snapshot.metrics["vertex_error"])

    other, order = _shuffled(noisy, 1)
    truth = TriangleMesh(sphere.vertices[order], other.faces)
    # A result in the wrong order would be off by the size of the sphere, tens of edge lengths.
    assert error(other, truth) == pytest.approx(error(noisy, sphere), abs=0.05)
