"""Puts drawn meshes together into one picture: panes side by side, titles above, the colours explained below.

All writing is done here, not by VTK, so that it is sharp at every size.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont

from dmp.exports.layout import Layout
from dmp.exports.scenes import SEPARATOR, Cut, Paper, Scale, Sheet, Shown
from dmp.quantities import nice_ticks, tick_text

if TYPE_CHECKING:
    from dmp.exports.scenes import Frame
    from dmp.rendering import Studio

_GAP = 12  # between name and facts, in twelfths of the height of the writing


class Composer:
    """Turns frames into pictures.

    Args:
        sheet: what all of them share.
        studio: draws a mesh of the size of a pane, made when it is first needed.
    """

    def __init__(self, sheet: Sheet) -> None:
        self._sheet = sheet
        self._studios: dict[tuple[int, int], Studio] = {}
        # A pane that stays as it is from frame to frame is drawn once.
        self._drawn: dict[int, tuple[Shown, NDArray[np.uint8]]] = {}
        self._panes: tuple[Shown, ...] = ()

    def close(self) -> None:
        """Give the resources back."""
        for studio in self._studios.values():
            studio.close()

    def compose(self, frame: Frame) -> Image.Image:
        """Return the picture of a frame: RGBA when the ground can be seen through, RGB otherwise."""
        sheet = self._sheet
        layout = Layout(sheet, len(frame.panes))
        panes = tuple(self._panes[index] if shown is None else shown for index, shown in enumerate(frame.panes))
        self._panes = panes
        ground = _ground(sheet)
        for index, (shown, (left, top, width, height)) in enumerate(zip(panes, layout.panes, strict=True)):
            drawn = self._draw(index, shown, width, height)
            if frame.cut is not None and index == len(frame.panes) - 1:
                drawn = _cut(drawn, self._draw(-1, frame.cut.shown, width, height), frame.cut)
            _lay_over(ground[top : top + height, left : left + width], drawn)
        picture = Image.fromarray(ground)
        del ground
        pen = ImageDraw.Draw(picture)
        paper, size = sheet.paper, layout.text_size
        for left, _, _, _ in layout.panes[1:]:
            pen.line([(left, 0), (left, layout.title_height + layout.panes[0][3])], paper.line, max(1, size // 12))
        if sheet.has_titles:
            for shown, (left, _, width, _) in zip(panes, layout.panes, strict=True):
                _write_title(pen, shown, (left, left + width), size, paper)
        if layout.bar_height and sheet.scale is not None:
            _draw_scale(picture, sheet.scale, layout, paper.text, paper.line)
        if frame.note:
            font = _font(size)
            place = (sheet.width - 0.6 * size, layout.title_height + layout.panes[0][3] - 0.6 * size)
            pen.text(place, frame.note, paper.subtle, font, anchor="rd")
        return picture

    def _draw(self, index: int, shown: Shown, width: int, height: int) -> NDArray[np.uint8]:
        known = self._drawn.get(index)
        if known is not None and known[0] is shown:
            return known[1]
        if not len(shown.positions):
            return np.zeros((height, width, 4), dtype=np.uint8)
        from dmp.rendering import Studio

        sheet = self._sheet
        if (width, height) not in self._studios:
            self._studios[width, height] = Studio(width, height, has_edges=sheet.has_edges)
        scale, paper = sheet.scale, sheet.paper
        drawn = self._studios[width, height].draw(
            shown.positions, sheet.faces[shown.faces], shown.viewpoint,
            color=paper.mesh, edge_color=paper.mesh_edges, values=shown.values, table=None if scale is None else scale.table,
            limits=(0.0, 1.0) if scale is None else (scale.low, scale.high), colors=shown.colors, normals=shown.normals,
            lines=shown.rims, line_color=paper.rim, halo_color=paper.halo,
        )  # fmt: skip
        self._drawn[index] = (shown, drawn)
        return drawn


def _ground(sheet: Sheet) -> NDArray[np.uint8]:
    """Return the empty picture, (height, width, 3 or 4)."""
    if sheet.is_transparent:
        empty = np.zeros((sheet.height, sheet.width, 4), dtype=np.uint8)
        # Writing is mixed with what is there, which must not darken or lighten its edges.
        empty[..., :3] = ImageColor.getrgb(sheet.paper.text)[:3]
        return empty
    top, bottom = (np.array(ImageColor.getrgb(color)[:3], dtype=np.float64) for color in (sheet.paper.top, sheet.paper.bottom))
    share = np.linspace(0.0, 1.0, sheet.height)[:, None]
    rows = (top + share * (bottom - top)).round().astype(np.uint8)
    return np.ascontiguousarray(np.broadcast_to(rows[:, None], (sheet.height, sheet.width, 3)))


def _lay_over(ground: NDArray[np.uint8], drawn: NDArray[np.uint8], rows: int = 256) -> None:
    """Lay a drawing, colours multiplied by their opacity, over the ground; a few rows at once, for the memory's sake."""
    for begin in range(0, len(drawn), rows):
        part = slice(begin, begin + rows)
        opacity = drawn[part, :, 3:].astype(np.uint16)
        if ground.shape[2] == 4:
            # Where nothing was below, the colour is divided by its opacity again.
            straight = (drawn[part, :, :3].astype(np.uint32) * 255 + opacity // 2) // np.maximum(opacity, 1)
            ground[part, :, :3] = np.minimum(straight, 255)
            ground[part, :, 3:] = opacity
        else:
            below = (ground[part].astype(np.uint16) * (255 - opacity) + 127) // 255
            ground[part] = np.minimum(drawn[part, :, :3] + below, 255)


def _cut(drawn: NDArray[np.uint8], other: NDArray[np.uint8], cut: Cut) -> NDArray[np.uint8]:
    """Return a drawing with another one left of a line or in a circle."""
    height, width = drawn.shape[:2]
    x = np.arange(width)[None, :, None]
    line = max(1, round(height / 400))
    if cut.mode == "swipe":
        inside = x < cut.x * width
        edge = np.abs(x - cut.x * width) < line
    else:
        y = np.arange(height)[:, None, None]
        distance = np.hypot(x - cut.x * width, y - cut.y * height)
        inside = distance < cut.radius * height
        edge = np.abs(distance - cut.radius * height) < line
    found = np.where(inside, other, drawn)
    return np.where(edge, np.array([140, 140, 140, 255], dtype=np.uint8), found)


def _write_title(pen: ImageDraw.ImageDraw, shown: Shown, sides: tuple[int, int], size: int, paper: Paper) -> None:
    bold, plain = _font(size, bold=True), _font(size)
    x, end = sides[0] + 0.7 * size, sides[1] - 0.5 * size
    title = _fitting(pen, shown.title, bold, end - x)
    pen.text((x, 1.5 * size), title, paper.text, bold, anchor="ls")
    x += pen.textlength(title, bold) + size * _GAP / 12
    facts = shown.facts.split(SEPARATOR)
    # The most important comes first; what does not fit as a whole is left out.
    while len(facts) > 1 and pen.textlength(SEPARATOR.join(facts), plain) > end - x:
        facts.pop()
    pen.text((x, 1.5 * size), _fitting(pen, SEPARATOR.join(facts), plain, end - x), paper.subtle, plain, anchor="ls")


def _fitting(pen: ImageDraw.ImageDraw, text: str, font: ImageFont.FreeTypeFont, room: float) -> str:
    """Return as much of a text as there is room for."""
    if pen.textlength(text, font) <= room:
        return text
    while text and pen.textlength(text + "…", font) > room:
        text = text[:-1]
    return text.rstrip(" ·") + "…" if text.strip() else ""


def _draw_scale(picture: Image.Image, scale: Scale, layout: Layout, text: str, line: str) -> None:
    pen, size = ImageDraw.Draw(picture), layout.text_size
    font, small = _font(size), _font(max(8, round(0.9 * size)))
    top = picture.height - layout.bar_height + round(0.6 * size)
    label = f"{scale.label}, {scale.unit}" if scale.unit else scale.label
    label_width = pen.textlength(label, font)
    width = min(34 * size, picture.width - label_width - 5 * size)
    if width < 8 * size:
        label, label_width = "", 0.0
        width = min(34 * size, picture.width - 3 * size)
    left = (picture.width - width - label_width - size) / 2 + label_width + size
    height = max(4, round(0.95 * size))
    if label:
        pen.text((left - size, top + height / 2), label, text, font, anchor="rm")
    colors = Image.fromarray(np.ascontiguousarray(scale.table[None, :, :3])).resize(
        (round(width), height), Image.Resampling.BILINEAR
    )
    picture.paste(colors, (round(left), top))
    pen.rectangle([left - 1, top - 1, left + round(width), top + height], outline=line)
    low, high = scale.low * scale.factor, scale.high * scale.factor
    ticks = nice_ticks(low, high, max(2, int(width / (4.2 * size))))
    step = ticks[1] - ticks[0] if len(ticks) > 1 else 1.0
    for tick in ticks:
        x = left + (tick - low) / (high - low) * width
        pen.line([(x, top + height), (x, top + height + 0.3 * size)], text, max(1, size // 12))
        pen.text((x, top + height + 0.45 * size), tick_text(tick, step), text, small, anchor="ma")


@lru_cache(maxsize=16)
def _font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return the writing that comes with matplotlib, so that pictures look alike on every system."""
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)
