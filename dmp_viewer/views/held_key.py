"""Tells a short press of a key from a long one: a press switches something, a long one only as long as it is held."""

from __future__ import annotations

import time
from collections.abc import Callable

from qtpy.QtCore import QEvent, QObject
from qtpy.QtGui import QAction, QKeyEvent, QKeySequence
from qtpy.QtWidgets import QApplication

_LONG_SECONDS = 0.35


class HeldKey(QObject):
    """Watches the key of an action from each time that the action was triggered.

    Args:
        action: with a single key; it must not repeat while the key is held.
        released: called when the key is let go after a long press.
    """

    def __init__(self, action: QAction, released: Callable[[], None]) -> None:
        super().__init__(action)
        self._action = action
        self._released = released
        self._since = 0.0
        action.triggered.connect(self._on_triggered)

    def _on_triggered(self) -> None:
        self._since = time.monotonic()
        application = QApplication.instance()
        if application is not None:
            application.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Wait for the key to be let go."""
        if event.type() == QEvent.Type.KeyRelease and isinstance(event, QKeyEvent) and not event.isAutoRepeat():
            application = QApplication.instance()
            if application is not None:
                application.removeEventFilter(self)
            is_key = QKeySequence(event.key()) == self._action.shortcut()
            if is_key and time.monotonic() - self._since > _LONG_SECONDS:
                self._released()
        return False
