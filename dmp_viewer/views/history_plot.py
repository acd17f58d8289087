"""A small plot of one value over the steps: the whole run at a glance, the shown step marked."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from qtpy.QtCore import QPointF, QRectF, QSize, Qt, Signal
from qtpy.QtGui import QColor, QMouseEvent, QPainter, QPaintEvent, QPen, QPolygonF
from qtpy.QtWidgets import QSizePolicy, QToolTip, QWidget

from dmp_viewer.theme import LIGHT, Theme

_MARGIN = 6.0


class HistoryPlot(QWidget):
    """Draws the history of the picked vertex.

    Signals:
        stepClicked: the step nearest to a click.
    """

    stepClicked = Signal(int)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = LIGHT
        self._steps: list[int] = []
        self._values: list[float] = []
        self._level: float | None = None
        self._shown: int | None = None
        self._unit = self._level_name = ""
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        self.setMouseTracking(True)
        self.setAccessibleName("History of the picked vertex")

    def set_history(self, values: Mapping[int, float], level: float | None, level_name: str, name: str, unit: str) -> None:
        """Draw values by step, in ``unit``.

        Args:
            values: what was measured, by step.
            level: a value to compare with, drawn as a dashed line; None draws none.
            level_name: what has that value.
            name: what was measured.
            unit: its unit.
        """
        finite = sorted((step, value) for step, value in values.items() if np.isfinite(value))
        self._steps, self._values = [step for step, _ in finite], [value for _, value in finite]
        self._level = level if level is not None and np.isfinite(level) else None
        self._unit, self._level_name = unit, level_name
        if finite:
            text = f"{name} from {self._values[0]:.3g} at step {self._steps[0]:,} to {self._values[-1]:.3g} at step "
            self.setAccessibleDescription(f"{text}{self._steps[-1]:,}, {unit}")
        self.update()

    def set_shown_step(self, step: int | None) -> None:
        """Mark the shown step."""
        self._shown = step
        self.update()

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        self.update()

    @property
    def n_points(self) -> int:
        """How many steps are drawn."""
        return len(self._steps)

    def sizeHint(self) -> QSize:
        """Return room for a line that can be read."""
        return QSize(240, 44)

    def minimumSizeHint(self) -> QSize:
        """Return the least room."""
        return QSize(120, 36)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the line, both extremes as numbers, and the shown step."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        theme = self._theme
        painter.setPen(QPen(QColor(theme.line), 1))
        painter.setBrush(QColor(theme.base))
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(0.5, 0.5, -0.5, -0.5), 3, 3)
        painter.setPen(QColor(theme.subtle))
        if not self._steps:
            painter.drawText(self.rect(), Qt.AlignmentFlag.AlignCenter, "Its history over the steps comes here")
            painter.end()
            return
        low, high = self._range()
        numbers = QRectF(self.rect()).adjusted(4, 1, -4, -1)
        painter.drawText(numbers, Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignTop, f"{high:.3g}")
        painter.drawText(numbers, Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignBottom, f"{low:.3g}")
        area = self._area()
        if self._level is not None:
            painter.setPen(QPen(QColor(theme.subtle), 1, Qt.PenStyle.DashLine))
            y = self._y_of(self._level, area)
            painter.drawLine(QPointF(area.left(), y), QPointF(area.right(), y))
        painter.setPen(QPen(QColor(theme.accent), 1.8))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        points = [
            QPointF(self._x_of(step, area), self._y_of(value, area))
            for step, value in zip(self._steps, self._values, strict=True)
        ]
        painter.drawPolyline(QPolygonF(points))
        if self._shown in self._steps:
            place = points[self._steps.index(self._shown)]
            painter.setPen(QPen(QColor(theme.text), 1))
            painter.drawLine(QPointF(place.x(), area.top()), QPointF(place.x(), area.bottom()))
            painter.setBrush(QColor(theme.text))
            painter.drawEllipse(place, 3, 3)
        painter.end()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Tell the value under the mouse."""
        index = self._index_at(event.position().x())
        if index is not None:
            text = f"Step {self._steps[index]:,}: {self._values[index]:.4g} {self._unit}"
            if self._level is not None:
                text += f"\nDashed: {self._level_name}, {self._level:.4g}"
            QToolTip.showText(event.globalPosition().toPoint(), text, self)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Show the step under the mouse."""
        index = self._index_at(event.position().x())
        if index is not None and event.button() == Qt.MouseButton.LeftButton:
            self.stepClicked.emit(self._steps[index])

    def _range(self) -> tuple[float, float]:
        values = self._values if self._level is None else [*self._values, self._level]
        return min(values), max(values)

    def _area(self) -> QRectF:
        low, high = self._range()
        metrics = self.fontMetrics()
        left = max(metrics.horizontalAdvance(f"{low:.3g}"), metrics.horizontalAdvance(f"{high:.3g}")) + 12
        return QRectF(self.rect()).adjusted(left, _MARGIN, -_MARGIN, -_MARGIN)

    def _x_of(self, step: float, area: QRectF) -> float:
        first, last = self._steps[0], self._steps[-1]
        return area.left() + area.width() * ((step - first) / (last - first) if last > first else 0.5)

    def _y_of(self, value: float, area: QRectF) -> float:
        low, high = self._range()
        return area.bottom() - area.height() * ((value - low) / (high - low) if high > low else 0.5)

    def _index_at(self, x: float) -> int | None:
        if not self._steps:
            return None
        area = self._area()
        return min(range(len(self._steps)), key=lambda index: abs(self._x_of(self._steps[index], area) - x))
