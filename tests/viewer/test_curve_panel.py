"""The curve panel by itself: lines, legend, markers, mouse."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, QPointF, Qt
from qtpy.QtGui import QImage
from qtpy.QtWidgets import QApplication, QWidget

from dmp.settings import settings_for
from dmp_viewer.curve import Curve
from dmp_viewer.step_mark import StepMark
from dmp_viewer.theme import DARK, LIGHT
from dmp_viewer.views.curve_panel import CurvePanel

ROWS = [
    {
        "step": step,
        "seconds": 1.0,
        "data_loss": 2.0 / (step + 1),
        "held_out_error": 0.5,
        "displacement": 0.1,
        "mad": 30.0 - step,
    }
    for step in range(0, 21, 5)
]

MARKS = [
    StepMark("kept", 5, "kept", "Kept: you chose it."),
    StepMark("suggested", 10, "suggested", "Suggested: step 10."),
    StepMark("best", 20, "best MAD", "By the ground truth: it is step 20."),
]


@pytest.fixture
def curve(qtbot: QtBot) -> CurvePanel:
    panel = CurvePanel()
    qtbot.addWidget(panel)
    panel.resize(900, 260)
    panel.set_theme(LIGHT)
    panel.show()
    qtbot.waitExposed(panel)
    return panel


def test_the_empty_curve_explains_itself(curve: CurvePanel) -> None:
    curve.set_curve(Curve(), None)
    texts = [label.text() for label in curve.findChildren(QWidget) if label.isVisible() and hasattr(label, "text")]
    assert any("held-out error" in str(text).lower() for text in texts)


def test_the_steps_that_are_as_good_lie_upon_a_tinted_ground(curve: CurvePanel, qtbot: QtBot) -> None:
    curve.set_curve(Curve(ROWS), settings_for())

    def ground(step: float) -> tuple[int, ...]:
        qtbot.wait(20)
        plot = curve.plot
        box = plot.getViewBox()
        (_, _), (low, high) = box.viewRange()
        place = plot.mapFromScene(box.mapViewToScene(QPointF(step, low + 0.03 * (high - low))))
        return QImage(plot.grab().toImage()).pixelColor(place).getRgb()[:3]

    curve.set_marks(MARKS)
    plain = ground(11.3)
    curve.set_marks(MARKS, "", (7, 13))
    assert ground(11.3) != plain
    assert ground(15.3) == plain
    curve.set_marks(MARKS)
    assert ground(11.3) == plain


@pytest.mark.parametrize("steps", [(2, 3, 4), (4, 3, 2), (16, 17, 19), (19, 17, 16), (3, 18, 17), (0, 20, 20)])
def test_no_line_runs_through_the_name_of_a_marked_step(curve: CurvePanel, qtbot: QtBot, steps: tuple[int, ...]) -> None:
    curve.set_curve(Curve(ROWS), settings_for())
    names = ("kept", "suggested", "best")
    curve.set_marks([StepMark(name, step, name, "Why.") for name, step in zip(names, steps, strict=True)], "")
    curve.set_shown_step(steps[0] + 1)
    qtbot.wait(20)
    plot = curve.plot
    lines = [plot._marks[name] for name in names]
    letters = plot.fontMetrics().height() - 4
    for mark in lines:
        name = mark.label.mapRectToScene(mark.label.boundingRect())
        for line in (*lines, plot._shown_line):
            if line is mark:
                continue
            x = plot.getViewBox().mapViewToScene(QPointF(line.value(), 0.0)).x()
            top = line.mapRectToScene(line.boundingRect()).top()
            if name.left() + 4 < x < name.right() - 4:
                assert top > name.center().y() + letters / 2 - 4, (steps, mark.label.format)
        assert name.center().y() > plot.getViewBox().sceneBoundingRect().top()


def test_the_legend_tells_the_values_of_the_shown_step(curve: CurvePanel) -> None:
    curve.set_curve(Curve(ROWS), settings_for())
    curve.set_shown_step(5)
    assert curve.legend.heading == "Shown: step 5"
    assert curve.legend.value_shown("data_loss") == "0.3333"
    assert curve.legend.value_shown("mad") == "25.00°"


@pytest.mark.parametrize("measure", ["data_loss", "mad"])
def test_a_long_line_is_drawn_with_few_points_among_them_its_extremes(curve: CurvePanel, qtbot: QtBot, measure: str) -> None:
    usual = {"seconds": 1.0, "data_loss": 1.0, "mad": 1.0}
    rows = [{"step": float(step), **usual, measure: 1.0 + 0.1 * np.sin(step)} for step in range(30_000)]
    rows[12_345][measure], rows[23_456][measure] = 3.0, 0.5
    curve.set_curve(Curve(rows), settings_for())
    qtbot.waitUntil(lambda: len(curve.plot._raw[measure].getData()[1]) < 4 * curve.plot.width())
    drawn = curve.plot._raw[measure].getData()[1]
    values = 10**drawn if curve.plot.getAxis("left").logMode and measure == "data_loss" else drawn
    assert (values.max(), values.min()) == pytest.approx((3.0, 0.5))


def test_the_legend_switches_lines(curve: CurvePanel, qtbot: QtBot) -> None:
    curve.set_curve(Curve(ROWS), settings_for())
    assert curve.drawn_names() == ["data_loss", "held_out_error", "mad"]
    curve.legend.button("displacement").click()
    curve.legend.button("mad").click()
    assert curve.drawn_names() == ["data_loss", "held_out_error", "displacement"]


def _pixels(widget: QWidget) -> np.ndarray:
    image = widget.grab().toImage().convertToFormat(QImage.Format.Format_RGB888)
    return np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine()).copy()


def test_every_choice_changes_the_picture(curve: CurvePanel, qtbot: QtBot) -> None:
    curve.set_curve(Curve(ROWS), settings_for())
    pictures = [_pixels(curve)]
    for change in (
        lambda: curve.set_log_axis(False),
        lambda: curve.set_smoothing(0.9),
        lambda: curve.set_shown_step(15),
        lambda: curve.set_marks(MARKS, "Because."),
        lambda: curve.set_theme(DARK),
        lambda: curve.set_curve(Curve(ROWS[:3]), settings_for()),
    ):
        change()
        qtbot.wait(20)
        pictures.append(_pixels(curve))
    for before, after in pairwise(pictures):
        assert not np.array_equal(before, after)
    assert curve.advice == "Because."


def test_a_click_on_the_curve_names_the_step_under_it(curve: CurvePanel, qtbot: QtBot) -> None:
    curve.set_curve(Curve(ROWS), settings_for())
    qtbot.wait(50)
    view = curve.plot
    box = view.getViewBox()
    for step in (0.0, 7.0, 20.0):
        scene = box.mapViewToScene(box.viewRange() and _point(step, sum(box.viewRange()[1]) / 2))
        place = view.mapFromScene(scene)
        with qtbot.waitSignal(curve.stepClicked) as clicked:
            qtbot.mouseClick(view.viewport(), Qt.MouseButton.LeftButton, pos=place)
        assert clicked.args[0] == pytest.approx(step, abs=0.2)


def _point(x: float, y: float) -> object:
    from qtpy.QtCore import QPointF

    return QPointF(x, y)


def test_the_crosshair_snaps_to_logged_steps_and_goes_with_the_mouse(curve: CurvePanel, qtbot: QtBot) -> None:
    curve.set_curve(Curve(ROWS), settings_for())
    curve.set_shown_step(0)
    qtbot.wait(50)
    box = curve.plot.getViewBox()
    curve.plot.scene().sigMouseMoved.emit(box.mapViewToScene(_point(11.0, sum(box.viewRange()[1]) / 2)))
    assert curve.legend.heading == "Step 10"
    QApplication.sendEvent(curve.plot.viewport(), QEvent(QEvent.Type.Leave))
    assert curve.legend.heading == "Shown: step 0"


def test_values_below_zero_make_the_axis_linear(curve: CurvePanel) -> None:
    curve.set_curve(Curve([{**row, "data_loss": -1.0} for row in ROWS]), settings_for())
    assert not curve._log_box.isEnabled()
    assert "not above zero" in curve._log_box.toolTip()
    curve.legend.button("data_loss").click()
    assert curve._log_box.isEnabled()
