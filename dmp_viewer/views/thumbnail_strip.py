"""Small pictures of some snapshots above the slider, each over its place on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from qtpy.QtCore import QPoint, QRectF, QSize, Qt, QTimer, Signal
from qtpy.QtGui import QColor, QHelpEvent, QImage, QMouseEvent, QPainter, QPaintEvent, QPen, QResizeEvent
from qtpy.QtWidgets import QSizePolicy, QToolTip, QWidget

from dmp_viewer.theme import LIGHT, Theme

PICTURE = QSize(50, 38)
_GAP = 6
# Pictures of a run that grows: old ones are seen again when the window becomes wider.
_MOST_PICTURES = 200


class ThumbnailStrip(QWidget):
    """Shows as many snapshots as fit, evenly chosen.

    Signals:
        stepChosen: the step of a picture that was clicked.
        picturesWanted: steps whose pictures are missing.
    """

    stepChosen = Signal(int)
    picturesWanted = Signal(object)

    def __init__(self, x_of: Callable[[int], float], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._x_of = x_of
        self._steps: list[int] = []
        self._shown: int | None = None
        self._pictures: dict[int, QImage] = {}
        self._theme = LIGHT
        self.setFixedHeight(PICTURE.height() + 4)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setAccessibleName("Pictures of the snapshots")
        self.setCursor(Qt.CursorShape.PointingHandCursor)

    def set_steps(self, steps: Sequence[int]) -> None:
        """Show other snapshots; the pictures of those that are still there stay."""
        self._steps = list(steps)
        self.want()
        self.update()

    def set_shown_step(self, step: int | None) -> None:
        """Frame the picture nearest to the shown step."""
        if step != self._shown:
            self._shown = step
            self.update()

    def set_picture(self, step: int, picture: QImage) -> None:
        """Show the picture of a snapshot."""
        while len(self._pictures) >= _MOST_PICTURES:
            del self._pictures[next(iter(self._pictures))]
        self._pictures[step] = picture
        self.update()

    def forget_pictures(self) -> None:
        """Drop all pictures: they are of another run."""
        self._pictures.clear()
        self.want()
        self.update()

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        self.update()

    def indices(self) -> list[int]:
        """Return which snapshots have a picture; a growing run keeps most of those that it has."""
        count = len(self._steps)
        room = max(1, self.width() // (PICTURE.width() + _GAP))
        # 1, 2, 3, 4, 6, 8, 12, 16, …: each but the first is a multiple of the one before the last.
        strides = (1, *(factor << power for power in range(30) for factor in (2, 3)))
        fitting = [range(0, count, stride) for stride in strides if -(-count // stride) <= room]
        # The picture at an end stands further in than its step, which takes room from its neighbour.
        return list(next((found for found in fitting if len(found) <= 2 or not self._overlap(found)), fitting[0]))

    def _overlap(self, indices: range) -> bool:
        ends = ((indices[0], indices[1]), (indices[-2], indices[-1]))
        return any(self._place(after).left() - self._place(before).right() < 2 for before, after in ends)

    def missing(self) -> list[int]:
        """Return the steps whose pictures are missing."""
        return [self._steps[index] for index in self.indices() if self._steps[index] not in self._pictures]

    def want(self) -> None:
        """Ask for the missing pictures, if anybody can see them."""
        missing = self.missing()
        if missing and self.isVisible():
            self.picturesWanted.emit(missing)

    def _place(self, index: int) -> QRectF:
        half = PICTURE.width() / 2
        x = min(max(self._x_of(index), half + 1), self.width() - half - 1)
        return QRectF(x - half, 2, PICTURE.width(), PICTURE.height())

    def _index_at(self, place: QPoint) -> int | None:
        return next((index for index in self.indices() if self._place(index).contains(place)), None)

    # -- events -------------------------------------------------------------------------------------------------------

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the pictures; those that are not there yet as empty frames."""
        painter = QPainter(self)
        painter.setRenderHints(QPainter.RenderHint.Antialiasing | QPainter.RenderHint.SmoothPixmapTransform)
        indices = self.indices()
        framed = None
        if self._shown is not None and indices:
            shown = self._shown
            framed = min(indices, key=lambda index: abs(self._steps[index] - shown))
        for index in indices:
            place = self._place(index)
            is_framed = index == framed
            painter.setPen(QPen(QColor(self._theme.accent if is_framed else self._theme.line), 2 if is_framed else 1))
            painter.setBrush(QColor(self._theme.base))
            painter.drawRoundedRect(place, 3, 3)
            picture = self._pictures.get(self._steps[index])
            if picture is not None:
                painter.drawImage(place.adjusted(1, 1, -1, -1), picture)
        painter.end()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Show the snapshot of the picture."""
        index = self._index_at(event.position().toPoint())
        if index is not None and event.button() == Qt.MouseButton.LeftButton:
            self.stepChosen.emit(self._steps[index])

    def resizeEvent(self, event: QResizeEvent) -> None:
        """There is room for more, or fewer."""
        super().resizeEvent(event)
        # With the next turn: where the steps lie is known when the slider has its new width as well.
        QTimer.singleShot(0, self, self.want)

    def showEvent(self, event: object) -> None:
        """Now the pictures can be seen."""
        super().showEvent(event)
        self.want()

    def event(self, event: object) -> bool:
        """Tell the step of a picture."""
        if isinstance(event, QHelpEvent):
            index = self._index_at(event.pos())
            QToolTip.showText(event.globalPos(), "" if index is None else f"Step {self._steps[index]:,}", self)
            return True
        return bool(super().event(event))
