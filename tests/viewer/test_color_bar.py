"""The colour bar by itself."""

from __future__ import annotations

from pytestqt.qtbot import QtBot
from qtpy.QtWidgets import QComboBox

from dmp_viewer.colors import Limits, color_table
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
