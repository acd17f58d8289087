"""The line or the circle that parts two meshes in one pane: to be dragged, moved by keys, or led by the mouse."""

from __future__ import annotations

from qtpy.QtCore import QEvent, QPointF, QRect, QRectF, Qt, Signal
from qtpy.QtGui import QColor, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPen
from qtpy.QtWidgets import QWidget

from dmp_viewer.theme import LIGHT, Theme
from dmp_viewer.views.pane import CUT_CIRCLE, CUT_LINE, CUT_NONE

_GRIP = 11
# The lens, as a share of the smaller side of the pane.
_RADIUS = 0.24
_KEY_STEP = 0.02
_MOVES = {Qt.Key.Key_Left: (-1, 0), Qt.Key.Key_Right: (1, 0), Qt.Key.Key_Up: (0, -1), Qt.Key.Key_Down: (0, 1)}


class CutHandle(QWidget):
    """Lies over a pane.

    Signals:
        moved: the cut is somewhere else.
    """

    moved = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._theme = LIGHT
        self._area = QRect(0, 0, 100, 100)
        self._share = QPointF(0.5, 0.5)
        self.mode = CUT_NONE
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setAttribute(Qt.WidgetAttribute.WA_NoSystemBackground)
        self.hide()

    def set_mode(self, mode: int) -> None:
        """Be a line, a circle, or not there; it begins in the middle of the pane."""
        if mode == self.mode:
            return
        self.mode = mode
        self._share = QPointF(0.5, 0.5)
        is_line = mode == CUT_LINE
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents, not is_line)
        self.setCursor(Qt.CursorShape.SplitHCursor)
        self.setAccessibleName("Swipe line" if is_line else "Lens")
        self.setAccessibleDescription("Arrow keys move it.")
        self.setToolTip("Drag, or move with the arrow keys." if is_line else "")
        self.setVisible(mode != CUT_NONE)
        self._place()

    def set_area(self, area: QRect) -> None:
        """Lie over a pane at another place."""
        self._area = area
        self._place()

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        self.update()

    @property
    def centre(self) -> QPointF:
        """Where the cut is, in pixels of the parent."""
        return QPointF(
            self._area.x() + self._share.x() * self._area.width(), self._area.y() + self._share.y() * self._area.height()
        )

    @property
    def radius(self) -> float:
        """Radius of the circle, pixels."""
        return _RADIUS * min(self._area.width(), self._area.height())

    def move_to(self, place: QPointF) -> None:
        """Bring the cut to a place, in pixels of the parent."""
        area = self._area
        across, down = (place.x() - area.x()) / max(1, area.width()), (place.y() - area.y()) / max(1, area.height())
        share = QPointF(min(max(across, 0.0), 1.0), min(max(down, 0.0), 1.0))
        if share != self._share:
            self._share = share
            self._place()
            self.moved.emit()

    def _place(self) -> None:
        centre = self.centre
        if self.mode == CUT_LINE:
            self.setGeometry(round(centre.x()) - _GRIP, self._area.y(), 2 * _GRIP + 1, self._area.height())
        elif self.mode == CUT_CIRCLE:
            size = round(2 * self.radius) + 6
            self.setGeometry(round(centre.x() - size / 2), round(centre.y() - size / 2), size, size)
        self.update()

    # -- events -------------------------------------------------------------------------------------------------------

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the line with a grip, or the circle; wider when it has the focus."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        wide = 3.0 if self.hasFocus() else 2.0
        pens = QPen(QColor(self._theme.halo), wide + 2), QPen(QColor(self._theme.text), wide)
        if self.mode == CUT_CIRCLE:
            painter.setBrush(Qt.BrushStyle.NoBrush)
            for pen in pens:
                painter.setPen(pen)
                painter.drawEllipse(QRectF(self.rect()).adjusted(3, 3, -3, -3))
            painter.end()
            return
        middle = self.width() / 2
        for pen in pens:
            painter.setPen(pen)
            painter.drawLine(QPointF(middle, 0), QPointF(middle, self.height()))
        painter.setPen(QPen(QColor(self._theme.halo), 1.5))
        painter.setBrush(QColor(self._theme.text))
        centre = QPointF(middle, self.height() / 2)
        painter.drawEllipse(centre, _GRIP - 1.5, _GRIP - 1.5)
        painter.setPen(QPen(QColor(self._theme.base), 1.8))
        for side in (-1, 1):
            tip = centre + QPointF(side * 6.0, 0)
            painter.drawLine(tip, tip + QPointF(-side * 3.0, -3.0))
            painter.drawLine(tip, tip + QPointF(-side * 3.0, 3.0))
        painter.end()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Follow the hand."""
        if event.buttons() & Qt.MouseButton.LeftButton:
            self.move_to(QPointF(self.mapToParent(event.position().toPoint())))

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Take hold."""
        event.accept()

    def event(self, event: QEvent) -> bool:
        """Keep the arrow keys from the timeline while it has the focus."""
        if event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent) and event.key() in _MOVES:
            event.accept()
            return True
        return super().event(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Move by the arrow keys."""
        move = _MOVES.get(Qt.Key(event.key()))
        if move is None:
            event.ignore()
            return
        step = QPointF(move[0] * _KEY_STEP * self._area.width(), move[1] * _KEY_STEP * self._area.height())
        self.move_to(self.centre + step)
