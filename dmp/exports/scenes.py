"""What a picture shows: plain descriptions that travel to the process that draws it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dmp.exports.viewpoints import Viewpoint
from dmp.mesh import IntArray
from dmp.quantities import ColorTable

# Between the facts about a pane.
SEPARATOR = "  ·  "
LARGEST_SIDE, SMALLEST_SIDE = 8192, 64


@dataclass(frozen=True)
class Paper:
    """Colours of everything but the values, as ``#rrggbb``.

    Attributes:
        top, bottom: of the ground behind the meshes.
        text, subtle, line: of titles, facts, and lines between panes.
        mesh, mesh_edges: a mesh without values, and its edges.
        rim, halo: lines around holes and what was inserted, and what makes them stand out.
    """

    top: str = "#ffffff"
    bottom: str = "#e3e8ee"
    text: str = "#1b1f24"
    subtle: str = "#5c6670"
    line: str = "#cfd5db"
    mesh: str = "#c9ced6"
    mesh_edges: str = "#30363d"
    rim: str = "#e6007e"
    halo: str = "#ffffff"


LIGHT_PAPER = Paper()
DARK_PAPER = Paper(
    top="#2b313a", bottom="#14171b", text="#e6e9ed", subtle="#9aa5b1", line="#3a414a", mesh="#aeb6c1", mesh_edges="#0e1116",
    rim="#ff4fb0", halo="#0b0d10",
)  # fmt: skip
WHITE_PAPER = Paper(bottom="#ffffff")


@dataclass(frozen=True, eq=False)
class Scale:
    """What the colours mean.

    Attributes:
        label: what is shown.
        unit: its unit, or empty.
        table: the colours, (256, 4) RGBA.
        low, high: values of the first and the last colour, in the units of the values.
        factor: by what they are multiplied for the numbers beside the colours.
    """

    label: str
    unit: str
    table: ColorTable
    low: float
    high: float
    factor: float = 1.0


@dataclass(frozen=True, eq=False)
class Shown:
    """One mesh in one pane.

    Attributes:
        positions: (V, 3) float32, units of the view.
        faces: which of the lists of faces of the :class:`Sheet` it has.
        viewpoint: from where it is seen.
        title, facts: what stands above it.
        values: (V,) coloured values; None for a bare surface.
        colors: (V, 3) uint8, colours of their own.
        normals: (V, 3) unit normals for smooth shading; None shades each face by itself.
        rims: ends of line segments drawn upon it, (n, 2, 3) float32, units of the view.
    """

    positions: NDArray[np.float32]
    faces: int
    viewpoint: Viewpoint
    title: str = ""
    facts: str = ""
    values: NDArray[np.float32] | None = None
    colors: NDArray[np.uint8] | None = None
    normals: NDArray[np.float32] | None = None
    rims: NDArray[np.float32] | None = None


@dataclass(frozen=True, eq=False)
class Cut:
    """Another mesh laid over a pane in part.

    Attributes:
        shown: the other mesh.
        mode: ``swipe``, it is left of a line, or ``lens``, it is in a circle.
        x, y: place of the line or the middle of the circle, 0 to 1 from the upper left corner of the pane.
        radius: of the circle, in heights of the pane.
    """

    shown: Shown
    mode: str
    x: float
    y: float = 0.5
    radius: float = 0.0


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture.

    Attributes:
        panes: from left to right; None for what stood there in the frame before.
        cut: laid over the last of them.
        note: stands at the lower right.
    """

    panes: tuple[Shown | None, ...]
    cut: Cut | None = None
    note: str = ""


@dataclass(frozen=True, eq=False)
class Sheet:
    """What all frames of an export share.

    Attributes:
        width, height: of the whole picture, pixels.
        faces: lists of faces, each (F, 3).
        scale: what the colours mean; None without values.
        paper: colours of the rest.
        is_transparent: whether the ground can be seen through.
        has_titles: whether names stand above the panes.
        has_scale: whether the colours are explained below them.
        has_edges: whether the edges of the triangles are drawn.
        kind: ``png`` (each frame a file), ``jpg``, ``gif`` or ``mp4`` (all frames one file).
        frames_per_second: of an animation.
        hold_seconds: for how long the last frame of an animation stays.
    """

    width: int
    height: int
    faces: tuple[IntArray, ...]
    scale: Scale | None = None
    paper: Paper = field(default_factory=Paper)
    is_transparent: bool = False
    has_titles: bool = True
    has_scale: bool = True
    has_edges: bool = False
    kind: str = "png"
    frames_per_second: float = 10.0
    hold_seconds: float = 0.0
