"""Whatever a mesh is like, both methods give finite positions for it, and leave alone what belongs to no surface."""

from __future__ import annotations

import numpy as np
import pytest

from dmp.completion import problem_for
from dmp.errors import MeshError
from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.problem import denoising
from dmp.settings import Settings, settings_for
from dmp.snapshot import StepRecord
from dmp.topology import connected_vertices
from tests.odd_meshes import ODD_MESHES, isolated_vertices, with_a_holed_sheet


def _settings(task: str, preset: str, **changes: object) -> Settings:
    quick = {"steps": 2, "snapshot_every": 1, "log_every": 1, "threads": 1, **changes}
    if preset == "best" and task == "denoise":
        quick |= {"bilateral_layers": 2}
    return settings_for(task, preset, **quick)


def _trained(mesh: TriangleMesh, settings: Settings, truth: TriangleMesh | None = None) -> StepRecord:
    *_, last = training_for(problem_for(mesh, settings, truth), settings).steps()
    return last


@pytest.mark.filterwarnings("ignore:The given NumPy array is not writable")
@pytest.mark.parametrize("preset", ["compact", "best"])
@pytest.mark.parametrize("task", ["denoise", "complete"])
@pytest.mark.parametrize("name", ODD_MESHES)
def test_every_mesh_is_trained_on(name: str, task: str, preset: str) -> None:
    mesh = ODD_MESHES[name]()
    if task == "complete":
        mesh = with_a_holed_sheet(mesh)
    settings = _settings(task, preset)
    problem = problem_for(mesh, settings)
    *_, last = training_for(problem, settings).steps()
    assert last.step == 2
    assert last.snapshot is not None
    result = last.snapshot.vertices
    assert result.shape == problem.mesh.vertices.shape
    assert np.isfinite(result).all()
    assert np.isfinite(list(last.metrics.values())).all()
    connected = connected_vertices(problem.mesh.faces, problem.mesh.n_vertices)
    assert np.array_equal(result[~connected], problem.target[~connected])
    # Two steps leave a mesh about as large as it was, wherever and however large it is.
    size = np.ptp(problem.target[connected], axis=0).max()
    assert np.abs(result - problem.target)[connected].max() < 2 * size


@pytest.mark.parametrize("preset", ["compact", "best"])
def test_isolated_vertices_change_nothing_for_the_others(preset: str) -> None:
    whole = isolated_vertices()
    connected = connected_vertices(whole.faces, whole.n_vertices)
    part = TriangleMesh(whole.vertices[connected], (np.cumsum(connected) - 1)[whole.faces])
    truth = part.with_vertices(part.vertices / np.linalg.norm(part.vertices, axis=1, keepdims=True))
    whole_truth = whole.vertices.copy()
    whole_truth[connected] = truth.vertices
    settings = _settings("denoise", preset)
    left, right = _trained(whole, settings, whole.with_vertices(whole_truth)), _trained(part, settings, truth)
    assert left.snapshot is not None and right.snapshot is not None
    assert np.array_equal(left.snapshot.vertices[connected], right.snapshot.vertices)
    assert np.array_equal(left.snapshot.vertices[~connected], whole.vertices[~connected])
    # Means over arrays of another length may differ in their last digit.
    assert left.metrics == pytest.approx(right.metrics, rel=1e-12)


def test_a_part_of_a_problem_keeps_scale_and_place() -> None:
    problem = denoising(isolated_vertices(), settings_for("denoise"))
    part = problem.trainable_part()
    assert part.mesh.n_vertices == problem.mesh.n_vertices - 3
    assert part.unit == problem.unit
    assert np.array_equal(part.origin, problem.origin)
    # The origin is that of the surface: the vertex 1e9 away does not count.
    assert np.abs(part.to_training_units(part.target)).max() < 10
    assert np.array_equal(part.placed(part.target), problem.target)
    assert part.trainable_part() is part
    whole = denoising(ODD_MESHES["a ball"](), settings_for("denoise"))
    assert whole.trainable_part() is whole
    assert whole.placed(whole.target) is whole.target


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (TriangleMesh(np.eye(3), np.array([[0, 0, 1], [1, 1, 1]])), "three different corners"),
        (TriangleMesh(np.ones((4, 3)), np.array([[0, 1, 2]])), "units large"),
        (TriangleMesh(np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2], [5, 0, 0]]), np.array([[0, 1, 2]])), "no area"),
    ],
)
def test_what_has_no_surface_is_refused(mesh: TriangleMesh, words: str) -> None:
    with pytest.raises(MeshError, match=words):
        denoising(mesh, settings_for("denoise"))
