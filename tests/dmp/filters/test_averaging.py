from __future__ import annotations

import numpy as np
import pytest

from dmp import meshlab
from dmp.filters import filtered
from dmp.mesh import FloatArray, TriangleMesh
from tests.dmp.filters.plain_loops import laplacian_step
from tests.meshes import grid_mesh


@pytest.mark.parametrize("share", [1.0, 0.4])
def test_laplacian_steps_are_those_of_a_loop(share: float) -> None:
    mesh = grid_mesh(6, height=0.4)
    expected = mesh.vertices
    for _ in range(3):
        expected = laplacian_step(expected, mesh.faces, share)
    np.testing.assert_allclose(filtered(mesh, "laplacian", steps=3, share=share), expected, atol=1e-12)


def test_taubin_passes_are_those_of_a_loop() -> None:
    mesh = grid_mesh(6, height=0.4)
    expected = mesh.vertices
    for _ in range(4):
        expected = laplacian_step(laplacian_step(expected, mesh.faces, 0.3), mesh.faces, -0.34)
    np.testing.assert_allclose(filtered(mesh, "taubin", passes=4, shrink=0.3, inflate=0.34), expected, atol=1e-12)


def test_taubin_is_that_of_meshlab_on_a_closed_mesh(noisy_sphere: TriangleMesh) -> None:
    steps: meshlab.Filter = ("apply_coord_taubin_smoothing", {"lambda_": 0.5, "mu": -0.53, "stepsmoothnum": 5})
    theirs = meshlab.run_filters(noisy_sphere, [steps])[0]
    # Its factors are float32.
    np.testing.assert_allclose(filtered(noisy_sphere, "taubin", passes=5), theirs, rtol=0, atol=1e-7)


def test_the_laplacian_shrinks_a_sphere_and_taubin_keeps_its_size(sphere: TriangleMesh) -> None:
    def radius(vertices: FloatArray) -> float:
        return float(np.linalg.norm(vertices, axis=1).mean())

    assert radius(filtered(sphere, "laplacian", steps=10)) < 0.9
    assert radius(filtered(sphere, "taubin", passes=10)) == pytest.approx(1, abs=0.01)
