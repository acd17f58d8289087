"""What is measured of a mesh, vertex by vertex, and of which states there is nothing to measure."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from dmp.mesh import TriangleMesh
from dmp.metrics import mean_angular_difference
from dmp.problem import Problem, denoising
from dmp.settings import settings_for
from dmp_viewer import tasks
from dmp_viewer.colors import QUANTITIES, Quantity
from dmp_viewer.ruler import MeshState, Ruler, Surface, can_measure, direction_colors
from tests.viewer.conftest import quick_settings


def lengths(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt((vectors**2).sum(axis=1))


def test_every_quantity_is_listed_once() -> None:
    assert set(QUANTITIES) == set(get_args(Quantity))
    assert len({spec.label for spec in QUANTITIES.values()}) == len(QUANTITIES)


@pytest.mark.parametrize("quantity", ["magnitude", "input_distance", "error", "step"])
def test_distances_are_from_what_their_name_says(problem: Problem, sphere: TriangleMesh, quantity: Quantity) -> None:
    positions = 1.1 * problem.target
    assert problem.ground_truth is not None
    origin = {
        "magnitude": problem.base,
        "input_distance": problem.target,
        "error": problem.ground_truth.mesh.vertices,
        "step": sphere.vertices,
    }[quantity]
    values = Ruler(quantity, Surface(problem), sphere.vertices).values(positions)
    assert values == pytest.approx(lengths(positions - origin), rel=1e-5)


def test_the_error_of_the_angle_averages_to_the_mad(problem: Problem) -> None:
    values = Ruler("normal_error", Surface(problem)).values(problem.target)
    counts = np.bincount(problem.mesh.faces.ravel())
    assert problem.ground_truth is not None
    mad = mean_angular_difference(problem.target, problem.ground_truth.mesh.vertices, problem.mesh.faces)
    assert np.average(values, weights=counts) == pytest.approx(mad, rel=1e-5)


def test_a_grown_sphere_is_displaced_outwards_and_bends_less(sphere: TriangleMesh) -> None:
    surface = Surface(denoising(sphere, settings_for()))
    signed = Ruler("signed", surface).values(surface.problem.base + 0.2 * surface.base_normals)
    assert signed == pytest.approx(np.full(258, 0.2), rel=1e-5)
    curvature = Ruler("curvature", surface)
    assert curvature.values(2 * sphere.vertices) == pytest.approx(curvature.values(sphere.vertices) / 2, rel=1e-5)


@pytest.mark.parametrize(
    ("quantity", "kind"),
    [("magnitude", "smoothed"), ("signed", "smoothed"), ("input_distance", "input"), ("error", "truth"), ("step", "step")],
)
def test_what_is_measured_from_has_nothing_to_show(problem: Problem, quantity: Quantity, kind: str) -> None:
    ruler = Ruler(quantity, Surface(problem), problem.target)
    for other in ("input", "smoothed", "truth", "step", "run", "filter"):
        state = MeshState(other, 10, problem.target)  # type: ignore[arg-type]
        assert ruler.is_zero_for(state, reference_step=10) is (other == kind)
    assert not ruler.is_zero_for(MeshState("step", 20, problem.target), reference_step=10)


def test_what_can_be_measured_depends_on_what_is_there(problem: Problem) -> None:
    without = denoising(problem.mesh, settings_for())
    assert {quantity for quantity in QUANTITIES if not can_measure(quantity, without, None)} == {
        "error", "normal_error", "step",
    }  # fmt: skip
    assert all(can_measure(quantity, problem, problem.target) for quantity in QUANTITIES)


def test_only_inserted_vertices_can_be_wrong_in_a_completion(sheet_file: Path, tmp_path: Path) -> None:
    from dmp.meshio import write_mesh
    from tests.meshes import grid_mesh

    truth = grid_mesh(24)
    write_mesh(tmp_path / "truth.ply", truth.with_vertices(truth.vertices + np.array([0, 0, 0.5])))
    problem = tasks.open_mesh(sheet_file, tmp_path / "truth.ply", quick_settings(task="complete", hold_out=0.0)).problem
    values = Ruler("error", Surface(problem)).values(problem.target)
    assert np.isnan(values[problem.known]).all()
    assert values[~problem.known] == pytest.approx(np.full((~problem.known).sum(), 0.5), rel=1e-4)
    assert not can_measure("normal_error", problem, None)


def test_directions_are_colours_of_the_axes() -> None:
    colors = direction_colors(np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, 1]]))
    assert colors.tolist() == [[255, 127, 127], [127, 0, 127], [127, 127, 255]]
