"""``dmp denoise`` and ``dmp complete``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from dmp.commands.common import (
    EXIT_DONE,
    check_output,
    check_report,
    load,
    refuse_as_output,
    refuse_within_run,
    say,
)
from dmp.commands.options import (
    CompleteOptions,
    DenoiseOptions,
    Keep,
    MeshPath,
    OutPath,
    Quiet,
    ReportPath,
    RunPath,
    Verbose,
    given,
)
from dmp.errors import SettingsError
from dmp.settings import DENOISE_TOO, Settings, settings_for


def denoise(
    mesh: MeshPath,
    /,
    *,
    output: OutPath,
    ground_truth: Annotated[Path | None, Parameter(help="Clean version of the mesh, only to measure by.")] = None,
    keep: Keep = "auto",
    run: RunPath = None,
    report: ReportPath = None,
    options: DenoiseOptions = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Remove the noise from a mesh: train on it, and save the prediction of one step."""
    named = given(options)
    settings = settings_for("denoise", **named)
    if settings.method != "prior" and named.get("hold_out"):
        raise SettingsError("--hold-out has no effect on --preset best, which needs no held-out vertices. Leave it out.")
    return _restore(
        mesh,
        settings,
        output=output,
        ground_truth=ground_truth,
        keep=keep,
        run=run,
        report=report,
        quiet=quiet,
        verbose=verbose,
    )


def complete(
    mesh: MeshPath,
    /,
    *,
    output: OutPath,
    denoise_too: Annotated[
        bool, Parameter(name="--denoise", help="Remove noise as well: the known vertices take the prediction too.")
    ] = False,
    ground_truth: Annotated[Path | None, Parameter(help="The complete mesh in the same place, only to measure by.")] = None,
    keep: Keep = "auto",
    run: RunPath = None,
    report: ReportPath = None,
    options: CompleteOptions = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Fill the holes of a mesh, and let the network carry the mesh's own structure into them."""
    from dmp.errors import NoHolesError
    from dmp.meshio import write_mesh

    named = given(options)
    if denoise_too and named.get("preset", "compact") == "best":
        raise SettingsError("--denoise cannot be combined with --preset best, which leaves known vertices where they are.")
    settings = settings_for("complete", **({**DENOISE_TOO, **named} if denoise_too else named))
    try:
        return _restore(
            mesh,
            settings,
            output=output,
            ground_truth=ground_truth,
            keep=keep,
            run=run,
            report=report,
            quiet=quiet,
            verbose=verbose,
        )
    except NoHolesError as error:
        if denoise_too:
            say(f"{mesh}: {error} Its noise is removed.", quiet)
            return _restore(
                mesh, settings_for("denoise", **named), output=output, ground_truth=ground_truth, keep=keep, run=run,
                report=report, quiet=quiet, verbose=verbose,
            )  # fmt: skip
        write_mesh(output, load(mesh, quiet=True))
        say(f"{mesh}: {error} It was written to {output} as it is.", quiet)
        return EXIT_DONE


def _restore(
    mesh: Path,
    settings: Settings,
    *,
    output: Path,
    ground_truth: Path | None,
    keep: str,
    run: Path | None,
    report: Path | None,
    quiet: bool,
    verbose: bool,
) -> int:
    from dmp.commands.outcome import check_keep, save_result, train_into
    from dmp.completion import problem_for
    from dmp.memory_needs import check_memory
    from dmp.runs import Run

    check_keep(keep, settings, has_truth=ground_truth is not None)
    check_output(output)
    refuse_as_output(output, mesh, ground_truth)
    check_report(report, output, mesh, ground_truth)
    for written in (output, report):
        if run is not None and written is not None:
            if written.absolute() == run.absolute():
                raise SettingsError(f"{run} cannot be both the run folder and a file. Name another place for one of them.")
            refuse_within_run(written, run)
    damaged = load(mesh, quiet)
    # Before anything is made of a mesh that is too large.
    if longer_way := check_memory(settings, damaged.n_vertices):
        say(longer_way, quiet)
    truth = None if ground_truth is None else load(ground_truth, quiet)
    problem = problem_for(damaged, settings, truth)
    for note in problem.notes:
        say(note, quiet)
    # A folder that was named must be written; the usual one is only a safety net.
    made = Run.create(problem, settings, folder=run, input_path=mesh, ground_truth_path=ground_truth, in_memory=run is None)
    say(f"Run: {made.folder}", quiet)
    finished = train_into(made, quiet=quiet, verbose=verbose)
    return save_result(made, finished, keep=keep, output=output, report=report, quiet=quiet)
