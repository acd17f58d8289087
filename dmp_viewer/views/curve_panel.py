"""The training curve: losses and errors over the steps, growing live, with the steps that matter marked."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping
from typing import Any

import pyqtgraph as pg
from qtpy.QtCore import QEvent, QObject, QPointF, Qt, QTimer, Signal
from qtpy.QtGui import QColor, QPalette, QResizeEvent
from qtpy.QtWidgets import (
    QCheckBox,
    QHBoxLayout,
    QLabel,
    QSizePolicy,
    QSlider,
    QStackedLayout,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from dmp.settings import Settings
from dmp_viewer.curve import EXPLANATIONS, MEASURE_BY_NAME, MEASURES, Curve, Reference, RunningAverage, unit_text
from dmp_viewer.icons import icon
from dmp_viewer.theme import LIGHT, Theme
from dmp_viewer.views.curve_legend import CurveLegend, line_style
from dmp_viewer.views.log_axis import LogAxis

# A completion is judged by its movement; how well it meets what is known says little about the holes.
_QUIET_IN_HOLES = ("data_loss", "laplacian_loss")
_LOG_TIP = "Logarithmic axis for losses and errors; MAD keeps its own linear axis."
_NO_LOG_TIP = "One of the drawn values is not above zero, which a logarithmic axis cannot show."


class CurvePanel(QWidget):
    """Plot, legend with values, and markers.

    Signals:
        stepClicked: the step under a click, as a float.
        logAxisChanged: whether the left axis is logarithmic.
        smoothingChanged: strength of the smoothing, 0 to 0.99.
    """

    stepClicked = Signal(float)
    logAxisChanged = Signal(bool)
    smoothingChanged = Signal(float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._curve = Curve()
        self._settings: Settings | None = None
        self._theme: Theme = LIGHT
        self._log = True
        self._strength = 0.0
        self._advice_step: int | None = None
        self._advice_reason = ""
        self._raw: dict[str, pg.PlotDataItem] = {}
        self._smooth: dict[str, pg.PlotDataItem] = {}
        self._averages: dict[str, tuple[int, RunningAverage]] = {}
        self._hidden = {measure.name for measure in MEASURES if not measure.shown}
        self._shown_step: int | None = None
        self._hovered_step: float | None = None
        self._task = ""
        self._note = ""
        self._references: tuple[Reference, ...] = ()
        self._levels: list[pg.InfiniteLine] = []
        self._build()

    # -- what is shown ------------------------------------------------------------------------------------------------

    def set_curve(self, curve: Curve, settings: Settings | None) -> None:
        """Draw a curve; called again with the same one when it has grown."""
        if curve is not self._curve:
            self._averages.clear()
        self._curve, self._settings = curve, settings
        self._stack.setCurrentIndex(1 if len(curve) > 1 else 0)
        names = curve.names()
        if names != list(self._raw):
            self._make_items(names)
        self._draw_all()
        self._update_readout()

    def set_task(self, task: str) -> None:
        """Explain the curve of a kind of training (key of :data:`EXPLANATIONS`) and draw at first what it is judged by."""
        if task == self._task:
            return
        self._task = task
        text = EXPLANATIONS[task]
        self._empty.setText(f"The curve grows here during training.\n\n{text}")
        self._help.setToolTip(f"<p>{text}</p>")
        self._help.setAccessibleDescription(text)
        quiet = _QUIET_IN_HOLES if task in ("complete", "made-up-holes") else ()
        self._hidden = {measure.name for measure in MEASURES if not measure.shown or measure.name in quiet}
        if self._raw:
            self._legend.set_measures(list(self._raw), self._hidden)
            self._legend.set_theme(self._theme)
            self._draw_all()
            self._update_readout()

    def set_note(self, text: str) -> None:
        """Say something else than which step is suggested; an empty text brings the suggestion back."""
        if text != self._note:
            self._note = text
            self._write_advice()

    def set_references(self, references: tuple[Reference, ...]) -> None:
        """Draw level lines to compare measures with."""
        if references != self._references:
            self._references = references
            self._draw_references()

    def set_shown_step(self, step: int | None) -> None:
        """Move the line of the shown step."""
        self._shown_step = step
        _place(self._shown_line, step)
        self._update_readout()

    def set_markers(
        self, kept: int | None, suggested: int | None, reason: str, best: int | None, best_text: str = "best MAD"
    ) -> None:
        """Mark the kept step, the suggested step with its reason, and the best step by the ground truth."""
        self._markers["best"].label.setFormat(best_text)
        for name, step in (("kept", kept), ("suggested", suggested), ("best", best)):
            _place(self._markers[name], step)
        self._advice_step, self._advice_reason = suggested, reason
        self._write_advice()

    def set_log_axis(self, logarithmic: bool) -> None:
        """Make the left axis logarithmic or linear."""
        self._log = logarithmic
        self._log_box.setChecked(logarithmic)
        self._draw_all()

    def set_smoothing(self, strength: float) -> None:
        """Smooth the drawn lines by a running average; the measured values stay visible, faintly."""
        self._strength = min(max(strength, 0.0), 0.99)
        self._smoothing.setValue(round(self._strength * 100))
        self._smoothing_text.setText(f"{self._strength:.2f}")
        self._averages.clear()
        self._draw_all()

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        self._plot.setBackground(theme.base)
        for side in ("left", "bottom", "right"):
            axis = self._plot.getAxis(side)
            axis.setPen(theme.line)
            axis.setTextPen(theme.subtle)
        self._plot.showGrid(x=True, y=True, alpha=0.22)
        for name, color, style in (
            ("kept", theme.kept, Qt.PenStyle.SolidLine),
            ("suggested", theme.suggested, Qt.PenStyle.DashLine),
            ("best", theme.best, Qt.PenStyle.DotLine),
        ):
            self._markers[name].setPen(pg.mkPen(color, width=1.5, style=style))
            self._markers[name].label.setColor(color)
        self._shown_line.setPen(pg.mkPen(theme.text, width=1.5))
        self._hover_line.setPen(pg.mkPen(theme.subtle, width=1, style=Qt.PenStyle.DotLine))
        for name in self._raw:
            self._style(name)
        self._draw_references()
        self._legend.set_theme(theme)
        self._write_advice()
        self._help.setIcon(icon("help", theme, color=theme.subtle))
        palette = self._empty.palette()
        palette.setColor(QPalette.ColorRole.Window, QColor(theme.base))
        palette.setColor(QPalette.ColorRole.WindowText, QColor(theme.subtle))
        self._empty.setPalette(palette)
        self._empty.parentWidget().setPalette(palette)

    @property
    def legend(self) -> CurveLegend:
        """The legend with its values."""
        return self._legend

    def drawn_names(self) -> list[str]:
        """Return the measures that are drawn now."""
        return [name for name in self._raw if name not in self._hidden]

    @property
    def advice(self) -> str:
        """The sentence about the suggested step, or what is said in its place."""
        return self._note or self._advice_reason

    # -- building -----------------------------------------------------------------------------------------------------

    def _build(self) -> None:
        self._plot = pg.PlotWidget(viewBox=_RoomyViewBox(), axisItems={"left": LogAxis("left")})
        self._plot.setAccessibleName("Training curve")
        self._plot.setMenuEnabled(False)
        self._plot.hideButtons()
        self._plot.setMouseEnabled(x=True, y=False)
        self._plot.setLabel("bottom", "Step")
        for side in ("left", "bottom", "right"):
            self._plot.getAxis(side).enableAutoSIPrefix(False)
        self._plot.setToolTip("Click to show the nearest snapshot. Wheel and drag: look closer. Double click: see everything.")
        box = self._plot.getViewBox()
        box.setAutoVisible(y=True)
        box.setDefaultPadding(0.03)
        # Degrees have their own axis at the right, in a second view over the first.
        self._degrees = pg.ViewBox(enableMenu=False, enableMouse=False)
        self._degrees.setDefaultPadding(0.06)
        self._plot.scene().addItem(self._degrees)
        self._plot.getAxis("right").linkToView(self._degrees)
        self._degrees.setXLink(self._plot.getPlotItem())
        box.sigResized.connect(self._align_views)
        box.sigResized.connect(self._make_headroom)
        self._shown_line = pg.InfiniteLine(angle=90, movable=False)
        self._hover_line = pg.InfiniteLine(angle=90, movable=False)
        self._markers = {
            name: pg.InfiniteLine(angle=90, movable=False, label=text, labelOpts={"anchors": [(0, 0.5), (1, 0.5)]})
            for name, text in (("kept", "kept"), ("suggested", "suggested"), ("best", "best MAD"))
        }
        for line in (*self._markers.values(), self._shown_line, self._hover_line):
            line.setZValue(20)
            line.hide()
            self._plot.addItem(line, ignoreBounds=True)
        self._plot.scene().sigMouseMoved.connect(self._on_mouse_moved)
        self._plot.scene().sigMouseClicked.connect(self._on_mouse_clicked)
        self._plot.viewport().installEventFilter(self)

        self._legend = CurveLegend()
        self._legend.toggled.connect(self._on_legend_toggled)

        title = QLabel("Training curve")
        font = title.font()
        font.setBold(True)
        title.setFont(font)
        self._help = QToolButton()
        self._help.setAutoRaise(True)
        self._help.setAccessibleName("What the curve shows")
        self._advice = QLabel()
        self._advice.setTextFormat(Qt.TextFormat.RichText)
        self._advice.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self._advice.setTextInteractionFlags(
            Qt.TextInteractionFlag.LinksAccessibleByMouse | Qt.TextInteractionFlag.LinksAccessibleByKeyboard
        )
        self._advice.linkActivated.connect(lambda step: self.stepClicked.emit(float(step)))
        self._log_box = QCheckBox("Log axis")
        self._log_box.setChecked(True)
        self._log_box.clicked.connect(self.logAxisChanged)
        self._smoothing = QSlider(Qt.Orientation.Horizontal)
        self._smoothing.setRange(0, 99)
        self._smoothing.setFixedWidth(90)
        self._smoothing.setAccessibleName("Smoothing of the curve")
        self._smoothing.setToolTip("Running average of the drawn lines. The measured values stay visible, faintly.")
        self._smoothing.valueChanged.connect(lambda value: self.smoothingChanged.emit(value / 100))
        self._smoothing_text = QLabel("0.00")
        self._smoothing_text.setMinimumWidth(self._smoothing_text.sizeHint().width())
        head = QHBoxLayout()
        head.setContentsMargins(8, 0, 8, 0)
        head.addWidget(title)
        head.addWidget(self._help)
        head.addSpacing(8)
        head.addWidget(self._advice, 1)
        head.addSpacing(12)
        for widget in (self._log_box, QLabel("Smoothing"), self._smoothing, self._smoothing_text):
            head.addWidget(widget)

        full = QWidget()
        row = QHBoxLayout(full)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(0)
        row.addWidget(self._plot, 1)
        row.addWidget(self._legend)
        self._empty = QLabel()
        self._empty.setWordWrap(True)
        self._empty.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._empty.setAutoFillBackground(True)
        self._empty.setMargin(16)
        self._stack = QStackedLayout()
        middle = QWidget()
        middle_row = QHBoxLayout(middle)
        middle_row.setContentsMargins(0, 0, 0, 0)
        middle_row.addStretch(1)
        middle_row.addWidget(self._empty, 8)
        middle_row.addStretch(1)
        self._empty.setMaximumWidth(720)
        middle.setAutoFillBackground(True)
        self._stack.addWidget(middle)
        self._stack.addWidget(full)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 4, 0, 0)
        layout.setSpacing(2)
        layout.addLayout(head)
        layout.addLayout(self._stack, 1)
        self.setMinimumHeight(130)
        self.set_task("denoise")

    def _make_items(self, names: list[str]) -> None:
        for items in (self._raw, self._smooth):
            for name, item in items.items():
                (self._degrees if MEASURE_BY_NAME[name].unit == "degrees" else self._plot).removeItem(item)
            items.clear()
        self._averages.clear()
        for name in names:
            for items in (self._raw, self._smooth):
                item = pg.PlotDataItem(skipFiniteCheck=False)
                items[name] = item
                if MEASURE_BY_NAME[name].unit == "degrees":
                    self._degrees.addItem(item)
                else:
                    self._plot.addItem(item)
            self._style(name)
        self._legend.set_measures(names, self._hidden)
        self._legend.set_theme(self._theme)

    def _style(self, name: str) -> None:
        color = QColor(self._theme.curves[name])
        visible = name not in self._hidden
        faint = QColor(color)
        faint.setAlphaF(0.28)
        smoothed = self._strength > 0
        style = Qt.PenStyle.SolidLine if smoothed else line_style(name)
        self._raw[name].setPen(pg.mkPen(faint if smoothed else color, width=1.2 if smoothed else 1.8, style=style))
        self._smooth[name].setPen(pg.mkPen(color, width=1.8, style=line_style(name)))
        self._raw[name].setVisible(visible)
        self._smooth[name].setVisible(visible and smoothed)

    def _draw(self, name: str) -> None:
        self._style(name)
        if name in self._hidden:
            return
        steps, values = self._curve.series(name)
        self._raw[name].setData(steps, values)
        if self._strength > 0:
            generation, average = self._averages.get(name, (-1, RunningAverage(self._strength)))
            if generation != self._curve.generation:
                average = RunningAverage(self._strength)
                self._averages[name] = (self._curve.generation, average)
            self._smooth[name].setData(steps, average.follow(values))

    def _update_axes(self) -> None:
        drawn = self.drawn_names()
        degrees = [name for name in drawn if MEASURE_BY_NAME[name].unit == "degrees"]
        self._plot.showAxis("right", bool(degrees))
        self._plot.getAxis("right").setLabel("MAD (degrees)" if degrees == ["mad"] else "Degrees")
        units = {unit_text(MEASURE_BY_NAME[name].unit, self._settings) for name in drawn if name not in degrees}
        # Values of different units on one axis are told apart by the legend only.
        self._plot.setLabel("left", units.pop().capitalize() if len(units) == 1 else "Value")
        self._align_views()

    def _draw_all(self) -> None:
        self._apply_log_mode()
        for name in self._raw:
            self._draw(name)
        self._draw_references()
        self._update_axes()

    def _draw_references(self) -> None:
        for line in self._levels:
            self._plot.removeItem(line)
        self._levels = []
        logarithmic = self._plot.getAxis("left").logMode
        for reference in self._references:
            if reference.name not in self.drawn_names() or (logarithmic and reference.value <= 0):
                continue
            color = QColor(self._theme.curves[reference.name])
            line = pg.InfiniteLine(
                pos=math.log10(reference.value) if logarithmic else reference.value, angle=0, movable=False,
                pen=pg.mkPen(color, width=1, style=Qt.PenStyle.DotLine),
                label=reference.label, labelOpts={"position": 0.02, "anchors": [(0, 1), (0, 1)], "color": color},
            )  # fmt: skip
            line.setZValue(10)
            self._plot.addItem(line)
            self._levels.append(line)

    def _apply_log_mode(self) -> None:
        left = [name for name in self.drawn_names() if MEASURE_BY_NAME[name].unit != "degrees"]
        possible = all(self._curve.lowest(name) > 0 for name in left)
        self._log_box.setEnabled(possible)
        self._log_box.setToolTip(_LOG_TIP if possible else _NO_LOG_TIP)
        self._plot.setLogMode(x=False, y=self._log and possible)
        # The plot gives its mode to both vertical axes; degrees stay linear.
        self._plot.getAxis("right").setLogMode(False)

    def _align_views(self) -> None:
        self._degrees.setGeometry(self._plot.getViewBox().sceneBoundingRect())
        self._degrees.linkedViewChanged(self._plot.getViewBox(), self._degrees.XAxis)

    def _make_headroom(self) -> None:
        """Give the names of the markers one line each above the curves, however high the plot is."""
        box = self._plot.getViewBox()
        height = max(1.0, box.height())
        line = self.fontMetrics().height() - 1
        box.headroom = min(0.8, len(self._markers) * line / max(1.0, height - len(self._markers) * line))
        for row, marker in enumerate(self._markers.values()):
            marker.label.setPosition(1 - (row + 0.5) * line / height)
        box.updateAutoRange()

    def _update_readout(self) -> None:
        step = self._hovered_step if self._hovered_step is not None else self._shown_step
        row: Mapping[str, float] | None = None if step is None else self._curve.nearest(step)
        self._legend.set_row(row, hovered=self._hovered_step is not None)

    def _write_advice(self) -> None:
        step = self._advice_step
        if self._note:
            metrics = self._advice.fontMetrics()
            shown = metrics.elidedText(self._note, Qt.TextElideMode.ElideRight, max(0, self._advice.width() - 4))
            self._advice.setText(f'<span style="color:{self._theme.subtle}">{html.escape(shown)}</span>')
            self._advice.setToolTip(self._note)
            return
        if step is None:
            self._advice.setText("")
            return
        link = f'<a style="color:{self._theme.suggested}" href="{step}">step {step:,}</a>'
        # A label cuts rich text in the middle of a letter, so the reason is cut here.
        metrics = self._advice.fontMetrics()
        room = self._advice.width() - metrics.horizontalAdvance(f"Suggested: step {step:,}. ") - 4
        reason = metrics.elidedText(self._advice_reason, Qt.TextElideMode.ElideRight, max(0, room))
        self._advice.setText(f'Suggested: {link}. <span style="color:{self._theme.subtle}">{html.escape(reason)}</span>')
        self._advice.setToolTip(self._advice_reason)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Cut the advice to the new width, once the layout knows it."""
        super().resizeEvent(event)
        QTimer.singleShot(0, self, self._write_advice)

    # -- mouse --------------------------------------------------------------------------------------------------------

    def _step_at(self, position: QPointF) -> float | None:
        box = self._plot.getViewBox()
        if not box.sceneBoundingRect().contains(position) or not len(self._curve):
            return None
        return float(box.mapSceneToView(position).x())

    def _on_mouse_moved(self, position: QPointF) -> None:
        step = self._step_at(position)
        row = None if step is None else self._curve.nearest(step)
        self._hovered_step = None if row is None else row["step"]
        _place(self._hover_line, self._hovered_step)
        self._update_readout()

    def _on_mouse_clicked(self, event: pg.GraphicsScene.mouseEvents.MouseClickEvent) -> None:
        if event.button() is not Qt.MouseButton.LeftButton:
            return
        if event.double():
            self._plot.enableAutoRange()
            return
        step = self._step_at(event.scenePos())
        if step is not None:
            self.stepClicked.emit(step)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Forget the crosshair when the mouse leaves the plot."""
        if event.type() == QEvent.Type.Leave:
            self._hovered_step = None
            self._hover_line.hide()
            self._update_readout()
        return super().eventFilter(watched, event)

    def _on_legend_toggled(self, name: str, visible: bool) -> None:
        (self._hidden.discard if visible else self._hidden.add)(name)
        self._draw_all()


class _RoomyViewBox(pg.ViewBox):
    """A view with room above the lines, where the markers have their names."""

    headroom = 0.0

    def childrenBounds(self, *args: Any, **options: Any) -> list[Any]:
        x_range, y_range = super().childrenBounds(*args, **options)
        if y_range is not None:
            y_range = [y_range[0], y_range[1] + self.headroom * (y_range[1] - y_range[0])]
        return [x_range, y_range]


def _place(line: pg.InfiniteLine, step: float | None) -> None:
    line.setVisible(step is not None)
    if step is not None:
        line.setValue(step)
