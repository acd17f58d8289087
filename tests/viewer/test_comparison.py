"""What the prediction is compared with: the middle pane, the reference step, another run, a filter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dmp.problem import Problem, denoising
from dmp.settings import settings_for
from dmp_viewer.comparing import run_filter, run_tuned_filter
from dmp_viewer.model import Source, Workspace
from dmp_viewer.other_run import OtherRun
from tests.meshes import sphere_mesh
from tests.viewer.conftest import FakeRun


@pytest.fixture
def workspace(trained_run: FakeRun) -> Workspace:
    workspace = Workspace()
    workspace.open_run(trained_run, trained_run.problem, Source("scan", trained_run.problem.mesh), None)
    return workspace


def key(workspace: Workspace) -> tuple[str, int]:
    state = workspace.comparison.state()
    assert state is not None
    return state.key


def test_the_middle_pane_goes_round_what_it_can_show(workspace: Workspace) -> None:
    comparison = workspace.comparison
    assert comparison.choices() == ["smoothed", "truth"]
    comparison.set_reference(20)
    comparison.set_filtered("Taubin", "passes 10", workspace.problem.target)  # type: ignore[union-attr]
    assert key(workspace) == ("filter", 1)
    seen = []
    for _ in comparison.choices():
        comparison.show_next()
        seen.append(comparison.shown)
    assert seen == ["smoothed", "truth", "step", "filter"]


def test_distances_from_a_reference_step(workspace: Workspace, trained_run: FakeRun) -> None:
    assert not workspace.colors.can_show("step")
    workspace.comparison.set_reference(10)
    workspace.colors.set(quantity="step")
    workspace.show_step(30)
    values = workspace.colors.values(workspace.predicted_state())  # type: ignore[arg-type]
    moved = trained_run.snapshots[30].vertices - trained_run.snapshots[10].vertices
    assert values == pytest.approx(np.linalg.norm(moved, axis=1), rel=1e-5)
    workspace.show_step(10)
    assert workspace.colors.values(workspace.predicted_state()) is None  # type: ignore[arg-type]
    workspace.comparison.set_reference(20)
    workspace.show_step(30)
    values = workspace.colors.values(workspace.predicted_state())  # type: ignore[arg-type]
    moved = trained_run.snapshots[30].vertices - trained_run.snapshots[20].vertices
    assert values == pytest.approx(np.linalg.norm(moved, axis=1), rel=1e-5)


def test_another_run_is_shown_at_its_kept_or_suggested_step(problem: Problem) -> None:
    run = FakeRun(problem)
    list(run.records())
    assert OtherRun(run).shown_step == 20  # where the fake held-out error is lowest
    run.kept_step = 30
    other = OtherRun(run)
    assert other.shown_step == 30
    assert other.show_beside(5)
    assert other.shown_step == 40
    assert not other.show_beside(1)
    assert other.show_step(12)
    assert other.snapshot() is run.snapshots[10]
    assert [mark.name for mark in other.marks()] == ["kept", "suggested", "best"]


def test_another_run_goes_with_the_mesh_and_stays_with_a_new_training(
    workspace: Workspace, problem: Problem, trained_run: FakeRun
) -> None:
    workspace.comparison.set_other(OtherRun(trained_run))
    assert key(workspace) == ("run", 20)
    new = FakeRun(problem, run_id="new")
    workspace.begin_run(new, problem, "CPU")
    assert workspace.comparison.other is not None
    sphere = sphere_mesh(2)
    workspace.begin_run(FakeRun(problem, run_id="third"), denoising(sphere, settings_for()), "CPU")
    assert workspace.comparison.other is None
    assert key(workspace) == ("smoothed", 0)


def test_the_steps_of_a_run_are_forgotten_with_it(workspace: Workspace, problem: Problem) -> None:
    workspace.comparison.set_reference(20)
    workspace.comparison.show("step")
    workspace.begin_run(FakeRun(problem, run_id="new"), problem, "CPU")
    assert workspace.comparison.reference_step is None
    assert key(workspace) == ("smoothed", 0)


def test_flip_swipe_and_lens_show_the_input_or_the_middle_pane(workspace: Workspace) -> None:
    state = workspace.comparison.compared_state()
    assert state is not None
    assert state.key == ("input", 0)
    workspace.comparison.show("truth")
    workspace.comparison.set_against_middle(True)
    state = workspace.comparison.compared_state()
    assert state is not None
    assert state.key == ("truth", 0)


def test_a_filter_tells_its_parameters_and_its_mad_is_measured(workspace: Workspace, problem: Problem) -> None:
    result = run_filter(problem, "laplacian", {"steps": 3})
    assert result.details == "steps 3, share 1"
    workspace.comparison.set_filtered(result.title, result.details, result.positions)
    state = workspace.comparison.state()
    assert state is not None
    assert problem.ground_truth is not None
    assert workspace.mad_of(state) == pytest.approx(problem.ground_truth.measures(result.positions)["mad"])


def test_the_best_parameters_are_found_by_the_ground_truth_only(problem: Problem) -> None:
    best, usual = run_tuned_filter(problem, "laplacian"), run_filter(problem, "laplacian", {})
    assert problem.ground_truth is not None
    mads = [problem.ground_truth.measures(result.positions)["mad"] for result in (best, usual)]
    assert mads[0] <= mads[1]
    assert best.details.startswith("tuned by truth: steps ")
    without = denoising(problem.mesh, settings_for())
    with pytest.raises(Exception, match="only be found with a ground truth"):
        run_tuned_filter(without, "laplacian")


def test_a_run_of_another_mesh_is_refused(problem: Problem, tmp_path: Path) -> None:
    from dmp.errors import RunError
    from dmp.runs import Run
    from dmp_viewer.comparing import comparable_runs, open_other

    other = denoising(sphere_mesh(2), settings_for())
    Run.create(other, settings_for(), folder=tmp_path / "other")
    Run.create(problem, settings_for(), folder=tmp_path / "empty")
    with pytest.raises(RunError, match="trained on another mesh"):
        open_other(tmp_path / "other", problem)
    with pytest.raises(RunError, match="no snapshots yet"):
        open_other(tmp_path / "empty", problem)
    assert comparable_runs(tmp_path, problem, None) == []
