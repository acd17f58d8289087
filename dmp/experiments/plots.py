"""Charts of curves as PNG and SVG files."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dmp.errors import RunError
from dmp.files import atomic_write_bytes, in_words

_COLOURS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#555555")


@dataclass(frozen=True)
class Line:
    """A curve.

    Attributes:
        label: in the legend; empty for none.
        x: positions.
        y: values; None leaves a point out.
        colour: index of the colour.
        is_dashed: whether it is drawn with dashes.
    """

    label: str
    x: Sequence[float | None]
    y: Sequence[float | None]
    colour: int = 0
    is_dashed: bool = False


@dataclass(frozen=True)
class Panel:
    """One chart among those drawn side by side."""

    title: str
    lines: Sequence[Line]


def chart(
    path: Path, panels: Sequence[Panel], *, x_label: str, y_label: str, log_y: bool = False, same_y: bool = False
) -> list[Path]:
    """Draw panels side by side.

    Args:
        path: where to, without a suffix.
        panels: from left to right.
        x_label: below them.
        y_label: beside the first.
        log_y: whether the vertical axis is logarithmic.
        same_y: whether all share it.

    Returns:
        The PNG and the SVG file.

    Raises:
        RunError: when they cannot be written.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # Same curves, same files.
    with matplotlib.rc_context({"svg.hashsalt": "dmp", "font.size": 9}):
        figure = Figure(figsize=(1.2 + 3.8 * len(panels), 3.2), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(1, len(panels), squeeze=False, sharey=same_y)[0]
        for axis, panel in zip(axes, panels, strict=True):
            for line in panel.lines:
                points = [(x, y) for x, y in zip(line.x, line.y, strict=True) if x is not None and y is not None]
                if not points:
                    continue
                axis.plot(
                    [x for x, _ in points],
                    [y for _, y in points],
                    "--" if line.is_dashed else "-",
                    color=_COLOURS[line.colour % len(_COLOURS)],
                    label=line.label or None,
                    linewidth=1.2,
                )
            axis.set_title(panel.title, fontsize=9)
            axis.set_xlabel(x_label)
            axis.grid(alpha=0.25)
            if log_y:
                axis.set_yscale("log")
            if axis.get_legend_handles_labels()[1]:
                axis.legend(fontsize=7)
        axes[0].set_ylabel(y_label)
        written = []
        for suffix, options in ((".png", {"dpi": 110}), (".svg", {"metadata": {"Date": None}})):
            content = io.BytesIO()
            figure.savefig(content, format=suffix[1:], **options)
            written.append(path.with_name(path.name + suffix))
            save(written[-1], content.getvalue())
    return written


def save(path: Path, content: bytes) -> None:
    """Write a file of an experiment (raises :class:`RunError`)."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_write_bytes(path, content)
    except OSError as error:
        raise RunError(f"{path} cannot be written: {in_words(error)}. Name another folder with --out.") from error
