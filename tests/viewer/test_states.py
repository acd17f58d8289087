"""Every button is a function of the state; this is the table."""

from __future__ import annotations

import pytest

from dmp_viewer.states import Controls, RunnerState, controls_for

IDLE, PREPARING, RUNNING, PAUSED, STOPPING, FINISHED, FAILED = RunnerState

TABLE = [
    # state, has a mesh, can continue -> what can be done
    (IDLE, False, False, {"edit"}),
    (IDLE, True, False, {"edit", "start"}),
    (IDLE, True, True, {"edit", "start", "proceed"}),
    (PREPARING, True, False, {"stop"}),
    (RUNNING, True, False, {"pause", "stop"}),
    (RUNNING, True, True, {"pause", "stop"}),
    (PAUSED, True, False, {"resume", "stop"}),
    (STOPPING, True, False, set()),
    (FINISHED, True, False, {"edit", "start"}),
    (FINISHED, True, True, {"edit", "start", "proceed"}),
    (FAILED, True, False, {"edit", "start"}),
    (FAILED, True, True, {"edit", "start", "proceed"}),
    (FAILED, False, True, {"edit"}),
]


@pytest.mark.parametrize(("state", "has_mesh", "can_continue", "usable"), TABLE)
def test_controls_follow_the_state(state: RunnerState, has_mesh: bool, can_continue: bool, usable: set[str]) -> None:
    controls = controls_for(state, has_mesh=has_mesh, can_continue=can_continue)
    assert {name for name in Controls.__dataclass_fields__ if getattr(controls, name)} == usable


def test_the_table_has_every_state() -> None:
    assert {row[0] for row in TABLE} == set(RunnerState)


def test_a_training_is_active_from_preparing_to_stopping() -> None:
    assert [state for state in RunnerState if state.is_active] == [PREPARING, RUNNING, PAUSED, STOPPING]
