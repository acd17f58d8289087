"""The steps that matter, each with one sentence that says why. No widgets."""

from __future__ import annotations

from dmp_viewer import curve_notes as notes
from dmp_viewer.model import Workspace
from dmp_viewer.step_mark import MarkName, StepMark

_TRUTH = {
    "mad": ("best MAD", "By the ground truth: at step {step:,} the mean angle to the true surface is smallest, {value:.2f}°."),
    "hole_distance": (
        "closest to truth",
        "By the ground truth: at step {step:,} the inserted vertices are closest to the true surface, "
        "{value:.3f} edge lengths.",
    ),
}
_HELD_OUT = {
    "held_out_error": (
        "held-out best",
        "Without a ground truth: at step {step:,} the vertices that the training never sees are predicted best, "
        "{value:.3f} edge lengths off.",
    ),
    "made_up_error": (
        "made-up best",
        "Without a ground truth: at step {step:,} the holes made up where the truth is known are filled best, "
        "{value:.3f} edge lengths off.",
    ),
}


def step_marks(workspace: Workspace) -> list[StepMark]:
    """Return the steps that matter in the run on show: kept, suggested, and the best by each criterion that was measured."""
    marks = []
    if workspace.kept_step is not None:
        sentence = f"Kept: you chose step {workspace.kept_step:,} as the result."
        marks.append(StepMark("kept", workspace.kept_step, "kept", sentence))
    suggestion = workspace.suggestion
    if suggestion is not None and workspace.latest_step and not notes.is_judged_by_rest(workspace):
        sentence = f"Suggested: step {suggestion.step:,}. {suggestion.reason}"
        marks.append(StepMark("suggested", suggestion.step, "suggested", sentence))
    for name, (label, sentence) in _HELD_OUT.items():
        marks += _lowest(workspace, name, "held_out", label, sentence)
    label, sentence = _TRUTH[workspace.quality]
    marks += _lowest(workspace, workspace.quality, "best", label, sentence)
    reference = workspace.comparison.reference_step
    if reference is not None:
        sentence = f"Reference: other steps can be compared with step {reference:,}."
        marks.append(StepMark("reference", reference, "reference", sentence))
    return marks


def _lowest(workspace: Workspace, measure: str, name: MarkName, label: str, sentence: str) -> list[StepMark]:
    curve = workspace.curve
    step = curve.best(measure, [step for step in workspace.snapshot_steps if step > 0])
    if step is None:
        return []
    value = curve.value_at(measure, step)
    return [] if value is None else [StepMark(name, step, label, sentence.format(step=step, value=value))]
