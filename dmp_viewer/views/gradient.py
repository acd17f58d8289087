"""The colours with their numbers below them and, above them, how many vertices have each; drawn by Qt, sharp at every scale."""

from __future__ import annotations

import numpy as np
from qtpy.QtCore import QPointF, QRectF, QSize, Qt
from qtpy.QtGui import QColor, QImage, QPainter, QPaintEvent, QPalette, QPen, QPolygonF
from qtpy.QtWidgets import QSizePolicy, QWidget

from dmp.quantities import nice_ticks, tick_text
from dmp_viewer.colors import PERCENTILE, ColorTable, Histogram, Limits

_BAR_HEIGHT = 11
_HISTOGRAM_HEIGHT = 24
_MARGIN = 26.0


class Gradient(QWidget):
    """A horizontal gradient with round numbers below it and a histogram above it."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._table: ColorTable = np.zeros((256, 4), dtype=np.uint8)
        self._limits = Limits(0.0, 1.0)
        self._factor = 1.0
        self._unit = ""
        self._percentile = PERCENTILE
        self._histogram: Histogram | None = None
        self._is_locked = False
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self._describe()

    def set_scale(self, table: ColorTable, limits: Limits, factor: float, unit: str, percentile: float = PERCENTILE) -> None:
        """Show a colour map over a range; numbers are ``factor`` times the limits, in ``unit``."""
        self._table, self._limits, self._factor, self._unit, self._percentile = table, limits, factor, unit, percentile
        self._describe()
        self.update()

    def set_histogram(self, histogram: Histogram | None) -> None:
        """Show how many vertices have each colour; None shows nothing."""
        self._histogram = histogram
        self._describe()
        self.update()

    def set_locked(self, locked: bool) -> None:
        """Say whether the range stays as it is."""
        self._is_locked = locked
        self._describe()

    @property
    def shown_limits(self) -> tuple[float, float]:
        """The numbers at both ends, in the shown unit."""
        return self._limits.low * self._factor, self._limits.high * self._factor

    @property
    def unit(self) -> str:
        """The shown unit."""
        return self._unit

    @property
    def histogram(self) -> Histogram | None:
        """What is drawn above the colours."""
        return self._histogram

    def sizeHint(self) -> QSize:
        """Return room for the histogram, the gradient and one line of numbers."""
        return QSize(320, _HISTOGRAM_HEIGHT + _BAR_HEIGHT + self.fontMetrics().height() + 9)

    def minimumSizeHint(self) -> QSize:
        """Return the least room in which three numbers can be told apart."""
        return QSize(140, self.sizeHint().height())

    def _describe(self) -> None:
        low, high = self.shown_limits
        self.setAccessibleName(f"Colour bar from {low:.3g} to {high:.3g} {self._unit}".rstrip())
        if self._is_locked:
            text = "The range is locked."
        elif self._percentile < 100:
            text = (
                f"The range covers {self._percentile:g} % of the vertices, so that a few far ones do not take all the colours."
            )
        else:
            text = "The range covers every vertex."
        text += " All panes share it. Double click to type the range."
        if self._histogram is not None:
            line = "; the line is the input" if self._histogram.others is not None else ""
            outside = self._histogram.share_outside
            beyond = f" {100 * outside:.1f} % of the vertices lie beyond the range." if outside >= 0.0005 else ""
            text += f"</p><p>Bars: how many vertices of the shown mesh have each colour{line}.{beyond}"
            self.setAccessibleDescription(beyond.strip())
        self.setToolTip(f"<p>{text}</p>")

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw histogram, gradient, ticks and numbers."""
        painter = QPainter(self)
        metrics = self.fontMetrics()
        bar = QRectF(_MARGIN, _HISTOGRAM_HEIGHT + 2, max(10.0, self.width() - 2 * _MARGIN), _BAR_HEIGHT)
        self._draw_histogram(painter, bar)
        colors = np.ascontiguousarray(self._table)
        image = QImage(colors.data, len(colors), 1, 4 * len(colors), QImage.Format.Format_RGBA8888)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawImage(bar, image)
        painter.setPen(QPen(self.palette().color(QPalette.ColorRole.Mid), 1))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawRect(bar)
        low, high = self.shown_limits
        widest = max(metrics.horizontalAdvance(text) for text in ("-0.00", f"{high:.3g}", f"{low:.3g}")) + 18
        ticks = nice_ticks(low, high, max(2, min(9, int(bar.width() / widest))))
        step = ticks[1] - ticks[0] if len(ticks) > 1 else 1.0
        painter.setPen(self.palette().color(QPalette.ColorRole.WindowText))
        for tick in ticks:
            x = bar.left() + (tick - low) / (high - low) * bar.width()
            painter.drawLine(round(x), round(bar.bottom()), round(x), round(bar.bottom()) + 3)
            text = tick_text(tick, step)
            place = QRectF(x - 60, bar.bottom() + 4, 120, metrics.height())
            painter.drawText(place, Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop, text)
        painter.end()

    def _draw_histogram(self, painter: QPainter, bar: QRectF) -> None:
        histogram = self._histogram
        if histogram is None:
            return
        counts, others = histogram.counts, histogram.others
        highest = max(int(counts.max(initial=0)), int(others.max(initial=0)) if others is not None else 0, 1)
        width, room = bar.width() / len(counts), _HISTOGRAM_HEIGHT - 3
        ink = QColor(self.palette().color(QPalette.ColorRole.WindowText))
        painter.setPen(Qt.PenStyle.NoPen)
        ink.setAlphaF(0.38)
        painter.setBrush(ink)
        for index, count in enumerate(counts.tolist()):
            height = room * count / highest
            painter.drawRect(QRectF(bar.left() + index * width, bar.top() - 1 - height, max(1.0, width - 0.5), height))
        if others is not None:
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            ink.setAlphaF(0.85)
            painter.setPen(QPen(ink, 1.2))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            points = [
                QPointF(bar.left() + (index + 0.5) * width, bar.top() - 1 - room * count / highest)
                for index, count in enumerate(others.tolist())
            ]
            painter.drawPolyline(QPolygonF(points))
