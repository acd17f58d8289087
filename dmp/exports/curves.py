"""The training curve as a table and as a chart."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from dmp.errors import DmpError, MeshFileError
from dmp.exports.drawing import check_target
from dmp.files import atomic_write_bytes, in_words
from dmp.measure_names import MEASURE_BY_NAME, MEASURES, axis_text
from dmp.runs import Run
from dmp.settings import Settings

CURVE_SUFFIXES = (".csv", ".png", ".svg", ".pdf")
# The colours of the window; each measure is told apart by its dashes as well.
_COLORS = {
    "data_loss": "#1f66c1", "laplacian_loss": "#b35900", "position_loss": "#1f66c1", "normal_loss": "#b35900",
    "inserted_movement": "#6f42c1", "made_up_error": "#c2255c", "hole_distance": "#5c940d", "hole_normal_error": "#00796b",
    "total_loss": "#57606a", "held_out_error": "#c2255c", "held_out_risk": "#c2255c",
    "held_out_excess": "#e0569b", "held_out_lowest_step": "#868e96", "held_out_normal_error": "#e0569b",
    "displacement": "#6f42c1", "input_distance": "#0b7285", "vertex_error": "#5c940d", "mad": "#00796b",
}  # fmt: skip
_LONG, _DASH_DOT = (0, (5, 2)), (0, (6, 2, 1.5, 2))
_DASHES = {
    "laplacian_loss": _LONG, "normal_loss": _LONG, "mad": _DASH_DOT, "hole_normal_error": _DASH_DOT,
    "total_loss": (0, (1, 1.5)), "vertex_error": (0, (3, 1.5)), "displacement": (0, (2, 2)),
    "input_distance": (0, (4, 1, 1, 1)),
    "held_out_normal_error": (0, (1.5, 1)), "hole_distance": (0, (3, 1.5)),
}  # fmt: skip
_MARK_COLORS = {"kept": "#1a7f37", "suggested": "#8250df", "best": "#00796b", "shown": "#57606a"}
_CHART_INCHES = (8.0, 4.0)


def curve_columns(rows: Sequence[Mapping[str, float]]) -> list[str]:
    """Return the columns of a curve: step, seconds, then what was measured, in the order in which it is told to people."""
    found = {name for row in rows for name in row} - {"step", "seconds"}
    known = [measure.name for measure in MEASURES if measure.name in found]
    return ["step", "seconds", *known, *sorted(found - set(known))]


def curve_csv(rows: Sequence[Mapping[str, float]]) -> bytes:
    """Return a curve as CSV, with all digits of its numbers; what was not measured at a step is empty."""
    columns = curve_columns(rows)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        writer.writerow([_digits(name, row[name]) if name in row else "" for name in columns])
    return text.getvalue().encode()


def curve_chart(
    rows: Sequence[Mapping[str, float]],
    settings: Settings | None,
    *,
    kind: str = "png",
    measures: Sequence[str] = (),
    marks: Mapping[str, int] | None = None,
    title: str = "",
    log: bool = True,
    inches: tuple[float, float] = _CHART_INCHES,
    legend_columns: int = 4,
) -> bytes:
    """Return a chart of a curve.

    Args:
        rows: as :meth:`dmp.runs.Run.curve` gives them.
        settings: of the training, for the units.
        kind: ``png``, ``svg`` or ``pdf``.
        measures: what to draw; by default what the window shows.
        marks: steps to mark by name: ``kept``, ``suggested``, ``best``, ``shown``.
        title: above it.
        log: whether the axis of losses and errors is logarithmic.
        inches: its size.
        legend_columns: how many entries of the legend stand side by side.

    Raises:
        DmpError: when nothing that is to be drawn was measured.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = curve_columns(rows)
    names = [name for name in measures or [m.name for m in MEASURES if m.shown] if name in columns]
    if not names or not any(row["step"] > 0 for row in rows):
        raise DmpError("There is nothing to draw yet: the run has measured nothing of the kind.")
    with matplotlib.rc_context({"svg.hashsalt": "dmp", "font.size": 9, "font.family": "DejaVu Sans"}):
        figure = Figure(figsize=inches, layout="constrained")
        FigureCanvasAgg(figure)
        axis = figure.subplots()
        degrees = [name for name in names if MEASURE_BY_NAME[name].unit == "degrees"]
        lengths = [name for name in names if name not in degrees]
        right = axis.twinx() if degrees and lengths else axis
        lines = []
        for name in names:
            # The untrained network, whose loss is far off, would take most of the axis.
            points = [(row["step"], row[name]) for row in rows if name in row and row["step"] > 0 and math.isfinite(row[name])]
            lines += (right if name in degrees else axis).plot(
                [x for x, _ in points], [y for _, y in points], color=_COLORS.get(name, "#57606a"),
                linestyle=_DASHES.get(name, "-"), linewidth=1.3, label=MEASURE_BY_NAME[name].label,
            )  # fmt: skip
        axis.set_xlabel("Training step")
        axis.set_ylabel(axis_text(lengths, settings) if lengths else "Degrees")
        if right is not axis:
            right.set_ylabel("Degrees")
        if log and lengths and all(row.get(name, 1.0) > 0 for row in rows for name in lengths if row["step"] > 0):
            axis.set_yscale("log")
        axis.grid(alpha=0.25)
        axis.margins(x=0.01)
        for name, step in (marks or {}).items():
            color = _MARK_COLORS.get(name, "#57606a")
            axis.axvline(step, color=color, linewidth=1.0, linestyle=":" if name == "suggested" else "-", zorder=0)
            lines.append(matplotlib.lines.Line2D([], [], color=color, linestyle=":" if name == "suggested" else "-",
                                                 linewidth=1.0, label=f"{name.capitalize()}: step {step:,}"))  # fmt: skip
        if title:
            axis.set_title(title, fontsize=10, loc="left")
        figure.legend(
            handles=lines,
            loc="outside lower center",
            ncols=legend_columns,
            fontsize=8 if legend_columns < 6 else 7,
            frameon=False,
            handlelength=1.8,
            columnspacing=1.2,
        )
        content = io.BytesIO()
        # Without a date, equal curves give equal files.
        metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
        figure.savefig(content, format=kind, dpi=200, metadata=metadata)
    return content.getvalue()


def marks_of(run: Run) -> dict[str, int]:
    """Return the steps of a run that matter, by name: kept, suggested where there is a choice, best by the ground truth."""
    marks = {}
    rows, steps = run.curve(), run.snapshot_steps()
    if run.kept_step is not None:
        marks["kept"] = run.kept_step
    suggestion = run.suggestion()
    if suggestion is not None and any("held_out_error" in row or "held_out_risk" in row for row in rows):
        marks["suggested"] = suggestion.step
    quality = "hole_distance" if run.settings.task == "complete" else "mad"
    measured = [row for row in rows if quality in row and row["step"] in steps and row["step"] > 0]
    if measured:
        marks["best"] = int(min(measured, key=lambda row: row[quality])["step"])
    return marks


def write_curve(
    path: Path,
    rows: Sequence[Mapping[str, float]],
    settings: Settings | None,
    *,
    measures: Sequence[str] = (),
    marks: Mapping[str, int] | None = None,
    title: str = "",
    log: bool = True,
) -> None:
    """Write a curve as CSV with everything that was measured, or as a chart, by the suffix of the name.

    Raises:
        MeshFileError: when the suffix is unknown, or the file cannot be written; one that was there before is as it was then.
        DmpError: when there is nothing to write.
    """
    check_target(path, CURVE_SUFFIXES)
    if not rows:
        raise DmpError("There is no curve yet: the run has not logged a step.")
    kind = path.suffix.lower()[1:]
    content = (
        curve_csv(rows) if kind == "csv"
        else curve_chart(rows, settings, kind=kind, measures=measures, marks=marks, title=title, log=log)
    )  # fmt: skip
    write_content(path, content)


def write_content(path: Path, content: bytes) -> None:
    """Write a small file whole or not at all (raises :class:`MeshFileError`)."""
    try:
        atomic_write_bytes(path, content)
    except (OSError, ValueError) as error:
        cause = in_words(error) if isinstance(error, OSError) else "the name cannot be one of a file"
        raise MeshFileError(path, f"the file cannot be written because {cause}", "Choose another place.") from error


def _digits(name: str, value: float) -> str:
    return str(int(value)) if name == "step" else repr(float(value))
