"""The colour maps of pictures: the same as in the window."""

from __future__ import annotations

import numpy as np

from dmp.quantities import QUANTITIES, ColorTable, Quantity

# CET-D1A of Peter Kovesi ("Good Colour Maps: How to Design Them", 2015, CC BY): blue over light grey to red, every eighth of
# its 256 colours.
_BLUE_GREY_RED = (
    "172972 1a3289 1d3ba1 2044ba 294ecf 3c59de 5265e6 6671ed 787df4 888af9 9998fc "
    "aaa6fc b9b4fa c8c3f8 d5d1f6 e3def2 efe3e7 f6dbd6 facac0 fcb8a9 fda593 fc927d "
    "f87f69 f26d56 e95b46 df4937 d43628 c81f1a b90710 a5000b 8f0309 7a0606 660702"
)


def color_table(quantity: Quantity) -> ColorTable:
    """Return the colour map of a quantity, (256, 4) RGBA: viridis, or blue over light grey to red for signed values."""
    if not QUANTITIES[quantity].is_signed:
        import matplotlib

        return np.asarray(matplotlib.colormaps["viridis"](np.arange(256), bytes=True), dtype=np.uint8)
    known = np.array([list(bytes.fromhex(color)) for color in _BLUE_GREY_RED.split()], dtype=np.float64)
    places = np.linspace(0, len(known) - 1, 256)
    found = np.column_stack([np.interp(places, np.arange(len(known)), known[:, channel]) for channel in range(3)])
    return np.column_stack([found, np.full(256, 255.0)]).round().astype(np.uint8)
