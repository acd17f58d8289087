"""``dmp picture``, ``dmp animate``, ``dmp curve`` and ``dmp report``: what is shown to others of a run."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from dmp.commands.common import EXIT_DONE, load, refuse_as_output, refuse_within_run, run_folder, say
from dmp.commands.options import Quiet
from dmp.errors import SettingsError
from dmp.quantities import QUANTITIES, Quantity

if TYPE_CHECKING:
    from dmp.exports.of_runs import PaneName, Wish
    from dmp.exports.watching import Watch
    from dmp.runs import Run

ColourName = Literal["displacement", "signed", "input-distance", "error", "normal-error", "curvature", "normals", "plain"]
_QUANTITIES: dict[str, Quantity] = {
    "displacement": "magnitude", "signed": "signed", "input-distance": "input_distance", "error": "error",
    "normal-error": "normal_error", "curvature": "curvature", "normals": "normals", "plain": "plain",
}  # fmt: skip
_SIZE = re.compile(r"([0-9]{2,5})[xX×]([0-9]{2,5})")
_STEP_HELP = "A number, 'kept', 'suggested', 'best' or 'last'; by default the kept step, else the suggested one."
_Run = Annotated[Path, Parameter(help="Run folder, or its name among your runs.")]
_Step = Annotated[str, Parameter(help=_STEP_HELP)]
_LOOK = Group("Look", sort_key=5)


@Parameter(name="*", group=_LOOK)
@dataclass(frozen=True, kw_only=True)
class LookOptions:
    """How pictures look.

    Attributes:
        panes: comma-separated.
        size: width x height.
        colour_by: what the colours show.
        unit: of the numbers beside the colours.
        limits: both ends of the colours.
        outliers: whether the range covers every vertex.
        smooth, edges, transparent: how surfaces and ground are drawn.
        up, eye: from where they are seen.
        theme: colours of the ground.
        titles, scale: whether they are drawn.
    """

    panes: Annotated[
        str, Parameter(help="What stands side by side: input, smoothed, predicted, truth, filled (hole filling alone).")
    ] = ""
    size: Annotated[str, Parameter(help="Width x height of the whole picture in pixels, up to 8192x8192.")] = ""
    colour_by: Annotated[
        ColourName, Parameter(name=["--colour-by", "--color-by"], help="What the colours show. error needs a ground truth.")
    ] = "displacement"
    unit: Annotated[
        Literal["edges", "file", "diagonal"],
        Parameter(help="Unit beside the colours: mean edge lengths, units of the file, or per cent of the diagonal."),
    ] = "edges"
    limits: Annotated[
        tuple[float, float] | None, Parameter(help="Values of the first and the last colour; by default from what is shown.")
    ] = None
    outliers: Annotated[bool, Parameter(help="Let the range of the colours cover every vertex.")] = False
    smooth: Annotated[bool, Parameter(help="Smooth shading; by default each face is seen.")] = False
    edges: Annotated[bool, Parameter(help="Draw the edges of the triangles.")] = False
    transparent: Annotated[bool, Parameter(help="No ground behind the meshes (PNG only).")] = False
    up: Annotated[Literal["y", "z"], Parameter(help="The axis that points up.")] = "y"
    eye: Annotated[tuple[float, float, float] | None, Parameter(help="Direction from the mesh to the eye.")] = None
    theme: Annotated[Literal["light", "dark", "white"], Parameter(help="Colours of the ground and the writing.")] = "light"
    titles: Annotated[bool, Parameter(negative="--no-titles", help="Write names and measures above the meshes.")] = True
    scale: Annotated[bool, Parameter(negative="--no-scale", help="Explain the colours below the meshes.")] = True


def picture(
    source: Annotated[Path, Parameter(help="Run folder, its name among your runs, or a mesh file.")],
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Where to write: .png or .jpg.")],
    step: _Step = "",
    look: LookOptions | None = None,
    quiet: Quiet = False,
) -> int:
    """Draw the meshes of a run side by side, or one mesh file."""
    from dmp.exports.drawing import PICTURE_SUFFIXES, check_target, write_drawing
    from dmp.exports.of_runs import Photographer, mesh_picture

    check_target(output, PICTURE_SUFFIXES)
    options = look or LookOptions()
    if options.transparent and output.suffix.lower() != ".png":
        raise SettingsError("--transparent needs a PNG file, because JPEG cannot be seen through.")
    named = run_folder(source)
    if named.is_file():
        if step or options.panes:
            raise SettingsError(f"{source} is a mesh, so it has no steps and no panes. Leave --step and --panes out.")
        if options.colour_by not in ("displacement", "curvature", "normals", "plain"):
            raise SettingsError(f"A mesh alone has no {options.colour_by}. Choose curvature, normals or plain.")
        refuse_as_output(output, named)
        wish = _wish(options, (1200, 1000), ("input",))
        sheet, frame = mesh_picture(load(named, quiet), named.name, wish)
    else:
        run = _open(named)
        wish = _wish(options, (2400, 1000), _usual_panes(run))
        sheet, frame = Photographer(run, wish).picture(_step(run, step))
    with _watched(quiet) as watch:
        write_drawing(output, replace(sheet, kind="png" if output.suffix.lower() == ".png" else "jpg"), [frame], 1, watch)
    say(f"The picture was written to {output}.", quiet)
    return EXIT_DONE


def animate(
    run: _Run,
    /,
    *,
    output: Annotated[
        Path, Parameter(name=["--output", "-o"], help="Where to write: .gif, or .mp4 where ffmpeg is installed.")
    ],
    turntable: Annotated[bool, Parameter(help="Turn the mesh of one step once around, instead of showing all steps.")] = False,
    step: Annotated[str, Parameter(help=f"Of the turntable. {_STEP_HELP}")] = "",
    first: Annotated[int, Parameter(help="First step to show.")] = 0,
    last: Annotated[int | None, Parameter(help="Last step to show; by default all.")] = None,
    turn: Annotated[float, Parameter(help="Degrees by which the mesh turns while the steps go by.")] = 0.0,
    seconds: Annotated[float | None, Parameter(help="Length; by default 6 for a turntable, a tenth for each step.")] = None,
    fps: Annotated[float | None, Parameter(help="Frames per second; by default 10, of a turntable 15.")] = None,
    hold: Annotated[float, Parameter(help="Seconds for which the last frame of the steps stays.")] = 2.0,
    look: LookOptions | None = None,
    quiet: Quiet = False,
) -> int:
    """Make an animation of the steps of a run, or of one step turned around."""
    from dmp.exports.animations import Plan, planned
    from dmp.exports.drawing import ANIMATION_SUFFIXES, check_target, write_drawing
    from dmp.exports.of_runs import Photographer

    check_target(output, ANIMATION_SUFFIXES)
    opened = _open(run_folder(run))
    options = look or LookOptions()
    if options.transparent:
        raise SettingsError("--transparent is for pictures; an animation always has a ground.")
    kind = output.suffix.lower()[1:]
    plan = Plan(
        turntable, _step(opened, step) if turntable else 0, first, last, 360.0 if turntable else turn, seconds, fps, hold
    )
    frames = planned(plan, opened.snapshot_steps())
    usual: tuple[PaneName, ...] = ("predicted",) if turntable else ("input", "predicted")
    wish = _wish(options, (640, 640) if turntable else (1000, 560), usual, is_even=kind == "mp4")
    sheet, drawn = Photographer(opened, wish).animation(
        frames.steps, kind=kind, frames_per_second=frames.frames_per_second, turn=plan.turn, hold_seconds=frames.hold_seconds
    )
    with _watched(quiet) as watch:
        write_drawing(output, sheet, drawn, len(frames.steps), watch)
    say(f"The animation, {len(frames.steps)} frames, was written to {output}.", quiet)
    return EXIT_DONE


def curve(
    run: _Run,
    /,
    *,
    output: Annotated[
        Path,
        Parameter(name=["--output", "-o"], help="Where to write: .csv with all numbers, or a chart as .png, .svg or .pdf."),
    ],
    measure: Annotated[
        list[str] | None, Parameter(help="Draw this column of the CSV; may be given several times.", negative=())
    ] = None,
    linear: Annotated[bool, Parameter(help="Linear axis for losses and errors instead of a logarithmic one.")] = False,
    quiet: Quiet = False,
) -> int:
    """Write the training curve of a run as a table or as a chart."""
    from dmp.exports.curves import CURVE_SUFFIXES, curve_columns, marks_of, write_curve
    from dmp.exports.drawing import check_target

    check_target(output, CURVE_SUFFIXES)
    opened = _open(run_folder(run))
    refuse_within_run(output, opened.folder)
    rows = opened.curve()
    known = [name for name in curve_columns(rows) if name not in ("step", "seconds")]
    for name in measure or ():
        if name not in known:
            raise SettingsError(f"--measure {name}: this run has measured {', '.join(known) or 'nothing yet'}.")
    write_curve(
        output, rows, opened.settings, measures=measure or (), marks=marks_of(opened), title=opened.name, log=not linear
    )
    say(f"The curve was written to {output}.", quiet)
    return EXIT_DONE


def report(
    run: _Run,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Where to write: .html.")],
    step: _Step = "",
    colour_by: Annotated[
        ColourName, Parameter(name=["--colour-by", "--color-by"], help="What the colours of the pictures show.")
    ] = "displacement",
    up: Annotated[Literal["y", "z"], Parameter(help="The axis that points up.")] = "y",
    eye: Annotated[tuple[float, float, float] | None, Parameter(help="Direction from the mesh to the eye.")] = None,
    quiet: Quiet = False,
) -> int:
    """Write a one-page report on a run: pictures, numbers, settings and curve in one HTML file to send and to print."""
    from dmp.exports.drawing import check_target
    from dmp.exports.report import REPORT_SUFFIXES, Look, write_report

    check_target(output, REPORT_SUFFIXES)
    opened = _open(run_folder(run))
    look = Look(quantity_named(colour_by, opened) or "magnitude", up, eye)
    with _watched(quiet) as watch:
        notes = write_report(output, opened, _step(opened, step), look, watch)
    say(" ".join((f"The report was written to {output}.", *notes)), quiet)
    return EXIT_DONE


def quantity_named(name: str | None, run: Run) -> Quantity | None:
    """Return the quantity of an option (raises :class:`SettingsError` when this run cannot show it)."""
    from dmp.exports.meshes import possible_quantities

    quantity = None if name is None else _QUANTITIES[name]
    if quantity is not None and quantity not in possible_quantities(run.problem()):
        raise SettingsError(f"--colour-by {name}: that needs {QUANTITIES[quantity].needs}, and this run has none.")
    return quantity


# -- helpers --------------------------------------------------------------------------------------------------------------


def _open(folder: Path) -> Run:
    from dmp.runs import Run

    return Run.open(folder)


def _step(run: Run, wanted: str) -> int:
    from dmp.commands.outcome import choose_step

    return choose_step(run, wanted or ("kept" if run.kept_step is not None else "suggested"))


def _usual_panes(run: Run) -> tuple[PaneName, ...]:
    return ("input", "filled", "predicted") if run.settings.task == "complete" else ("input", "smoothed", "predicted")


def _wish(options: LookOptions, size: tuple[int, int], panes: tuple[PaneName, ...], *, is_even: bool = False) -> Wish:
    from dmp.exports.of_runs import PANES, Wish
    from dmp.exports.scenes import DARK_PAPER, LIGHT_PAPER, WHITE_PAPER

    if options.size:
        found = _SIZE.fullmatch(options.size.replace(" ", ""))
        if found is None:
            raise SettingsError(f"--size is '{options.size}', but must be width x height in pixels, such as 3840x1600.")
        size = int(found[1]), int(found[2])
    if options.panes:
        known = {str(name): name for name in PANES}
        names = [name.strip() for name in options.panes.split(",")]
        if unknown := [name for name in names if name not in known]:
            raise SettingsError(f"--panes: there is no '{unknown[0]}'. Choose from {', '.join(PANES)}.")
        panes = tuple(known[name] for name in names)
    limits = options.limits
    if limits is not None and not limits[0] < limits[1]:
        raise SettingsError(f"--limits {limits[0]:g} {limits[1]:g}: the second must be larger than the first.")
    if options.eye is not None and not any(options.eye):
        raise SettingsError("--eye 0 0 0 is no direction.")
    # Video is coded in blocks of two by two pixels.
    width, height = (side - side % 2 if is_even else side for side in size)
    return Wish(
        width=width, height=height, panes=panes, quantity=_QUANTITIES[options.colour_by],
        unit=options.unit, limits=limits, outliers=options.outliers, up=options.up, eye=options.eye,
        is_smooth=options.smooth, has_edges=options.edges, is_transparent=options.transparent, has_titles=options.titles,
        has_scale=options.scale, paper={"light": LIGHT_PAPER, "dark": DARK_PAPER, "white": WHITE_PAPER}[options.theme],
    )  # fmt: skip


@contextmanager
def _watched(quiet: bool) -> Iterator[Watch]:
    """Yield what shows progress on a terminal, and says nothing elsewhere."""
    from dmp.exports.watching import Watch

    console = Console(stderr=True, highlight=False, quiet=quiet)
    if quiet or not console.is_terminal:
        yield Watch()
        return
    bar = Progress(TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=console, transient=True)
    with bar:
        task = bar.add_task("Preparing…", total=None)
        yield Watch(lambda text, done, total: bar.update(task, description=text, completed=done, total=total or None))
