"""Training from the command line: progress, interruption, and which step is saved."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from dmp.durations import duration
from dmp.errors import MeshFileError, RunError, SettingsError, TrainingError
from dmp.files import atomic_write_bytes, in_words
from dmp.interruption import interruption
from dmp.meshio import write_mesh
from dmp.reporting import run_report
from dmp.runs import Run, record
from dmp.settings import Settings
from dmp.snapshot import StepRecord

_EXIT_DONE, _EXIT_INTERRUPTED = 0, 130
# After so many steps it can be said how long the rest will take.
_TIMED_STEPS = 4


def check_keep(keep: str, settings: Settings, *, has_truth: bool, last_step: int | None = None) -> None:
    """Refuse a ``--keep`` that could not be followed after the training (raises :class:`SettingsError`)."""
    if keep in ("auto", "last"):
        return
    if keep == "best":
        if not has_truth:
            raise SettingsError("--keep best needs --ground-truth to judge by. Use --keep auto without one.")
        return
    if not keep.isdecimal():
        raise SettingsError(f"--keep is '{keep}', but must be auto, last, best or a step.")
    step, last = int(keep), last_step or settings.steps
    if step > last:
        raise SettingsError(f"--keep {step} lies beyond the last step, {last}.")
    if step % settings.snapshot_every and step != last:
        raise SettingsError(
            f"--keep {step}: meshes are kept every {settings.snapshot_every} steps. "
            f"Choose a multiple of that, or set --snapshot-every."
        )


def choose_step(run: Run, wanted: str) -> int:
    """Return the step that ``wanted`` (auto, suggested, kept, last, best or a number) stands for.

    Raises:
        RunError: when the run has no such step.
    """
    steps = run.snapshot_steps()
    if not steps:
        raise RunError(f"The run in {run.folder} has no snapshots yet.")
    if wanted in ("auto", "suggested"):
        return run.suggested_step() or steps[-1]
    if wanted == "last":
        return steps[-1]
    if wanted == "kept":
        if run.kept_step is None:
            raise RunError(f"No step was marked to be kept in {run.folder}. Name one with --step.")
        return run.kept_step
    if wanted == "best":
        name = "hole_distance" if run.settings.task == "complete" else "mad"
        measured = [row for row in run.curve() if name in row and row["step"] in steps]
        if not measured:
            raise RunError(f"The run in {run.folder} had no ground truth to judge by.")
        return int(min(measured, key=lambda row: row[name])["step"])
    if wanted.isdecimal() and int(wanted) in steps:
        return int(wanted)
    nearest = min(steps, key=lambda step: abs(step - int(wanted))) if wanted.isdecimal() else steps[-1]
    raise RunError(f"'{wanted}' is not a kept step of {run.folder}. The nearest is {nearest}; or use kept, suggested or last.")


def train_into(run: Run, *, steps: int | None = None, quiet: bool = False, verbose: bool = False) -> bool:
    """Train a run until its last step or an interruption, showing progress on stderr.

    Returns:
        Whether the last step was reached.
    """
    training = run.resume(steps)
    console = Console(stderr=True, highlight=False, quiet=quiet, soft_wrap=True)
    problem = run.problem()
    if verbose:
        console.print(f"Run folder: {run.folder}", markup=False)
        console.print(
            f"{problem.mesh.n_vertices} vertices, {problem.mesh.n_faces} faces, {training.n_parameters} parameters, "
            f"{training.device}, {training.threads} threads"
        )
    if problem.ground_truth is not None:
        before = "Hole filling alone" if run.settings.task == "complete" else "Input"
        console.print(f"{before}: {_measures(problem.ground_truth.measures(problem.target))}")
    shown_warnings = 0
    with interruption() as stop:
        records = record(training, run)
        try:
            timed = _with_forecast(records, run.settings.steps, console)
            for item in _with_progress(timed, training.step, run.settings.steps, console):
                for warning in run.warnings[shown_warnings:]:
                    console.print(f"Warning: {warning}", markup=False)
                shown_warnings = len(run.warnings)
                if verbose and item.metrics:
                    console.print(f"step {item.step}: " + ", ".join(f"{k} {v:.4g}" for k, v in item.metrics.items()))
                if stop.is_set():
                    break
        except TrainingError as error:
            raise TrainingError(f"{error} {_how_to_save(run)}") from error
        finally:
            records.close()  # type: ignore[attr-defined]
            for warning in run.warnings[shown_warnings:]:
                console.print(f"Warning: {warning}", markup=False)
    return training.is_done


def _how_to_save(run: Run) -> str:
    """Tell what is left of a training that failed, and how to get it; what is only in memory is saved where it can be."""
    steps = [step for step in run.snapshot_steps() if step > 0]
    if not steps:
        return "There is no earlier step to save."
    if run.is_in_memory:
        return f"Step {steps[-1]} was written to {_write_into_refuge(run, steps[-1])}."
    return f"Step {steps[-1]} can be saved with 'dmp export {run.folder} --step {steps[-1]} -o FILE'."


def save_result(run: Run, finished: bool, *, keep: str, output: Path | None, report: Path | None, quiet: bool) -> int:
    """Save the chosen step and the report of a finished training, or tell how to go on with an interrupted one."""
    console = Console(stderr=True, highlight=False, quiet=quiet, soft_wrap=True)
    if not finished and not run.is_in_memory:
        console.print(
            f"Stopped at step {run.last_step}. Go on with 'dmp resume {run.folder}', or save what there is with "
            f"'dmp export {run.folder} -o FILE'.",
            markup=False,
        )
        return _EXIT_INTERRUPTED
    if not finished:
        # The run is gone with this process, so what there is has to be saved now.
        keep = "last"
    step = choose_step(run, keep)
    suggestion = run.suggestion()
    if keep != "auto":
        run.keep(step)
    if report is not None:
        content = json.dumps(run_report(run, step), indent=2).encode()
        try:
            atomic_write_bytes(report, content)
        except OSError as error:
            console.print(f"Warning: the report cannot be written to {report}: {in_words(error)}.", markup=False)
    if output is not None:
        output, notes = _write_somewhere(run, step, output)
        reason = f" {suggestion.reason}" if suggestion and keep == "auto" else ""
        console.print(" ".join((f"Step {step} written to {output}.{reason}", *notes)), markup=False)
    elif run.is_in_memory:
        console.print(f"Step {step} written to {_write_into_refuge(run, step)}.", markup=False)
    else:
        console.print(f"Save it with 'dmp export {run.folder} -o FILE'.", markup=False)
    if measured := _measures(run.snapshot(step).metrics):
        console.print(f"Result at step {step}: {measured}")
    return _EXIT_DONE if finished else _EXIT_INTERRUPTED


def _write_somewhere(run: Run, step: int, output: Path) -> tuple[Path, tuple[str, ...]]:
    """Write the mesh of a step, and when that fails say how to get it all the same.

    Returns:
        where it was written, and the notes on it.

    Raises:
        MeshFileError: when it could not be written where it was wanted; the text says where it is.
    """
    mesh = run.mesh_at(step)
    try:
        return output, write_mesh(output, mesh)
    except MeshFileError as error:
        if not run.is_in_memory:
            remedy = f"Nothing is lost: save it elsewhere with 'dmp export {run.folder} --step {step} -o FILE'."
            raise MeshFileError(output, error.cause, remedy) from error
        remedy = f"The mesh of step {step} was written to {_write_into_refuge(run, step)} instead."
        raise MeshFileError(output, error.cause, remedy) from error


def _write_into_refuge(run: Run, step: int) -> Path:
    """Write the mesh of a step into the system's folder for temporary files, and return where."""
    refuge = Path(tempfile.gettempdir()) / f"dmp_{run.run_id[:8]}_step{step}.ply"
    write_mesh(refuge, run.mesh_at(step))
    return refuge


def _measures(values: Mapping[str, float]) -> str:
    """Return the measures against a ground truth as words, or nothing."""
    words = {
        "mad": "MAD {:.2f} degrees",
        "vertex_error": "vertex error {:.3f} mean edge lengths",
        "hole_distance": "inserted vertices {:.3f} mean edge lengths from the true surface",
        "hole_normal_error": "inserted faces off by {:.1f} degrees",
    }
    return ", ".join(text.format(values[name]) for name, text in words.items() if name in values)


def _with_forecast(records: Iterator[StepRecord], last: int, console: Console) -> Iterator[StepRecord]:
    """Yield the records unchanged; say how long it will take as soon as some steps have been timed."""
    # The first step also pays for what is done once.
    marks: list[StepRecord] = []
    for item in records:
        if item.step and len(marks) < _TIMED_STEPS:
            marks.append(item)
            if len(marks) == _TIMED_STEPS:
                left = last - item.step
                seconds = left * (item.seconds - marks[0].seconds) / (_TIMED_STEPS - 1)
                if left > 0:
                    console.print(f"About {duration(seconds)} for the remaining {left:,} of {last:,} steps.")
        yield item


def _with_progress(records: Iterator[StepRecord], first: int, last: int, console: Console) -> Iterator[StepRecord]:
    """Yield the records unchanged: with a progress bar on a terminal, with a line now and then elsewhere."""
    if not console.is_terminal:
        every = max(1, last // 10)
        for item in records:
            if item.step and (item.step % every == 0 or item.step == last):
                told = (f"step {item.step} of {last}", f"{item.seconds:.1f} s", _headline(item))
                console.print(", ".join(text for text in told if text))
            yield item
        return
    columns = (
        TextColumn("training"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn(),
        TextColumn("{task.fields[headline]}"),
    )  # fmt: skip
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("training", total=last, completed=first, headline="")
        for item in records:
            if item.metrics:
                progress.update(task, completed=item.step, headline=_headline(item))
            else:
                progress.update(task, completed=item.step)
            yield item


def _headline(item: StepRecord) -> str:
    names = {
        "total_loss": "loss", "held_out_error": "held-out error", "inserted_movement": "movement", "mad": "MAD",
        "hole_distance": "distance",
    }  # fmt: skip
    return ", ".join(f"{label} {item.metrics[name]:.4g}" for name, label in names.items() if name in item.metrics)
