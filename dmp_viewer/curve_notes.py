"""What is said beside the training curve: what it shows, how far it is, and which values to compare it with."""

from __future__ import annotations

from dmp.settings import Settings
from dmp_viewer.curve import Reference
from dmp_viewer.model import Workspace


def kind_of(settings: Settings | None) -> str:
    """Return the key of :data:`dmp_viewer.curve.EXPLANATIONS` for a training with these settings."""
    if settings is None or settings.task != "complete":
        return "denoise"
    if settings.method == "made-up-holes":
        return "made-up-holes"
    return "complete, denoise" if settings.hold_out > 0 else "complete"


def is_judged_by_rest(workspace: Workspace) -> bool:
    """Tell whether the run on show gets better until it ends, so that there is no step to suggest."""
    run = workspace.run
    return run is not None and workspace.is_completion and kind_of(run.settings) != "complete, denoise"


def note(workspace: Workspace) -> str:
    """Return one sentence about how far a completion is; empty where a suggested step says more."""
    run, curve = workspace.run, workspace.curve
    if run is None or not len(curve) or not is_judged_by_rest(workspace):
        return ""
    kind = kind_of(run.settings)
    last = curve.rows[-1]
    bound = run.settings.rest_movement
    if kind == "made-up-holes":
        error = last.get("made_up_error")
        return "" if error is None else f"In holes made up where the truth is known, the error is {error:.3f} edge lengths."
    if workspace.came_to_rest:
        return f"At rest since step {workspace.current_step:,}: the inserted vertices hardly move, so the completion is done."
    movement = last.get("inserted_movement")
    if movement is None:
        return ""
    until = f"; it is done when they stay below {bound:g}" if bound > 0 and workspace.state.is_active else ""
    return f"The inserted vertices move {movement:.3f} edge lengths per 100 steps{until}."


def references(workspace: Workspace) -> tuple[Reference, ...]:
    """Return the level lines of a completion: where its vertices rest, and how far off hole filling alone is."""
    run = workspace.run
    if run is None or not workspace.is_completion:
        return ()
    found = []
    if run.settings.rest_movement > 0:
        found.append(Reference("inserted_movement", run.settings.rest_movement, "at rest below"))
    distance = workspace.hole_measures(None).get("hole_distance")
    if distance is not None:
        found.append(Reference("hole_distance", distance, "hole filling alone"))
    return tuple(found)
