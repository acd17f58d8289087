"""The states of a training as the window sees them, and which controls make sense in each: pure functions, no widgets."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class RunnerState(Enum):
    """What the training thread is doing."""

    IDLE = "idle"
    PREPARING = "preparing"
    RUNNING = "running"
    PAUSED = "paused"
    STOPPING = "stopping"
    FINISHED = "finished"
    FAILED = "failed"

    @property
    def is_active(self) -> bool:
        """Whether a training thread is alive."""
        return self in (RunnerState.PREPARING, RunnerState.RUNNING, RunnerState.PAUSED, RunnerState.STOPPING)


@dataclass(frozen=True)
class Controls:
    """Which controls can be used.

    Attributes:
        start: begin a new run on the open mesh.
        pause: hold the training between two steps.
        resume: go on after a pause.
        stop: end the training; the run keeps everything it has learnt.
        proceed: go on with a run that was stopped or interrupted ("Continue").
        edit: change meshes and settings.
    """

    start: bool = False
    pause: bool = False
    resume: bool = False
    stop: bool = False
    proceed: bool = False
    edit: bool = False


def controls_for(state: RunnerState, *, has_mesh: bool, can_continue: bool) -> Controls:
    """Return the usable controls as a function of nothing but the state."""
    match state:
        case RunnerState.PREPARING:
            return Controls(stop=True)
        case RunnerState.RUNNING:
            return Controls(pause=True, stop=True)
        case RunnerState.PAUSED:
            return Controls(resume=True, stop=True)
        case RunnerState.STOPPING:
            return Controls()
        case _:
            return Controls(start=has_mesh, proceed=has_mesh and can_continue, edit=True)
