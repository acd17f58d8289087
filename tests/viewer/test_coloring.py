"""The colours of the workspace: which range, whose values, and how they are spread."""

from __future__ import annotations

import numpy as np
import pytest

from dmp.problem import Problem, denoising
from dmp.settings import settings_for
from dmp_viewer.colors import Limits
from dmp_viewer.model import Source, Workspace
from tests.viewer.conftest import FakeRun


@pytest.fixture
def workspace(trained_run: FakeRun) -> Workspace:
    workspace = Workspace()
    workspace.open_run(trained_run, trained_run.problem, Source("scan", trained_run.problem.mesh), None)
    return workspace


def test_a_locked_range_stays_where_it_is(workspace: Workspace) -> None:
    workspace.show_step(20)
    workspace.colors.set(quantity="input_distance")
    before = workspace.colors.limits()
    workspace.colors.set(range="locked")
    workspace.show_step(0)
    assert workspace.colors.limits() == before
    workspace.colors.set(range="step")
    assert workspace.colors.limits().high > 1.5 * before.high


def test_each_quantity_is_locked_where_it_is_first_seen(workspace: Workspace) -> None:
    workspace.colors.set(range="locked")
    displacement = workspace.colors.limits()
    workspace.colors.set(quantity="curvature")
    curvature = workspace.colors.limits()
    assert curvature != displacement
    workspace.show_step(0)
    assert workspace.colors.limits() == curvature
    workspace.colors.set(quantity="magnitude")
    assert workspace.colors.limits() == displacement


def test_a_typed_range_is_locked(workspace: Workspace) -> None:
    workspace.colors.lock(Limits(0.25, 0.5))
    assert workspace.colors.policy.range == "locked"
    assert workspace.colors.limits() == Limits(0.25, 0.5)
    workspace.colors.set(range="step")
    assert workspace.colors.limits().low == 0


def test_outliers_are_covered_only_when_wanted(workspace: Workspace) -> None:
    values = workspace.colors.values(workspace.input_state())  # type: ignore[arg-type]
    assert values is not None
    assert workspace.colors.limits().high < values.max()
    workspace.colors.set(outliers=True)
    assert workspace.colors.limits().high == pytest.approx(values.max())


def test_values_are_measured_once_for_a_state(workspace: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    from dmp_viewer.ruler import Ruler

    measured = []
    original = Ruler.values
    monkeypatch.setattr(Ruler, "values", lambda self, positions: measured.append(1) or original(self, positions))
    workspace.show_step(10)
    for _ in range(3):
        workspace.colors.limits()
        workspace.colors.values(workspace.predicted_state())  # type: ignore[arg-type]
    assert len(measured) == 2  # the input and the shown step


def test_the_histogram_is_of_the_prediction_beside_the_input(workspace: Workspace) -> None:
    workspace.show_step(0)
    states = [workspace.input_state(), workspace.predicted_state()]
    found = workspace.colors.histogram([state for state in states if state is not None])
    assert found is not None
    assert found.counts[0] == 258  # at step 0 the fake prediction is the smoothed mesh itself
    assert found.others is not None
    assert 0.95 * 258 <= found.others.sum() <= 258


def test_what_cannot_be_shown_falls_back_to_the_displacement(workspace: Workspace, problem: Problem) -> None:
    workspace.colors.set(quantity="normal_error")
    assert workspace.colors.quantity == "normal_error"
    assert workspace.colors.unit == (1.0, "degrees")
    workspace.open_problem(denoising(problem.mesh, settings_for()), Source("scan", problem.mesh))
    assert workspace.colors.quantity == "magnitude"
    assert workspace.colors.policy.quantity == "normal_error"


def test_units_are_those_of_the_mesh(workspace: Workspace) -> None:
    problem = workspace.problem
    assert problem is not None
    workspace.colors.set(unit="diagonal")
    diagonal = np.linalg.norm(problem.mesh.vertices.max(axis=0) - problem.mesh.vertices.min(axis=0))
    assert workspace.colors.unit == (pytest.approx(100 / diagonal), "% of diagonal")
    workspace.colors.set(unit="edges", quantity="curvature")
    assert workspace.colors.unit == (pytest.approx(problem.edge_length), "per edge length")


def test_a_late_extent_of_another_quantity_is_not_taken(workspace: Workspace) -> None:
    workspace.colors.set(range="run")
    stale = workspace.colors.ruler()
    workspace.colors.set(quantity="curvature")
    workspace.colors.ruler()
    workspace.colors.set_extent(stale, 98.0, 30, 1e9)
    assert workspace.colors.limits().high < 1e6
    assert 30 in workspace.colors.steps_to_measure()
