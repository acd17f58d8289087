"""A frame around what has the focus, for those parts of the window that would not show it themselves."""

from __future__ import annotations

from qtpy.QtCore import QEvent, QObject, QRect, QRectF, Qt, QTimer
from qtpy.QtGui import QColor, QPainter, QPaintEvent, QPen
from qtpy.QtWidgets import QApplication, QMainWindow, QPushButton, QWidget

from dmp_viewer.theme import LIGHT, Theme

_WIDTH = 2


class FocusRing(QWidget):
    """Lies over the window, and lets the mouse through. It is seen only by those who use the keyboard.

    Args:
        window: whose focus is shown.
        bare: kinds of widgets that do not show the focus; highlighted buttons don't either.
    """

    def __init__(self, window: QMainWindow, bare: tuple[type[QWidget], ...]) -> None:
        super().__init__(window)
        self._window = window
        self._bare = bare
        self._target: QWidget | None = None
        self._theme = LIGHT
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.hide()
        # After the turn in which Qt takes note of whether a key or the mouse has moved the focus.
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(0)
        self._timer.timeout.connect(self._follow)
        application = QApplication.instance()
        if isinstance(application, QApplication):
            application.focusChanged.connect(self._on_focus_changed)

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        self.update()

    def _on_focus_changed(self, _before: QWidget | None, _now: QWidget | None) -> None:
        self._timer.start()

    def _follow(self) -> None:
        if self._target is not None:
            self._target.removeEventFilter(self)
        focused = self._window.focusWidget()
        by_key = self._window.isActiveWindow() and self._window.testAttribute(Qt.WidgetAttribute.WA_KeyboardFocusChange)
        self._target = focused if focused is not None and by_key and self._is_bare(focused) else None
        if self._target is not None:
            self._target.installEventFilter(self)
        self._lay()

    def _is_bare(self, widget: QWidget) -> bool:
        highlighted = isinstance(widget, QPushButton) and widget.isDefault()
        return isinstance(widget, self._bare) or highlighted

    def _lay(self) -> None:
        target = self._target
        if target is None or not target.isVisible() or target.window() is not self._window:
            self.hide()
            return
        place = QRect(target.mapTo(self._window, target.rect().topLeft()), target.size())
        self.setGeometry(place.adjusted(-_WIDTH, -_WIDTH, _WIDTH, _WIDTH) & self._window.rect())
        self.raise_()
        self.show()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Stay around the widget wherever it goes."""
        if event.type() in (QEvent.Type.Resize, QEvent.Type.Move, QEvent.Type.Show, QEvent.Type.Hide):
            self._lay()
        return super().eventFilter(watched, event)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the frame, of a light and a dark line so that it is seen on any ground."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        area = QRectF(self.rect()).adjusted(1, 1, -1, -1)
        painter.setPen(QPen(QColor(self._theme.halo), 2))
        painter.drawRect(area.adjusted(1, 1, -1, -1))
        painter.setPen(QPen(QColor(self._theme.accent), 2))
        painter.drawRect(area)
        painter.end()
