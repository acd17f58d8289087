"""Which actions make sense now: a function of nothing but the workspace. No widgets."""

from __future__ import annotations

from typing import get_args

from dmp_viewer.colors import QUANTITIES
from dmp_viewer.comparison import Middle
from dmp_viewer.model import Workspace


def possible_actions(workspace: Workspace) -> dict[str, bool]:
    """Return for each action that does not always make sense whether it does now."""
    controls, comparison = workspace.controls, workspace.comparison
    steps, shown, kept = workspace.snapshot_steps, workspace.shown_step, workspace.kept_step
    has_mesh, has_values = workspace.problem is not None, has_mesh_values(workspace)
    several, has_other = len(steps) > 1, comparison.other is not None
    found = {
        "start": controls.start,
        "pause": controls.pause,
        "resume": controls.resume,
        "stop": controls.stop,
        "proceed": controls.proceed,
        "open_ground_truth": controls.edit and has_mesh,
        "save": shown is not None,
        "save_shown": shown is not None,
        "keep": shown is not None and shown != kept,
        "forget_kept": kept is not None,
        "show_suggested": workspace.suggestion is not None,
        "show_best": workspace.best_step is not None,
        "first_step": several and shown != steps[0],
        "previous_step": several and shown != steps[0],
        "next_step": several and shown != steps[-1],
        "last_step": several and shown != steps[-1],
        "follow": bool(steps),
        "bookmark": shown is not None,
        "previous_bookmark": shown is not None and workspace.bookmarks.before(shown) is not None,
        "next_bookmark": shown is not None and workspace.bookmarks.after(shown) is not None,
        "set_reference": shown is not None and shown != comparison.reference_step,
        "filling_only": workspace.is_completion,
        "forget_vertex": workspace.picking.vertex is not None,
    }
    found |= dict.fromkeys(("play", "faster", "slower"), several)
    found |= dict.fromkeys(("view_front", "view_side", "view_top", "view_oblique"), has_mesh)
    found |= dict.fromkeys(("reset_view", "edges", "smooth", "link", "z_up", "orthographic"), has_mesh)
    found |= dict.fromkeys(("pick_vertex", "next_middle"), has_mesh)
    found |= dict.fromkeys(("compare_run", "compare_filter"), has_mesh)
    found |= dict.fromkeys(("forget_other", "other_previous", "other_next"), has_other)
    found |= dict.fromkeys(("range_step", "range_run", "lock_range", "set_range", "outliers"), has_values)
    found |= dict.fromkeys(("flip", "swipe", "lens", "against_middle"), shown is not None)
    found |= {quantity: has_mesh and workspace.colors.can_show(quantity) for quantity in QUANTITIES}
    choices = comparison.choices()
    return found | {f"middle_{middle}": has_mesh and middle in choices for middle in get_args(Middle)}


def has_mesh_values(workspace: Workspace) -> bool:
    """Tell whether colours on the open mesh stand for numbers."""
    return workspace.problem is not None and workspace.colors.has_values
