"""The workspace without a window: what is shown, followed, kept and coloured."""

from __future__ import annotations

import numpy as np
import pytest

from dmp.problem import Problem, denoising
from dmp.settings import settings_for
from dmp.snapshot import Snapshot
from dmp.vertex_measures import extent
from dmp_viewer.model import Source, Workspace
from dmp_viewer.ruler import MeshState
from dmp_viewer.snapshot_cache import SnapshotCache
from dmp_viewer.states import RunnerState
from tests.viewer.conftest import FakeRun


@pytest.fixture
def workspace(problem: Problem) -> Workspace:
    workspace = Workspace()
    workspace.open_problem(problem, Source("scan", problem.mesh))
    return workspace


def train(workspace: Workspace, run: FakeRun, last: int) -> None:
    """Let the workspace hear of a training from its beginning."""
    workspace.begin_run(run, run.problem, "CPU")
    for record in run.records(last):
        workspace.add_records([record])
        if record.snapshot is not None:
            workspace.add_snapshot(record.snapshot)


def test_the_newest_snapshot_is_shown_while_following(workspace: Workspace, fake_run: FakeRun) -> None:
    train(workspace, fake_run, 25)
    assert workspace.snapshot_steps == [0, 10, 20]
    assert workspace.shown_step == workspace.latest_step == 20
    assert workspace.current_step == 25


def test_going_back_in_time_stops_following_and_a_click_starts_it_again(workspace: Workspace, fake_run: FakeRun) -> None:
    train(workspace, fake_run, 20)
    workspace.show_step(10)
    assert not workspace.follow_latest
    workspace.add_snapshot(fake_run.record(30).snapshot)  # type: ignore[arg-type]
    assert workspace.shown_step == 10
    workspace.set_follow_latest(True)
    assert workspace.shown_step == 30


def test_showing_the_newest_step_does_not_stop_following(workspace: Workspace, fake_run: FakeRun) -> None:
    train(workspace, fake_run, 20)
    workspace.show_step(20)
    assert workspace.follow_latest


def test_any_step_shows_the_nearest_snapshot(workspace: Workspace, fake_run: FakeRun) -> None:
    train(workspace, fake_run, 40)
    workspace.show_step(14)
    assert workspace.shown_step == 10


def test_a_kept_step_is_stored_in_the_run_and_survives_more_training(workspace: Workspace, fake_run: FakeRun) -> None:
    train(workspace, fake_run, 20)
    workspace.keep(10)
    workspace.add_snapshot(fake_run.record(30).snapshot)  # type: ignore[arg-type]
    assert workspace.kept_step == fake_run.kept_step == 10
    workspace.keep(None)
    assert workspace.kept_step is fake_run.kept_step is None


def test_a_run_is_opened_at_its_kept_step(workspace: Workspace, trained_run: FakeRun) -> None:
    trained_run.kept_step = 20
    workspace.open_run(trained_run, trained_run.problem, Source("scan", trained_run.problem.mesh), None)
    assert (workspace.shown_step, workspace.follow_latest, len(workspace.curve)) == (20, False, 41)


def test_a_run_without_a_choice_is_opened_at_its_end(workspace: Workspace, trained_run: FakeRun) -> None:
    workspace.open_run(trained_run, trained_run.problem, Source("scan", trained_run.problem.mesh), None)
    assert workspace.shown_step == 40


def test_another_mesh_lets_the_run_go(workspace: Workspace, trained_run: FakeRun, problem: Problem) -> None:
    workspace.open_run(trained_run, trained_run.problem, Source("scan", trained_run.problem.mesh), None)
    workspace.open_problem(problem, Source("other", problem.mesh))
    assert workspace.run is None
    assert workspace.snapshot_steps == []
    assert workspace.shown_step is None
    assert len(workspace.curve) == 0


@pytest.mark.parametrize(
    ("state", "step", "expected"),
    [("stopped", 20, True), ("interrupted", 20, True), ("failed", 20, True), ("finished", 40, False), ("stopped", 40, False)],
)
def test_a_run_can_be_continued_until_its_last_step(
    workspace: Workspace, fake_run: FakeRun, state: str, step: int, expected: bool
) -> None:
    train(workspace, fake_run, step)
    fake_run.state = state
    workspace.set_state(RunnerState.FINISHED)
    assert (workspace.continue_until is not None) is expected
    assert workspace.controls.proceed is expected


def test_the_best_step_needs_a_ground_truth_and_is_not_the_untrained_one(workspace: Workspace, fake_run: FakeRun) -> None:
    train(workspace, fake_run, 40)
    assert workspace.best_step == 20  # the fake MAD is lowest at 16
    assert Workspace().best_step is None


def test_all_panes_share_one_range(workspace: Workspace, fake_run: FakeRun) -> None:
    train(workspace, fake_run, 40)
    problem = fake_run.problem
    lengths = np.linalg.norm(problem.target - problem.base, axis=1)
    assert workspace.colors.limits().high == pytest.approx(np.percentile(lengths, 98), rel=1e-5)
    workspace.colors.set(quantity="signed")
    assert workspace.colors.limits().low == -workspace.colors.limits().high


def test_the_range_of_the_run_covers_all_its_steps(workspace: Workspace, fake_run: FakeRun) -> None:
    fake_run.problem = workspace.problem  # type: ignore[assignment]
    train(workspace, fake_run, 20)
    far = Snapshot("fake", 30, 3 * fake_run.problem.target, {}, 3.0)
    workspace.add_snapshot(far)
    workspace.show_step(10)
    this_step = workspace.colors.limits().high
    workspace.colors.set(range="run")
    assert workspace.colors.steps_to_measure() == [20, 30]
    ruler = workspace.colors.ruler()
    workspace.colors.set_extent(ruler, 98.0, 30, extent(ruler.values(far.vertices)))
    assert workspace.colors.steps_to_measure() == [20]
    assert workspace.colors.limits().high > 2 * this_step


def test_mad_is_measured_when_the_truth_comes_after_the_training(workspace: Workspace, problem: Problem) -> None:
    state = MeshState("step", 10, problem.target)
    assert problem.ground_truth is not None
    assert workspace.mad_of(state) == pytest.approx(problem.ground_truth.measures(problem.target)["mad"])
    workspace.open_problem(denoising(problem.mesh, settings_for()), Source("scan", problem.mesh))
    assert workspace.mad_of(state) is None


def test_mad_is_taken_from_the_training_where_it_was_logged(workspace: Workspace, fake_run: FakeRun) -> None:
    train(workspace, fake_run, 40)
    state = workspace.predicted_state()
    assert state is not None
    assert workspace.mad_of(state) == fake_run.record(40).metrics["mad"]


def test_signals_are_silent_when_nothing_changes(workspace: Workspace) -> None:
    heard: list[str] = []
    for owner, name in (
        (workspace.colors, "changed"), (workspace.look, "changed"), (workspace.comparison, "changed"),
        (workspace.comparison, "mode_changed"), (workspace, "state_changed"), (workspace, "follow_latest_changed"),
    ):  # fmt: skip
        getattr(owner, name).connect(lambda owner=owner: heard.append(type(owner).__name__), check_nargs=False)
    workspace.colors.set(quantity="magnitude")
    workspace.look.set(linked=True)
    workspace.look.set(edges=False)
    workspace.set_state(RunnerState.IDLE)
    workspace.set_follow_latest(True)
    workspace.comparison.show("smoothed")
    workspace.comparison.set_mode("off")
    workspace.comparison.set_flipped(False)
    assert heard == []
    workspace.look.set(edges=True)
    assert heard == ["Look"]


def test_the_cache_stays_within_its_bytes_and_keeps_the_newest() -> None:
    cache = SnapshotCache(most_bytes=3 * 240)
    for step in range(6):
        cache.put(Snapshot("fake", step, np.full((10, 3), float(step))))
    assert [step for step in range(6) if cache.get(step) is not None] == [3, 4, 5]
    cache.put(Snapshot("fake", 9, np.zeros((1000, 3))))
    assert cache.get(9) is not None
    cache.clear()
    assert cache.get(9) is None


def test_a_forgotten_snapshot_comes_from_the_run_again(workspace: Workspace, trained_run: FakeRun) -> None:
    workspace.open_run(trained_run, trained_run.problem, Source("scan", trained_run.problem.mesh), None)
    assert workspace.snapshot(10) is trained_run.snapshots[10]
    assert workspace.snapshot(11) is None
