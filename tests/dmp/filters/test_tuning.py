from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dmp import meshlab
from dmp.errors import MeshError, SettingsError
from dmp.filters import FILTERS, best_tuned, filtered, tuned
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh
from dmp.metrics import GroundTruth
from dmp.noise import add_noise
from tests.meshes import grid_mesh

OWN = [name for name, chosen in FILTERS.items() if not chosen.needs_meshlab]


@pytest.fixture(scope="module")
def roof() -> TriangleMesh:
    """A sheet folded at a right angle."""
    sheet = grid_mesh(7)
    return sheet.with_vertices(np.column_stack([sheet.vertices[:, :2], -np.abs(sheet.vertices[:, 0] - 3)]))


@pytest.mark.parametrize("measure", ["mad", "vertex_error"])
@pytest.mark.parametrize("name", OWN)
def test_tuned_is_never_worse_than_the_default_or_the_input(roof: TriangleMesh, name: str, measure: str) -> None:
    noisy = add_noise(roof, 0.2, seed=3)
    truth = GroundTruth.for_input(roof, noisy)
    found = tuned(noisy, truth, name, measure=measure)
    assert truth.measures(found.vertices) == {"mad": found.mad, "vertex_error": found.vertex_error}
    reached = getattr(found, measure)
    assert reached < truth.measures(noisy.vertices)[measure]
    assert reached <= truth.measures(filtered(noisy, name))[measure]
    # The parameters alone repeat the result.
    np.testing.assert_array_equal(filtered(noisy, name, **found.parameters), found.vertices)
    assert found.n_tried >= len(FILTERS[name].count.grid)


def test_a_clean_mesh_is_best_left_alone(roof: TriangleMesh) -> None:
    found = tuned(roof, GroundTruth.for_input(roof, roof), "laplacian", measure="vertex_error")
    assert found.parameters["steps"] == 0
    assert found.vertex_error == pytest.approx(0, abs=1e-12)


def test_the_search_finds_what_trying_every_combination_finds(roof: TriangleMesh) -> None:
    noisy = add_noise(roof, 0.25, seed=4)
    truth = GroundTruth.for_input(roof, noisy)
    steps, share = FILTERS["laplacian"].parameters
    every = [truth.mad(filtered(noisy, "laplacian", steps=n, share=part)) for n in steps.grid for part in share.grid]
    assert tuned(noisy, truth, "laplacian").mad == min(every)


def test_the_best_filter_comes_first(roof: TriangleMesh) -> None:
    noisy = add_noise(roof, 0.15, "normal", seed=5)
    truth = GroundTruth.for_input(roof, noisy)
    found = best_tuned(noisy, truth, ["laplacian", "taubin", "bilateral_normal"])
    assert {result.name for result in found} == {"laplacian", "taubin", "bilateral_normal"}
    assert [result.mad for result in found] == sorted(result.mad for result in found)


def test_without_meshlab_its_filters_are_left_out_unless_named(roof: TriangleMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object, **__: object) -> None:
        raise MeshError("MeshLab cannot be used here.")

    monkeypatch.setattr(meshlab, "run_filters", missing)
    small = add_noise(grid_mesh(3), 0.1)
    truth = GroundTruth.for_input(grid_mesh(3), small)
    assert {result.name for result in best_tuned(small, truth)} == set(OWN)
    with pytest.raises(MeshError, match="cannot be used"):
        best_tuned(small, truth, ["two_step"])


def test_an_unknown_measure_is_refused(roof: TriangleMesh) -> None:
    with pytest.raises(SettingsError, match="mad or vertex_error, not by 'beauty'"):
        tuned(roof, GroundTruth.for_input(roof, roof), "laplacian", measure="beauty")


@pytest.mark.shared_meshes
@pytest.mark.parametrize(("name", "mad"), [("bumpy", 6.168), ("sheep", 11.725)])
def test_taubin_with_the_usual_factors_reaches_its_known_angles(shared_meshes: Path, name: str, mad: float) -> None:
    noisy = read_mesh(shared_meshes / name / "noisy.obj")
    truth = GroundTruth.for_input(read_mesh(shared_meshes / name / "ground_truth.obj"), noisy)
    best = {"bumpy": 24, "sheep": 8}[name]
    assert truth.mad(filtered(noisy, "taubin", passes=best)) == pytest.approx(mad, abs=0.001)
    assert tuned(noisy, truth, "taubin").mad <= mad
