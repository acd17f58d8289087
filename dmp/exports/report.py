"""What a colleague wants to know of a restoration, gathered from a run: pictures, numbers, settings, and how it was done."""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from dmp import __version__
from dmp.durations import duration
from dmp.errors import DmpError
from dmp.exports.curves import curve_chart, marks_of, write_content
from dmp.exports.drawing import DrawingError, check_target, drawn
from dmp.exports.of_runs import PaneName, Photographer, Wish, open_faces
from dmp.exports.report_page import Fact, Finding, Page, page
from dmp.exports.scenes import WHITE_PAPER
from dmp.exports.viewpoints import UpAxis
from dmp.exports.watching import Watch
from dmp.mesh import FloatArray, TriangleMesh
from dmp.mesh_report import mesh_report
from dmp.metrics import GroundTruth
from dmp.problem import Problem
from dmp.quantities import Quantity
from dmp.runs import Run
from dmp.settings import SETTING_FIELDS, preset_value, settings_for
from dmp.vertex_measures import distances

REPORT_SUFFIXES = (".html",)
_PICTURE_WIDTH, _PANE_HEIGHT = 2100, 680
_PARTS = 4
_TASKS = {"denoise": "Denoising", "complete": "Hole filling and completion"}
_PRESET_NAMES = {
    "best": "Best result", "compact": "Compact (Deep Mesh Prior)", "paper": "Paper (Deep Mesh Prior)",
    "paper-2021-04": "Paper, April 2021 (Deep Mesh Prior)",
}  # fmt: skip


@dataclass(frozen=True)
class Look:
    """How the pictures of a report look.

    Attributes:
        quantity: what their colours show.
        up: the axis that points up.
        eye: direction from the mesh to the eye; None looks from the front.
    """

    quantity: Quantity = "magnitude"
    up: UpAxis = "y"
    eye: tuple[float, float, float] | None = None


def write_report(path: Path, run: Run, step: int, look: Look | None = None, watch: Watch | None = None) -> tuple[str, ...]:
    """Write a report on one step of a run: one HTML file that needs nothing else, no network either.

    Args:
        path: where to; it must end in ``.html``.
        run: any run.
        step: the snapshot that is the result.
        look: of its pictures.
        watch: is told how far it is, and may cancel.

    Returns:
        Sentences on what is missing in it.

    Raises:
        MeshFileError: when it cannot be written; a file that was there before is as it was then.
        RunError: when the run cannot be read.
    """
    watch, look = watch or Watch(), look or Look()
    check_target(path, REPORT_SUFFIXES)
    problem = run.problem()
    positions = problem.exact(run.snapshot(step).vertices)
    pictures, notes = _pictures(run, step, look, watch)
    watch.tell("Looking over the mesh…", 2, _PARTS)
    given = TriangleMesh(problem.mesh.vertices[problem.known], open_faces(problem))
    # What is only good to know has to be short, for the page is full.
    findings = [
        Finding(item.severity == "warning", item.text, item.meaning if item.severity == "warning" else "")
        for item in mesh_report(given)
    ]
    watch.tell("Drawing the curve…", 3, _PARTS)
    marks = marks_of(run)
    if step not in (marks.get("kept"), marks.get("suggested"), marks.get("best")):
        marks["shown"] = step
    chart = b""
    with contextlib.suppress(DmpError):
        chart = curve_chart(run.curve(), run.settings, kind="svg", marks=marks, inches=(7.4, 2.3), legend_columns=7)
    content = page(
        Page(
            title=run.name,
            summary=_summary(run, step, marks),
            pictures=pictures,
            chart=chart,
            result=_result(problem, positions),
            quality_note=_quality_note(problem),
            columns=_columns(problem, positions, step),
            mesh=_mesh_facts(run, given, problem),
            findings=findings,
            training=_training_facts(run),
            settings=_settings(run),
            command=_command(run, step),
            made=f"Made by dmp-viewer {__version__} on {datetime.now().astimezone():%Y-%m-%d at %H:%M}",
        )
    )
    watch.tell("Writing…", _PARTS, _PARTS)
    write_content(path, content.encode())
    return notes


def _pictures(run: Run, step: int, look: Look, watch: Watch) -> tuple[bytes, tuple[str, ...]]:
    """Return a row of pictures as PNG, empty with a reason where nothing can be drawn."""
    problem = run.problem()
    panes: tuple[PaneName, ...] = ("input", "filled", "predicted") if problem.task == "complete" else ("input", "predicted")
    if problem.ground_truth is not None:
        panes = (*panes, "truth")
    wish = Wish(
        width=_PICTURE_WIDTH, height=_PANE_HEIGHT, panes=panes, quantity=look.quantity, up=look.up, eye=look.eye,
        paper=WHITE_PAPER,
    )  # fmt: skip
    try:
        sheet, frame = Photographer(run, wish).picture(step)
    except DmpError:
        # The colours that the window shows now may need something that this run has not.
        sheet, frame = Photographer(run, replace(wish, quantity="magnitude")).picture(step)

    def part(text: str, done: int, total: int) -> None:
        watch.tell(text, done, _PARTS)

    inner = Watch(part)
    watch.interrupt_with(inner.cancel)
    try:
        with drawn(sheet, [frame], 1, inner) as files:
            return files[0].read_bytes(), ()
    except DrawingError as error:
        return b"", (f"The report has no pictures. {error}",)
    finally:
        watch.interrupt_with(None)
        watch.check()


# -- words and numbers ----------------------------------------------------------------------------------------------------


def _summary(run: Run, step: int, marks: Mapping[str, int]) -> str:
    why = {
        marks.get("shown"): "",
        marks.get("best"): ", the closest to the ground truth",
        marks.get("suggested"): ", suggested by the program",
        marks.get("kept"): ", kept by a person",
    }.get(step, "")
    if not why and step == run.last_step:
        why = ", the last one"
    preset = _PRESET_NAMES.get(run.settings.preset, run.settings.preset)
    return f"{_TASKS[run.settings.task]} with the preset {preset}. The result is step {step:,} of {run.last_step:,}{why}."


def _result(problem: Problem, positions: FloatArray) -> str:
    """Return in a sentence what came out."""
    truth = problem.ground_truth
    if isinstance(truth, GroundTruth):
        before, after = truth.mad(problem.target), truth.mad(positions)
        return f"The mean angle between the normals and the ground truth went from {before:.2f}° to {after:.2f}°."
    moved = distances(positions, problem.target)[problem.known] / problem.edge_length
    if truth is not None:
        before, after = truth.measures(problem.target)["hole_distance"], truth.measures(positions)["hole_distance"]
        return (
            f"The inserted vertices lie {after:.3f} mean edge lengths from the true surface; filled holes alone would be "
            f"{before:.3f} away."
        )
    if problem.task == "complete":
        n_inserted = int((~problem.known).sum())
        return f"{n_inserted:,} vertices were inserted" + (
            ", and every other vertex stayed exactly where it was." if not moved.any() else "."
        )
    return f"The vertices were moved by {moved.mean():.3f} mean edge lengths on average, by {moved.max():.2f} at most."


def _quality_note(problem: Problem) -> str:
    unit = "Lengths in mean edge lengths unless said otherwise."
    if problem.ground_truth is None:
        return f"{unit} There is no ground truth: these numbers tell how far the mesh was changed, not how right it is."
    return f"{unit} The ground truth was only measured by; the training never saw it."


def _columns(problem: Problem, positions: FloatArray, step: int) -> list[tuple[str, list[str]]]:
    """Return the table of numbers: the names of its columns first, then rows of a name and its values."""
    states = [("Input", problem.target), ("Smoothed", problem.base), (f"Step {step:,}", positions)]
    if problem.task == "complete":
        states = [("Hole filling alone", problem.target), (f"Step {step:,}", positions)]
    rows: list[tuple[str, list[str]]] = [("", [name for name, _ in states])]
    truth = problem.ground_truth
    if truth is not None:
        labels = {
            "mad": ("Mean angle to the truth (MAD)", "{:.2f}°"),
            "vertex_error": ("Vertices to their true places, mean", "{:.3f}"),
            "hole_distance": ("Inserted vertices to true surface, mean", "{:.3f}"),
            "hole_normal_error": ("Inserted faces to true surface, angle", "{:.1f}°"),
        }
        measured = [truth.measures(state) for _, state in states]
        rows += [
            (label, [form.format(values[name]) for values in measured])
            for name, (label, form) in labels.items()
            if name in measured[0]
        ]
    known = problem.known
    moved = [distances(state, problem.target)[known] for _, state in states]
    length = problem.edge_length
    rows.append(("Moved from input, mean", [f"{values.mean() / length:.3f}" for values in moved]))
    rows.append(("Moved from input, largest", [f"{values.max() / length:.3f}" for values in moved]))
    rows.append(("The same in file units", [f"{values.max():.4g}" for values in moved]))
    volumes = [_volume(problem.mesh.with_vertices(state)) for _, state in states]
    if _is_closed(problem.mesh):
        rows.append(("Volume, file units cubed", [f"{volume:.5g}" for volume in volumes]))
    return rows


def _is_closed(mesh: TriangleMesh) -> bool:
    from dmp.topology import edge_face_counts

    return bool((edge_face_counts(mesh.faces)[1] == 2).all())


def _volume(mesh: TriangleMesh) -> float:
    """Return the volume inside a closed mesh, by the divergence theorem, around its middle for the digits' sake."""
    corners = (mesh.vertices - mesh.vertices.mean(axis=0))[mesh.faces]
    return abs(float(np.einsum("fc,fc->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum()) / 6)


def _mesh_facts(run: Run, given: TriangleMesh, problem: Problem) -> list[Fact]:
    low, high = given.vertices.min(axis=0), given.vertices.max(axis=0)
    facts = [
        Fact("File", run.input_path.name if run.input_path is not None else "not known"),
        Fact("Size", f"{given.n_vertices:,} vertices, {given.n_faces:,} faces"),
        Fact("Extent", " × ".join(f"{side:.4g}" for side in high - low) + " file units"),
        Fact("Mean edge length", f"{problem.edge_length:.4g} file units"),
    ]
    if problem.task == "complete":
        facts.append(Fact("Inserted", f"{int((~problem.known).sum()):,} vertices"))
    return facts


def _training_facts(run: Run) -> list[Fact]:
    rows = run.curve()
    seconds = rows[-1]["seconds"] if rows else 0.0
    steps = int(rows[-1]["step"]) if rows else 0
    facts = [
        Fact("Trained", f"{duration(seconds)} for {steps:,} steps" + (f", {seconds / steps:.3g} s each" if steps else "")),
        Fact("State", run.state + (f": {run.reason}" if run.reason else "")),
        Fact("Device", run.device or "not known"),
    ]
    if run.recorded_threads is not None:
        facts.append(Fact("Threads", str(run.recorded_threads)))
    facts.append(Fact("Begun", run.created.replace("T", " at ")[:19]))
    facts.append(Fact("Versions", ", ".join(f"{name} {version}" for name, version in run.versions.items()) or "not known"))
    facts.append(Fact("Run folder", run.folder.absolute().name))
    return facts


def _settings(run: Run) -> list[tuple[Fact, bool]]:
    """Return all settings, each with whether it differs from its preset."""
    settings = run.settings
    found = []
    for name, value in asdict(settings).items():
        if name in ("task", "preset"):
            continue
        usual = preset_value(name, settings.task, settings.preset)
        shown = f"{value:g}" if isinstance(value, float) else ("off", "on")[value] if isinstance(value, bool) else str(value)
        found.append((Fact(name.replace("_", " "), shown), value != usual))
    return found


def _command(run: Run, step: int) -> str:
    """Return the command line that makes the same again."""
    settings = run.settings
    usual = asdict(settings_for(settings.task, settings.preset))
    words = ["dmp", settings.task, run.input_path.name if run.input_path is not None else "MESH", "-o", "RESULT.ply"]
    named = {"preset": settings.preset} | {
        name: value for name, value in asdict(settings).items() if name in SETTING_FIELDS and value != usual[name]
    }
    for name, value in named.items():
        option = f"--{name.replace('_', '-')}"
        if isinstance(value, bool):
            words.append(option if value else f"--no-{option[2:]}")
        else:
            words += [option, f"{value:g}" if isinstance(value, float) else str(value)]
    return shlex.join([*words, "--keep", str(step)])
