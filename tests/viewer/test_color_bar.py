"""The colour bar by itself."""

from __future__ import annotations

import numpy as np
from pytestqt.qtbot import QtBot
from qtpy.QtWidgets import QComboBox

from dmp_viewer.colors import Histogram, Limits, color_table
from dmp_viewer.views.color_bar import ColorBar


def test_the_colour_bar_tells_its_range_and_unit(qtbot: QtBot) -> None:
    bar = ColorBar()
    qtbot.addWidget(bar)
    bar.gradient.set_scale(color_table("magnitude"), Limits(0, 0.5), 4.0, "edge lengths")
    assert bar.gradient.shown_limits == (0, 2)
    assert bar.gradient.accessibleName() == "Colour bar from 0 to 2 edge lengths"


def test_the_colour_bar_says_what_was_chosen(qtbot: QtBot) -> None:
    bar = ColorBar()
    qtbot.addWidget(bar)
    bar.set_policy("signed", "run", "file")
    boxes = bar.findChildren(QComboBox)
    assert {box.currentData() for box in boxes} == {"signed", "run", "file"}
    with qtbot.waitSignal(bar.quantityChosen, check_params_cb=lambda value: value == "plain"):
        boxes[0].setCurrentIndex(boxes[0].findData("plain"))
        boxes[0].activated.emit(0)


def test_a_histogram_of_one_mesh_leaves_the_colours_as_they_are(qtbot: QtBot) -> None:
    bar = ColorBar()
    qtbot.addWidget(bar)
    bar.resize(900, bar.height())
    bar.gradient.set_scale(color_table("magnitude"), Limits(0, 1), 1.0, "")
    counts = np.arange(8, dtype=np.int64)

    def strongest() -> list[int]:
        shown = bar.gradient.grab().toImage()
        column = [shown.pixelColor(round(0.9 * shown.width()), y).getRgb()[:3] for y in range(shown.height())]
        return list(max(column, key=lambda color: max(color) - min(color)))

    seen = []
    for found in (None, Histogram(counts, None, 0.0), Histogram(counts, counts, 0.0)):
        bar.gradient.set_histogram(found)
        seen.append(strongest())
    assert seen[0] == seen[1] == seen[2]
    assert max(seen[0]) - min(seen[0]) > 100
