"""The plot of the training curve: lines on two axes, the steps that matter, level lines, a second run, and the crosshair."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from qtpy.QtCore import QEvent, QObject, QPoint, QPointF, Qt, Signal
from qtpy.QtGui import QColor, QHelpEvent
from qtpy.QtWidgets import QToolTip, QWidget

from dmp_viewer.curve import MEASURE_BY_NAME, Curve, Reference, RunningAverage, Series
from dmp_viewer.step_mark import StepMark
from dmp_viewer.theme import LIGHT, Theme
from dmp_viewer.views.curve_legend import line_style
from dmp_viewer.views.log_axis import LogAxis

_HINT = "Click to show the nearest snapshot. Wheel and drag: look closer. Double click: see everything."
_MARKS = ("kept", "suggested", "held_out", "best")
_NEAR_PIXELS = 6.0
_MARKS_Z = 20
_STRETCH_Z, _STRETCH_ALPHA = -10, 0.12
# A second run has circles on its lines, this many at most, so that nobody has to tell shades apart.
_MOST_CIRCLES = 16


class CurvePlot(pg.PlotWidget):
    """Draws what it is given; knows nothing of where it comes from.

    Signals:
        hovered: the step under the mouse, as a float, or None.
        clicked: the step under a click, as a float.
    """

    hovered = Signal(object)
    clicked = Signal(float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent, viewBox=_RoomyViewBox(), axisItems={"left": LogAxis("left")})
        self._theme: Theme = LIGHT
        self._raw: dict[str, pg.PlotDataItem] = {}
        self._smooth: dict[str, pg.PlotDataItem] = {}
        self._other: dict[str, tuple[pg.PlotDataItem, pg.PlotDataItem]] = {}
        self._other_series: dict[str, Series] = {}
        self._averages: dict[str, tuple[int, RunningAverage]] = {}
        self._hidden: set[str] = set()
        self._levels: list[pg.InfiniteLine] = []
        self._sentences: dict[str, str] = {}
        self.strength = 0.0
        self.setAccessibleName("Training curve")
        self.setMenuEnabled(False)
        self.hideButtons()
        self.setMouseEnabled(x=True, y=False)
        self.setLabel("bottom", "Step")
        for side in ("left", "bottom", "right"):
            self.getAxis(side).enableAutoSIPrefix(False)
        box = self.getViewBox()
        box.setAutoVisible(y=True)
        box.setDefaultPadding(0.03)
        # Degrees have their own axis at the right, in a second view over the first.
        self._degrees = pg.ViewBox(enableMenu=False, enableMouse=False)
        self._degrees.setDefaultPadding(0.06)
        self.scene().addItem(self._degrees)
        self.getAxis("right").linkToView(self._degrees)
        self._degrees.setXLink(self.getPlotItem())
        box.sigResized.connect(self.align_views)
        box.sigResized.connect(self._make_headroom)
        box.sigXRangeChanged.connect(lambda *_: self._arrange_names())
        self._shown_line = _MarkLine(angle=90, movable=False)
        self._hover_line = _MarkLine(angle=90, movable=False)
        # The steps that are about as good as the suggested one.
        self._stretch = pg.LinearRegionItem(movable=False, pen=pg.mkPen(None))
        self._stretch.setZValue(_STRETCH_Z)
        self._stretch.setAcceptHoverEvents(False)
        self._stretch.hide()
        self.addItem(self._stretch, ignoreBounds=True)
        self._marks = {
            name: _MarkLine(angle=90, movable=False, label=name, labelOpts={"anchors": [(0, 0.5), (1, 0.5)]}) for name in _MARKS
        }
        for line in (*self._marks.values(), self._shown_line, self._hover_line):
            line.setZValue(_MARKS_Z - 1)
            line.hide()
            self.addItem(line, ignoreBounds=True)
        self.scene().sigMouseMoved.connect(self._on_mouse_moved)
        self.scene().sigMouseClicked.connect(self._on_mouse_clicked)
        self.viewport().installEventFilter(self)

    # -- lines --------------------------------------------------------------------------------------------------------

    @property
    def names(self) -> list[str]:
        """The measures that have a line, hidden or not."""
        return list(self._raw)

    def set_names(self, names: Sequence[str]) -> None:
        """Make lines for other measures."""
        for items in (self._raw, self._smooth):
            for name, item in items.items():
                self._view_of(name).removeItem(item)
            items.clear()
        self.set_other(None)
        self._averages.clear()
        for name in names:
            for items in (self._raw, self._smooth):
                items[name] = pg.PlotDataItem(skipFiniteCheck=False)
                self._view_of(name).addItem(items[name])
                _thin(items[name])
            self._style(name)

    def set_hidden(self, names: set[str]) -> None:
        """Hide the lines of some measures; to be called before the axis changes, which those must not reach."""
        self._hidden = set(names)
        for name in self._other:
            if name in names:
                self._style_other(name)

    def draw(self, curve: Curve) -> None:
        """Draw a curve; called again with the same one when it has grown."""
        for name in self._raw:
            self._style(name)
            if name not in self._hidden:
                self._draw_line(curve, name)

    def forget_averages(self) -> None:
        """Smooth from the beginning: another curve, or another strength."""
        self._averages.clear()

    def set_other(self, curve: Curve | None) -> None:
        """Lay the lines of another run over these, marked by circles; None takes them away."""
        for name, items in self._other.items():
            for item in items:
                self._view_of(name).removeItem(item)
        self._other, self._other_series = {}, {}
        if curve is None:
            return
        for name in curve.names():
            if name not in self._theme.curves:
                continue
            self._other[name] = (pg.PlotDataItem(), pg.PlotDataItem(pen=None, symbol="o", symbolSize=6))
            self._other_series[name] = curve.series(name)
            for item in self._other[name]:
                self._view_of(name).addItem(item)
            _thin(self._other[name][0])
            self._style_other(name)

    def set_levels(self, references: Sequence[Reference]) -> None:
        """Draw level lines to compare measures with."""
        for line in self._levels:
            self.removeItem(line)
        self._levels = []
        logarithmic = self.getAxis("left").logMode
        for reference in references:
            if reference.name not in self._raw or reference.name in self._hidden or (logarithmic and reference.value <= 0):
                continue
            color = QColor(self._theme.curves[reference.name])
            line = pg.InfiniteLine(
                pos=math.log10(reference.value) if logarithmic else reference.value, angle=0, movable=False,
                pen=pg.mkPen(color, width=1, style=Qt.PenStyle.DotLine),
                label=reference.label,
                labelOpts={"position": 0.02, "anchors": [(0, 1), (0, 1)], "color": color, "fill": _faded(self._theme.base)},
            )  # fmt: skip
            line.setZValue(10)
            self.addItem(line)
            self._levels.append(line)

    def _view_of(self, name: str) -> Any:
        return self._degrees if MEASURE_BY_NAME[name].unit == "degrees" else self.getPlotItem()

    def _draw_line(self, curve: Curve, name: str) -> None:
        steps, values = curve.series(name)
        self._raw[name].setData(steps, values)
        if self.strength > 0:
            generation, average = self._averages.get(name, (-1, RunningAverage(self.strength)))
            if generation != curve.generation:
                average = RunningAverage(self.strength)
                self._averages[name] = (curve.generation, average)
            self._smooth[name].setData(steps, average.follow(values))

    def _style(self, name: str) -> None:
        color = QColor(self._theme.curves[name])
        visible = name not in self._hidden
        faint = QColor(color)
        faint.setAlphaF(0.28)
        smoothed = self.strength > 0
        style = Qt.PenStyle.SolidLine if smoothed else line_style(name)
        self._raw[name].setPen(pg.mkPen(faint if smoothed else color, width=1.2 if smoothed else 1.8, style=style))
        self._smooth[name].setPen(pg.mkPen(color, width=1.8, style=line_style(name)))
        self._raw[name].setVisible(visible)
        self._smooth[name].setVisible(visible and smoothed)
        if name in self._other:
            self._style_other(name)

    def _style_other(self, name: str) -> None:
        color = QColor(self._theme.curves[name])
        line, circles = self._other[name]
        line.setPen(pg.mkPen(color, width=1.0, style=line_style(name)))
        circles.setSymbolPen(pg.mkPen(color, width=1.2))
        circles.setSymbolBrush(pg.mkBrush(self._theme.base))
        # Hidden lines are empty: values that cannot be drawn on a logarithmic axis must not reach it.
        steps, values = self._other_series[name] if name not in self._hidden else (np.zeros(0), np.zeros(0))
        some = np.unique(np.linspace(0, max(0, len(steps) - 1), min(_MOST_CIRCLES, len(steps))).round().astype(int))
        line.setData(steps, values)
        circles.setData(steps[some], values[some])

    # -- axes ---------------------------------------------------------------------------------------------------------

    def set_axes(self, left: str, right: str, *, logarithmic: bool) -> None:
        """Name both vertical axes, an empty name hides the right one, and make the left one logarithmic or linear."""
        self.setLogMode(x=False, y=logarithmic)
        # The plot gives its mode to both vertical axes; degrees stay linear.
        self.getAxis("right").setLogMode(False)
        self.showAxis("right", bool(right))
        self.getAxis("right").setLabel(right)
        self.setLabel("left", left)
        self.align_views()

    def align_views(self) -> None:
        """Bring the second view over the first."""
        self._degrees.setGeometry(self.getViewBox().sceneBoundingRect())
        self._degrees.linkedViewChanged(self.getViewBox(), self._degrees.XAxis)

    def _make_headroom(self) -> None:
        """Give the names of the markers one line each above the curves, however high the plot is."""
        box = self.getViewBox()
        height = max(1.0, box.height())
        line = self._name_height()
        count = sum(mark.isVisible() for mark in self._marks.values())
        box.headroom = min(0.8, count * line / max(1.0, height - count * line))
        self._arrange_names()
        box.updateAutoRange()

    def _arrange_names(self) -> None:
        """Put the names in such an order that no line runs through the name of another.

        A line ends at its own name, and those without a name end below all names. Names stand at the right of their lines in
        the left half and at the left in the right half, so each is written above those of the lines that it could reach.
        """
        box = self.getViewBox()
        line, height = self._name_height(), max(1.0, box.height())
        middle = sum(box.viewRange()[0]) / 2
        shown = [mark for mark in self._marks.values() if mark.isVisible()]
        shown.sort(key=lambda mark: (mark.value() > middle, abs(middle - mark.value()) * -1))
        for other in (self._shown_line, self._hover_line):
            other.end_at(max(0.1, 1 - len(shown) * line / height))
        for row, mark in enumerate(shown):
            top = max(0.1, 1 - row * line / height)
            mark.end_at(top)
            mark.setZValue(_MARKS_Z + row)
            mark.label.setPosition((1 - (row + 0.5) * line / height) / top)

    def _name_height(self) -> int:
        return self.fontMetrics().height() - 1

    # -- steps --------------------------------------------------------------------------------------------------------

    def set_shown_step(self, step: int | None) -> None:
        """Move the line of the shown step."""
        _place(self._shown_line, step)

    def set_hovered_step(self, step: float | None) -> None:
        """Move the crosshair."""
        _place(self._hover_line, step)

    def set_marks(self, marks: Sequence[StepMark], stretch: tuple[int, int] | None = None) -> None:
        """Mark the steps that matter, and the ``stretch`` that is as good as the suggested one."""
        self._stretch.setVisible(stretch is not None)
        if stretch is not None:
            self._stretch.setRegion(stretch)
        found = {mark.name: mark for mark in marks}
        for name, line in self._marks.items():
            mark = found.get(name)  # type: ignore[call-overload]
            _place(line, None if mark is None else mark.step)
            if mark is not None:
                line.label.setFormat(mark.label)
        self._sentences = {mark.name: mark.sentence for mark in marks}
        self._make_headroom()

    def sentences_at(self, place: QPoint) -> list[str]:
        """Return why the steps are marked whose lines or names are at a place of the view."""
        scene = self.mapToScene(place)
        box = self.getViewBox()
        found = []
        for name, line in self._marks.items():
            if not line.isVisible():
                continue
            x = box.mapViewToScene(QPointF(line.value(), 0.0)).x()
            label = line.label.mapRectToScene(line.label.boundingRect())
            if abs(x - scene.x()) <= _NEAR_PIXELS or label.contains(scene):
                found.append(self._sentences[name])
        return found

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        self.setBackground(theme.base)
        for side in ("left", "bottom", "right"):
            axis = self.getAxis(side)
            axis.setPen(theme.line)
            axis.setTextPen(theme.subtle)
        self.showGrid(x=True, y=True, alpha=0.22)
        for name, color, style in (
            ("kept", theme.kept, Qt.PenStyle.SolidLine),
            ("suggested", theme.suggested, Qt.PenStyle.DashLine),
            ("held_out", theme.curves["held_out_error"], Qt.PenStyle.DashDotLine),
            ("best", theme.best, Qt.PenStyle.DotLine),
        ):
            self._marks[name].setPen(pg.mkPen(color, width=1.5, style=style))
            self._marks[name].label.setColor(color)
        self._stretch.setBrush(_faded(theme.suggested, _STRETCH_ALPHA))
        self._shown_line.setPen(pg.mkPen(theme.text, width=1.5))
        self._hover_line.setPen(pg.mkPen(theme.subtle, width=1, style=Qt.PenStyle.DotLine))
        for name in self._raw:
            self._style(name)

    # -- mouse --------------------------------------------------------------------------------------------------------

    def _step_at(self, position: QPointF) -> float | None:
        box = self.getViewBox()
        return float(box.mapSceneToView(position).x()) if box.sceneBoundingRect().contains(position) else None

    def _on_mouse_moved(self, position: QPointF) -> None:
        self.hovered.emit(self._step_at(position))

    def _on_mouse_clicked(self, event: pg.GraphicsScene.mouseEvents.MouseClickEvent) -> None:
        if event.button() is not Qt.MouseButton.LeftButton:
            return
        if event.double():
            self.enableAutoRange()
            return
        step = self._step_at(event.scenePos())
        if step is not None:
            self.clicked.emit(step)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Forget the crosshair when the mouse leaves the plot; say why a step is marked when it rests there."""
        if event.type() == QEvent.Type.Leave:
            self.hovered.emit(None)
        if event.type() == QEvent.Type.ToolTip and isinstance(event, QHelpEvent):
            QToolTip.showText(event.globalPos(), "\n".join(self.sentences_at(event.pos())) or _HINT, self)
            return True
        return bool(super().eventFilter(watched, event))


class _RoomyViewBox(pg.ViewBox):
    """A view with room above the lines, where the markers have their names."""

    headroom = 0.0

    def childrenBounds(self, *args: Any, **options: Any) -> list[Any]:
        x_range, y_range = super().childrenBounds(*args, **options)
        if y_range is not None:
            y_range = [y_range[0], y_range[1] + self.headroom * (y_range[1] - y_range[0])]
        return [x_range, y_range]


class _MarkLine(pg.InfiniteLine):
    """An upright line that can end below the upper edge."""

    def end_at(self, share: float) -> None:
        """End at a share of the height; the place of the label counts from the lower edge to this end."""
        self.setSpan(0.0, share)
        # The line would keep the rectangle of its former length.
        self._boundingRect = None
        self.prepareGeometryChange()
        self.boundingRect()


def _thin(line: pg.PlotDataItem) -> None:
    """Let a line be drawn with no more than its highest and lowest value for each column of pixels.

    To be called when it is in its view, which gives it a mode of its own. All of a line of a very long training would take
    longer to draw than the time until it is drawn again.
    """
    line.setDownsampling(auto=True, method="peak")
    line.opts["autoDownsampleFactor"] = 1.0


def _faded(color: str, alpha: float = 0.75) -> QColor:
    """Return a colour through which what lies below is seen; by default faintly, as under a name."""
    faded = QColor(color)
    faded.setAlphaF(alpha)
    return faded


def _place(line: pg.InfiniteLine, step: float | None) -> None:
    line.setVisible(step is not None)
    if step is not None:
        line.setValue(step)
