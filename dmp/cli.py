"""The command line, ``dmp …``. Heavy modules are imported by the command that needs them, so that ``--help`` is quick.

Exit codes: 0 done, 1 a fault of this program, 2 wrong usage or unusable input (one line on stderr), 130 interrupted.
"""

from __future__ import annotations

import json as json_module
import os
import sys
from dataclasses import field, fields, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

import cyclopts
from cyclopts import App, Parameter
from rich.console import Console

from dmp import __version__
from dmp.errors import DmpError, MeshFileError, SettingsError
from dmp.settings import DENOISE_TOO, SETTING_FIELDS, Settings, choices, settings_for
from dmp.waiting import spin_only_briefly

if TYPE_CHECKING:
    from dmp.mesh import TriangleMesh

EXIT_DONE, EXIT_FAULT, EXIT_USAGE, EXIT_INTERRUPTED = 0, 1, 2, 130

app = App(
    name="dmp",
    help="Restore one damaged triangle mesh with nothing but that mesh (Deep Mesh Prior).",
    version=f"dmp {__version__}",
    default_parameter=Parameter(negative=()),
)


def _setting_options() -> Any:
    """Return a dataclass with one optional option for each setting; None stands for what the preset says."""
    hints = {item.name: item for item in fields(Settings)}
    options = []
    for name, item in SETTING_FIELDS.items():
        if name == "task":
            continue
        kind = Settings.__annotations__[name]
        allowed = _choices_hint(name, kind)
        default = hints[name].default
        also = " Without one: compact for denoise, best for complete." if name == "preset" else f" [compact: {default}]"
        help_text = item.metadata["help"] + also
        options.append((name, Optional[allowed], field(default=None, metadata={"help": help_text})))  # noqa: UP045
    # Named after this module: cyclopts takes a class of another module called "types" for a built-in one.
    made = make_dataclass("SettingOptions", options, kw_only=True, namespace={"__module__": __name__})
    made.__doc__ = "Settings of the training; each overrides the preset."
    return made


def _choices_hint(name: str, kind: Any) -> Any:
    allowed = choices(name)
    return Literal[allowed] if allowed else {"int": int, "float": float, "str": str}[str(kind)]


SettingOptions: Any = _setting_options()
TrainingOptions = Annotated[SettingOptions | None, Parameter(name="*", group="Settings")]

MeshPath = Annotated[Path, Parameter(help="Mesh file: OBJ, PLY, STL or OFF.")]
OutPath = Annotated[Path, Parameter(name=["--output", "-o"], help="Where to write; the suffix chooses the format.")]
RunPath = Annotated[Path | None, Parameter(help="Run folder to write; a new one in your data folder by default.")]
ReportPath = Annotated[Path | None, Parameter(help="Write a JSON report here.")]
Quiet = Annotated[bool, Parameter(name=["--quiet", "-q"], help="Say nothing but errors.")]
Verbose = Annotated[bool, Parameter(name=["--verbose", "-v"], help="Say more.")]
AsJson = Annotated[bool, Parameter(name="--json", help="Print JSON.")]
Keep = Annotated[
    str, Parameter(help="Which step to save: auto (suggested without a ground truth), last, best (needs one), or a number.")
]


def _say(text: str, quiet: bool = False) -> None:
    if not quiet:
        Console(stderr=True, highlight=False, soft_wrap=True).print(text, markup=False)


def _load(path: Path, quiet: bool = False) -> TriangleMesh:
    from dmp.meshio import read_mesh_with_notes

    mesh, notes = read_mesh_with_notes(path)
    for note in notes:
        _say(f"{path}: {note}", quiet)
    return mesh


def _check_output(path: Path) -> None:
    """Refuse an output that could not be written after the work is done (raises :class:`MeshFileError`)."""
    from dmp.meshio import WRITABLE_SUFFIXES

    if path.suffix.lower() not in WRITABLE_SUFFIXES:
        raise MeshFileError(path, "the name says no format that can be written", f"End it in {', '.join(WRITABLE_SUFFIXES)}.")
    if path.is_dir() or not path.absolute().parent.is_dir():
        cause = "this is a folder" if path.is_dir() else f"the folder {path.parent} does not exist"
        raise MeshFileError(path, cause, "Name a file in a folder that exists.")
    if not os.access(path.absolute().parent, os.W_OK):
        raise MeshFileError(path, f"the folder {path.parent} cannot be written to", "Choose another folder.")


@app.command
def denoise(
    mesh: MeshPath,
    /,
    *,
    output: OutPath,
    ground_truth: Annotated[Path | None, Parameter(help="Clean version of the mesh, only to measure by.")] = None,
    keep: Keep = "auto",
    run: RunPath = None,
    report: ReportPath = None,
    options: TrainingOptions = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Remove the noise from a mesh: train on it, and save the prediction of one step."""
    given = _given(options)
    settings = settings_for("denoise", **given)
    if settings.method != "prior" and given.get("hold_out"):
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


@app.command
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
    options: TrainingOptions = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Fill the holes of a mesh, and let the network carry the mesh's own structure into them."""
    from dmp.errors import NoHolesError
    from dmp.meshio import write_mesh

    given = _given(options)
    if denoise_too and given.get("preset", "compact") == "best":
        raise SettingsError("--denoise cannot be combined with --preset best, which leaves known vertices where they are.")
    settings = settings_for("complete", **({**DENOISE_TOO, **given} if denoise_too else given))
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
            _say(f"{mesh}: {error} Its noise is removed.", quiet)
            return _restore(
                mesh, settings_for("denoise", **given), output=output, ground_truth=ground_truth, keep=keep, run=run,
                report=report, quiet=quiet, verbose=verbose,
            )  # fmt: skip
        write_mesh(output, _load(mesh, quiet=True))
        _say(f"{mesh}: {error} It was written to {output} as it is.", quiet)
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
    from dmp.cli_training import check_keep, save_result, train_into
    from dmp.completion import problem_for
    from dmp.runs import Run

    check_keep(keep, settings, has_truth=ground_truth is not None)
    _check_output(output)
    for source in (mesh, ground_truth):
        if source is not None and output.exists() and source.exists() and output.samefile(source):
            raise MeshFileError(output, "this is the file that is read", "Name another one, so that it stays as it is.")
    if report is not None and not report.absolute().parent.is_dir():
        raise SettingsError(f"--report {report}: the folder {report.parent} does not exist.")
    damaged = _load(mesh, quiet)
    truth = None if ground_truth is None else _load(ground_truth, quiet)
    problem = problem_for(damaged, settings, truth)
    for note in problem.notes:
        _say(note, quiet)
    made = Run.create(problem, settings, folder=run, input_path=mesh, ground_truth_path=ground_truth)
    _say(f"Run: {made.folder}", quiet)
    finished = train_into(made, quiet=quiet, verbose=verbose)
    return save_result(made, finished, keep=keep, output=output, report=report, quiet=quiet)


@app.command
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
    from dmp.cli_training import check_keep, save_result, train_into
    from dmp.runs import Run

    opened = Run.open(_run_folder(run))
    check_keep(keep, opened.settings, has_truth=opened.problem().ground_truth is not None, last_step=steps)
    if output is not None:
        _check_output(output)
    finished = train_into(opened, steps=steps, quiet=quiet, verbose=verbose)
    return save_result(opened, finished, keep=keep, output=output, report=report, quiet=quiet)


@app.command
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
    from dmp.cli_training import choose_step
    from dmp.meshio import write_mesh
    from dmp.runs import Run

    opened = Run.open(_run_folder(run))
    chosen = choose_step(opened, step or ("kept" if opened.kept_step is not None else "suggested"))
    notes = write_mesh(output, opened.mesh_at(chosen))
    _say(" ".join((f"Step {chosen} written to {output}.", *notes)), quiet)
    return EXIT_DONE


@app.command
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
        _say(f"There are no runs in {folder or default_runs_folder()}.")
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


@app.command
def metrics(mesh: MeshPath, reference: MeshPath, /, *, json: AsJson = False) -> int:
    """Compare a mesh with its ground truth: angle between the normals, distance of the vertices.

    The reference is brought to the scale and place of the mesh first, without rotation; the angles don't depend on that.
    Where the two have other faces, as after a completion, the distance between their surfaces is measured as they lie.
    """
    from dmp.geometry import face_areas
    from dmp.metrics import GroundTruth, angular_differences

    left, right = _load(mesh, quiet=json), _load(reference, quiet=json)
    if not left.same_connectivity(right):
        return _surface_metrics(left, right, as_json=json)
    truth = GroundTruth.for_input(right, left)
    angles = angular_differences(left.vertices, truth.normals, left.faces)
    areas = face_areas(truth.mesh.vertices, truth.mesh.faces)
    values = {
        **truth.measures(left.vertices),
        "mad_area_weighted": float((angles * areas).sum() / areas.sum()),
        "mean_edge_length": truth.edge_length,
        "alignment_scale": truth.alignment.scale,
        "alignment_shift": truth.alignment.shift.tolist(),
    }
    if json:
        print(json_module.dumps(values, indent=2))
    else:
        print(f"mean angular difference  {values['mad']:.3f} degrees ({values['mad_area_weighted']:.3f} weighted by area)")
        print(f"mean vertex distance     {values['vertex_error']:.4f} mean edge lengths (of {truth.edge_length:.6g})")
        print(f"after bringing the reference to scale {truth.alignment.scale:.6g} and moving it")
    return EXIT_DONE


def _surface_metrics(mesh: TriangleMesh, reference: TriangleMesh, *, as_json: bool) -> int:
    from dmp.geometry import mean_edge_length
    from dmp.surface_distance import distance_to_surface
    from dmp.topology import unique_edges

    edge_length = mean_edge_length(reference.vertices, unique_edges(reference.faces))
    there = distance_to_surface(mesh.vertices, reference) / edge_length
    back = distance_to_surface(reference.vertices, mesh) / edge_length
    values = {
        "surface_distance": float(there.mean()),
        "surface_distance_max": float(there.max()),
        "surface_distance_back": float(back.mean()),
        "surface_distance_back_max": float(back.max()),
        "mean_edge_length": edge_length,
    }
    if as_json:
        print(json_module.dumps(values, indent=2))
        return EXIT_DONE
    print("the meshes have other faces, so the distances of vertices to the other surface are measured, as the meshes lie:")
    for name, distances in (("mesh to reference", there), ("reference to mesh", back)):
        print(
            f"{name}  {distances.mean():.4f} mean edge lengths (at most {distances.max():.3f}; edge length {edge_length:.6g})"
        )
    return EXIT_DONE


@app.command
def info(mesh: MeshPath, /, *, json: AsJson = False) -> int:
    """Describe a mesh: size, connectivity, and whether it can be trained on."""
    from dmp.mesh_info import describe_mesh, description_text
    from dmp.meshio import read_mesh_with_notes

    loaded, notes = read_mesh_with_notes(mesh)
    values = {"file": str(mesh), **describe_mesh(loaded), "notes": list(notes)}
    print(json_module.dumps(values, indent=2) if json else description_text(values))
    return EXIT_DONE


@app.command
def noise(
    mesh: MeshPath,
    /,
    *,
    output: OutPath,
    level: Annotated[float, Parameter(help="Standard deviation in mean edge lengths.")] = 0.2,
    kind: Annotated[
        Literal["normal", "gaussian", "uniform", "impulsive", "scanner"], Parameter(help="Kind of noise.")
    ] = "gaussian",
    seed: Annotated[int, Parameter(help="Seed of the random numbers.")] = 0,
    quiet: Quiet = False,
) -> int:
    """Add synthetic noise to a mesh, for experiments."""
    from dmp.meshio import write_mesh
    from dmp.noise import add_noise

    _check_output(output)
    write_mesh(output, add_noise(_load(mesh, quiet), level, kind=kind, seed=seed))
    _say(f"Noise '{kind}' of {level:g} mean edge lengths written to {output}.", quiet)
    return EXIT_DONE


@app.command
def smooth(
    mesh: MeshPath,
    /,
    *,
    output: OutPath,
    smoothing_steps: Annotated[int, Parameter(help="Number of smoothing steps.")] = 30,
    quiet: Quiet = False,
) -> int:
    """Write the smoothed mesh from which displacements are predicted."""
    from dmp.meshio import write_mesh
    from dmp.settings import check
    from dmp.smoothing import laplacian_smoothing

    steps = check("smoothing_steps", smoothing_steps)
    _check_output(output)
    loaded = _load(mesh, quiet)
    write_mesh(output, loaded.with_vertices(laplacian_smoothing(loaded, steps)))
    _say(f"{steps} smoothing steps written to {output}.", quiet)
    return EXIT_DONE


@app.command
def benchmark(
    mesh: Annotated[Path | None, Parameter(help="Mesh file; by default a sample.")] = None,
    /,
    *,
    width_divisor: Annotated[int, Parameter(help="1 for the full width of the published network.")] = 1,
    rounds: Annotated[int, Parameter(help="Steps of each rival; they take turns.")] = 5,
    threads: Annotated[int, Parameter(help="Processor threads; 0 for all.")] = 0,
    json: AsJson = False,
) -> int:
    """Measure the time of a training step beside torch_geometric's GCNConv, in turns in one process."""
    from dmp.benchmark import compare_steps, comparison_text
    from dmp.samples import sample

    loaded = _load(mesh or sample("bumpy-sphere").mesh_path, quiet=json)
    values = compare_steps(loaded, width_divisor=width_divisor, rounds=rounds, threads=threads)
    print(json_module.dumps(values, indent=2) if json else comparison_text(values))
    return EXIT_DONE


def _run_folder(named: Path) -> Path:
    """Return the folder itself, or the one of that name among the runs in the user's data folder."""
    from dmp.runs import default_runs_folder, is_run_folder

    among_runs = default_runs_folder() / named
    return among_runs if not named.exists() and is_run_folder(among_runs) else named


def _given(options: Any) -> dict[str, Any]:
    values = {} if options is None else {item.name: getattr(options, item.name) for item in fields(options)}
    return {name: value for name, value in values.items() if value is not None}


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and leave the process with its exit code."""
    spin_only_briefly()
    try:
        code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
    except cyclopts.CycloptsError as error:
        _say(f"dmp: {' '.join(str(error).split())} Try 'dmp --help'.")
        code = EXIT_USAGE
    except DmpError as error:
        _say(f"dmp: {error}")
        code = EXIT_USAGE
    except KeyboardInterrupt:
        _say("dmp: interrupted.")
        code = EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone, as in `dmp runs | head`; nothing is left to say it to.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_DONE
    except Exception as error:
        if os.environ.get("DMP_DEBUG"):
            raise
        _say(
            f"dmp: this is a fault of the program: {type(error).__name__}: {error}. "
            "Set DMP_DEBUG=1 and run it again for details to report."
        )
        code = EXIT_FAULT
    sys.exit(code if isinstance(code, int) else EXIT_DONE)
