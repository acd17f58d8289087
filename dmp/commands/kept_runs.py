"""``dmp resume``, ``dmp export`` and ``dmp runs``: what is done with the run folders of earlier trainings."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from dmp.commands.common import EXIT_DONE, check_output, run_folder, say
from dmp.commands.options import AsJson, Keep, OutPath, Quiet, ReportPath, Verbose


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
    if change := opened.change_of_input():
        say(change, quiet)
    check_keep(keep, opened.settings, has_truth=opened.problem().ground_truth is not None, last_step=steps)
    if output is not None:
        check_output(output)
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
    quiet: Quiet = False,
) -> int:
    """Write the predicted mesh of one step of a run, also of one that was killed."""
    from dmp.commands.outcome import choose_step
    from dmp.meshio import write_mesh
    from dmp.runs import Run

    opened = Run.open(run_folder(run))
    chosen = choose_step(opened, step or ("kept" if opened.kept_step is not None else "suggested"))
    notes = write_mesh(output, opened.mesh_at(chosen))
    say(" ".join((f"Step {chosen} written to {output}.", *notes)), quiet)
    return EXIT_DONE


def runs(*, folder: Annotated[Path | None, Parameter(help="Another folder of runs.")] = None, json: AsJson = False) -> int:
    """List the runs that are kept in your data folder, newest first."""
    from rich.table import Table

    from dmp.runs import default_runs_folder, list_runs

    found = list_runs(folder)
    if json:
        rows = [
            {"folder": str(run.folder), "name": run.name, "state": run.state, "last_step": run.last_step,
             "steps": run.settings.steps, "kept_step": run.kept_step, "created": run.created}
            for run in found
        ]  # fmt: skip
        print(json_module.dumps(rows, indent=2))
        return EXIT_DONE
    if not found:
        say(f"There are no runs in {folder or default_runs_folder()}.")
        return EXIT_DONE
    table = Table("run", "state", "step", "kept", box=None)
    for run in found:
        kept = "" if run.kept_step is None else str(run.kept_step)
        table.add_row(run.folder.name, run.state, f"{run.last_step} of {run.settings.steps}", kept)
    console = Console()
    # A name that is cut off cannot be typed again, so the width follows the names.
    console.width = max(console.width, 60 + max(len(run.folder.name) for run in found))
    console.print(table)
    print(f"\nin {found[0].folder.parent}; 'dmp resume' and 'dmp export' take these names too.")
    return EXIT_DONE
