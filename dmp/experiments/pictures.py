"""Rows of pictures of meshes, side by side with their titles."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dmp.experiments.plots import save
from dmp.mesh import FloatArray, TriangleMesh

CANNOT_DRAW = "Pictures of meshes were left out: this machine offers no way to draw them (no display, EGL or OSMesa)."
_SIZE = 420


@dataclass(frozen=True)
class Shown:
    """One mesh in a row of pictures.

    Attributes:
        title: above it.
        mesh: what is drawn.
        angles: difference of each face's normal from the truth in degrees, (F,); None draws a plain surface.
        centre: a point to look at closely, (3,).
        radius: how far around it.
        eye: direction to the eye, (3,).
    """

    title: str
    mesh: TriangleMesh
    angles: FloatArray | None = None
    centre: FloatArray | None = None
    radius: float | None = None
    eye: FloatArray | None = None


def picture_row(path: Path, shown: Sequence[Shown], *, like: TriangleMesh, most: float = 40.0) -> Path | None:
    """Draw meshes side by side into ``path``, a PNG file.

    Args:
        path: where to.
        shown: from left to right.
        like: the mesh whose extent fills each picture.
        most: the angle of the last colour, degrees.

    Returns:
        The path, or None when this machine cannot draw.

    Raises:
        RunError: when the file cannot be written.
    """
    from dmp.rendering import can_render, picture

    if not can_render():
        return None
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.3 * len(shown) + 0.5, 2.9), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(shown), squeeze=False)[0]
    for axis, item in zip(axes, shown, strict=True):
        place = {"centre": item.centre, "radius": item.radius, "eye": item.eye}
        drawn = picture(item.mesh, item.angles, limits=(0.0, most), size=_SIZE, like=like, **place)  # type: ignore[arg-type]
        axis.imshow(drawn)
        axis.set_title(item.title, fontsize=8)
        axis.axis("off")
    if any(item.angles is not None for item in shown):
        bar = figure.colorbar(ScalarMappable(Normalize(0, most), "viridis"), ax=list(axes), shrink=0.8, pad=0.01)
        bar.set_label("degrees", fontsize=7)
        bar.ax.tick_params(labelsize=7)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=120)
    save(path, content.getvalue())
    return path
