"""``dmp resume``, ``dmp export`` and ``dmp runs …``: what is done with the run folders of earlier trainings."""

from __future__ import annotations

import json as json_module
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter
from rich.console import Console
from rich.markup import escape

from dmp.commands.common import (
    EXIT_DONE,
    EXIT_USAGE,
    check_output,
    check_report,
    refuse_as_output,
    refuse_within_run,
    run_folder,
    say,
)
from dmp.commands.exporting import ColourName, quantity_named
from dmp.commands.options import AsJson, Keep, OutPath, Quiet, ReportPath, Verbose

if TYPE_CHECKING:
    from dmp.runs import Run


def resume(
    run: Annotated[Path, Parameter(help="Run folder of a training that ended early.")],
    /,
    *,
    steps: Annotated[int | None, Parameter(help="Train until this step instead of the one it was started with.")] = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"], help="Save the result here as well.")] = None,
    keep: Keep = "auto",
    report: ReportPath = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Go on with a training from its last checkpoint."""
    from dmp.commands.outcome import check_keep, save_result, train_into
    from dmp.runs import Run

    opened = Run.open(run_folder(run))
    if output is not None:
        check_output(output)
        refuse_as_output(output, opened.input_path)
        refuse_within_run(output, opened.folder)
    if report is not None:
        check_report(report, output, opened.input_path)
        refuse_within_run(report, opened.folder)
    if change := opened.change_of_input():
        say(change, quiet)
    check_keep(keep, opened.settings, has_truth=opened.problem().ground_truth is not None, last_step=steps)
    if steps is None and opened.has_ended and (output is not None or report is not None):
        # Killed after its last step, before its result was written.
        say("This training has reached its end already.", quiet)
        finished = True
    else:
        finished = train_into(opened, steps=steps, quiet=quiet, verbose=verbose)
    return save_result(opened, finished, keep=keep, output=output, report=report, quiet=quiet)


def export(
    run: Annotated[Path, Parameter(help="Run folder.")],
    /,
    *,
    output: OutPath,
    step: Annotated[
        str, Parameter(help="A number, 'kept', 'suggested' or 'last'; by default the kept step, else the suggested one.")
    ] = "",
    colour_by: Annotated[
        ColourName | None,
        Parameter(name=["--colour-by", "--color-by"], help="Colour the vertices as well, which OBJ can hold, too."),
    ] = None,
    quiet: Quiet = False,
) -> int:
    """Write the predicted mesh of one step of a run, also of one that was killed.

    PLY and VTP also hold what is known of each vertex: its displacement, the error to the ground truth, and whether it
    was inserted.
    """
    from dmp.commands.outcome import choose_step
    from dmp.exports.meshes import annotated_mesh
    from dmp.meshio import write_mesh
    from dmp.runs import Run

    opened = Run.open(run_folder(run))
    check_output(output)
    refuse_as_output(output, opened.input_path)
    refuse_within_run(output, opened.folder)
    chosen = choose_step(opened, step or ("kept" if opened.kept_step is not None else "suggested"))
    notes = write_mesh(output, annotated_mesh(opened, chosen, quantity_named(colour_by, opened)))
    say(" ".join((f"Step {chosen} written to {output}.", *notes)), quiet)
    return EXIT_DONE


runs_app = App(name="runs", help="List, rename or delete the runs that are kept in your data folder.")


@runs_app.default
def runs(
    *,
    search: Annotated[
        str, Parameter(help="Show only runs in whose name, input, settings or state all of these words occur.")
    ] = "",
    folder: Annotated[Path | None, Parameter(help="Another folder of runs.")] = None,
    json: AsJson = False,
) -> int:
    """List the runs that are kept in your data folder, newest first."""
    from rich.table import Table

    from dmp.run_upkeep import changed_settings, kept_runs
    from dmp.runs import default_runs_folder

    root = folder or default_runs_folder()
    kept = kept_runs(root)
    words = search.casefold().split()
    found = [run for run in kept.runs if all(word in _searched(run) for word in words)]
    for path, reason in kept.unreadable:
        say(f"{path} is left out: {reason}")
    if json:
        rows = [
            {"folder": str(run.folder), "name": run.name, "state": run.state, "last_step": run.last_step,
             "steps": run.settings.steps, "kept_step": run.kept_step, "created": run.created,
             "input": None if run.input_path is None else str(run.input_path), "task": run.settings.task,
             "preset": run.settings.preset, "changed_settings": changed_settings(run.settings)}
            for run in found
        ]  # fmt: skip
        print(json_module.dumps(rows, indent=2))
        return EXIT_DONE
    if not found:
        say(f"There are no runs in {root}." if not words else f"No run in {root} has all of these words: {search}.")
        return EXIT_DONE
    table = Table("run", "name", "settings", "state", "step", "kept", box=None)
    for run in found:
        settings = " ".join(
            (run.settings.task, run.settings.preset, *(f"--{name.replace('_', '-')} {value}"
             for name, value in changed_settings(run.settings).items()))
        )  # fmt: skip
        step = f"{run.last_step} of {run.settings.steps}"
        row = (run.folder.name, run.name, settings, run.state, step, "" if run.kept_step is None else str(run.kept_step))
        table.add_row(*map(escape, row))
    console = Console()
    # A name that is cut off cannot be typed again, so the width follows the names.
    console.width = max(console.width, 120 + max(len(run.folder.name) for run in found))
    console.print(table)
    print(f"\nin {found[0].folder.parent}; 'dmp resume', 'dmp export' and 'dmp runs rename' take these names too.")
    return EXIT_DONE


@runs_app.command
def rename(
    run: Annotated[Path, Parameter(help="Run folder, or its name among your runs.")],
    name: Annotated[str, Parameter(help="What to call it from now on; its folder keeps its name.")],
    /,
    *,
    quiet: Quiet = False,
) -> int:
    """Give a run another name."""
    from dmp.runs import Run

    opened = Run.open(run_folder(run))
    before = opened.name
    opened.rename(name)
    say(f"“{before}” is called “{opened.name}” now.", quiet)
    return EXIT_DONE


@runs_app.command
def delete(
    runs: Annotated[tuple[Path, ...], Parameter(help="Run folders, or their names among your runs.")],
    /,
    *,
    yes: Annotated[bool, Parameter(help="Delete without asking.")] = False,
    quiet: Quiet = False,
) -> int:
    """Delete runs for good: their snapshots, settings and checkpoints. What else lies in their folders is left."""
    from dmp.run_upkeep import refuse_removal, remove_run

    folders = list(dict.fromkeys(run_folder(named) for named in runs))
    # Nothing is deleted when one of them cannot be.
    for folder in folders:
        refuse_removal(folder)
    if not yes and not _agreed(folders):
        say("Nothing was deleted.", quiet)
        return EXIT_USAGE
    for folder in folders:
        left = remove_run(folder)
        kept = f" What this program did not write was left in it: {', '.join(left)}." if left else ""
        say(f"{folder} was deleted.{kept}", quiet)
    return EXIT_DONE


def _agreed(folders: list[Path]) -> bool:
    """Ask on the terminal; where nobody can answer, nothing is deleted."""
    if sys.stdin is None or not sys.stdin.isatty():
        say("dmp: deleting cannot be taken back. Add --yes to do it without a question.")
        return False
    for folder in folders:
        say(str(folder))
    what = "this run" if len(folders) == 1 else f"these {len(folders)} runs"
    say(f"Delete {what} for good? It cannot be taken back. Type yes or no:")
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def _searched(run: Run) -> str:
    from dmp.run_upkeep import changed_settings

    parts = (run.folder.name, run.name, run.input_path or "", run.settings.task, run.settings.preset, run.state)
    return " ".join(map(str, (*parts, changed_settings(run.settings)))).casefold()
