"""A slider over the snapshots of a run, with marks for the steps that matter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qtpy.QtCore import QEvent, QPointF, Qt
from qtpy.QtGui import QColor, QHelpEvent, QPainter, QPaintEvent, QPolygonF
from qtpy.QtWidgets import QSlider, QStyle, QStyleOptionSlider, QToolTip, QWidget

_NEAR_PIXELS = 7.0
_MARK_WIDTH = 9.0


@dataclass(frozen=True)
class SliderMark:
    """What is drawn at a snapshot.

    Attributes:
        index: of the snapshot.
        shape: ``kept``, ``suggested``, ``held_out``, ``best``, ``reference`` or ``bookmark``; each has a shape of its own.
        color: as ``#rrggbb``.
        sentence: why it is marked.
    """

    index: int
    shape: str
    color: str
    sentence: str


class SnapshotSlider(QSlider):
    """A slider whose positions are snapshots."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self._marks: list[SliderMark] = []
        self._text = ""
        self.setTracking(True)
        self.setPageStep(5)
        self.setFixedHeight(34)

    def set_marks(self, marks: Sequence[SliderMark]) -> None:
        """Mark snapshots."""
        if list(marks) != self._marks:
            self._marks = list(marks)
            self.setAccessibleDescription(" ".join(mark.sentence for mark in marks))
            self.update()

    def set_text(self, text: str) -> None:
        """Say what is told where no mark is near."""
        self._text = text

    def marks_at(self, x: float) -> list[SliderMark]:
        """Return the marks near a place."""
        return [mark for mark, place in zip(self._marks, self._places(), strict=True) if abs(place - x) <= _NEAR_PIXELS]

    def x_of(self, index: int) -> float:
        """Return where the middle of the handle is at a snapshot."""
        option = QStyleOptionSlider()
        self.initStyleOption(option)
        length = self.style().pixelMetric(QStyle.PixelMetric.PM_SliderLength, option, self)
        span = self.width() - length
        share = (index - self.minimum()) / max(1, self.maximum() - self.minimum())
        return length / 2 + share * span

    def _places(self) -> list[float]:
        """Return where each mark is drawn: side by side where several have one snapshot."""
        places = []
        for mark in self._marks:
            row = [other for other in self._marks if (other.shape == "bookmark") == (mark.shape == "bookmark")]
            same = [other for other in row if other.index == mark.index]
            half = _MARK_WIDTH * len(same) / 2
            middle = min(max(self.x_of(mark.index), half), self.width() - half)
            places.append(middle + _MARK_WIDTH * (same.index(mark) + 0.5) - half)
        return places

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the slider, the marks below it, and the bookmarks above it."""
        super().paintEvent(event)
        if self.maximum() <= self.minimum():
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for mark, x in zip(self._marks, self._places(), strict=True):
            painter.setPen(QColor(mark.color))
            painter.setBrush(QColor(mark.color) if mark.shape in ("kept", "bookmark") else Qt.BrushStyle.NoBrush)
            bottom = self.height() - 1.0
            match mark.shape:
                case "bookmark":
                    painter.drawPolygon(_polygon(x, 0.5, (-3, 0), (3, 0), (3, 8), (0, 5), (-3, 8)))
                case "best":
                    painter.drawPolygon(_polygon(x, bottom - 4, (0, -4), (4, 0), (0, 4), (-4, 0)))
                case "reference":
                    painter.drawPolygon(_polygon(x, bottom - 4, (-3, -3), (3, -3), (3, 3), (-3, 3)))
                case "held_out":
                    painter.drawEllipse(QPointF(x, bottom - 4), 3.4, 3.4)
                case _:
                    painter.drawPolygon(_polygon(x, bottom, (0, -7), (-4, 0), (4, 0)))
        painter.end()

    def event(self, event: QEvent) -> bool:
        """Say why a snapshot is marked when the mouse rests on its mark."""
        if event.type() == QEvent.Type.ToolTip and isinstance(event, QHelpEvent):
            marks = self.marks_at(event.pos().x())
            text = "\n".join(mark.sentence for mark in marks) or self._text
            QToolTip.showText(event.globalPos(), text, self)
            return True
        return super().event(event)


def _polygon(x: float, y: float, *corners: tuple[float, float]) -> QPolygonF:
    return QPolygonF([QPointF(x + across, y + down) for across, down in corners])
