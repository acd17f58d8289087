"""Which actions make sense: none that cannot do anything, and all that can."""

from __future__ import annotations

from dmp_viewer.actions import ACTIONS
from dmp_viewer.model import Source, Workspace
from dmp_viewer.possible import possible_actions
from tests.viewer.conftest import FakeRun


def possible(workspace: Workspace) -> set[str]:
    return {name for name, is_possible in possible_actions(workspace).items() if is_possible}


def test_every_name_is_that_of_an_action() -> None:
    assert possible_actions(Workspace()).keys() <= {spec.name for spec in ACTIONS}


def test_nothing_is_possible_without_a_mesh() -> None:
    assert possible(Workspace()) == set()


def test_what_a_mesh_without_a_run_allows(trained_run: FakeRun) -> None:
    workspace = Workspace()
    workspace.open_problem(trained_run.problem, Source("scan", trained_run.problem.mesh))
    found = possible(workspace)
    assert {"start", "compare_run", "compare_filter", "pick_vertex", "curvature", "middle_truth", "smooth"} <= found
    assert not {"swipe", "flip", "play", "keep", "bookmark", "step", "middle_run", "forget_other"} & found


def test_what_a_run_allows_depends_on_the_shown_step(trained_run: FakeRun) -> None:
    workspace = Workspace()
    workspace.open_run(trained_run, trained_run.problem, Source("scan", trained_run.problem.mesh), None)
    assert {"swipe", "lens", "flip", "play", "keep", "bookmark", "previous_step", "set_reference"} <= possible(workspace)
    assert "next_step" not in possible(workspace)
    workspace.show_step(0)
    workspace.keep(0)
    workspace.comparison.set_reference(0)
    assert not {"previous_step", "keep", "set_reference"} & possible(workspace)
    assert {"next_step", "forget_kept", "step", "middle_step"} <= possible(workspace)
    workspace.colors.set(quantity="normals")
    assert not {"lock_range", "set_range", "outliers"} & possible(workspace)
