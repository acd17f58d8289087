"""Tells a short press of a key from a long one: a press switches something, a long one only as long as it is held.

Every event of the application passes through Python while its key is watched, so it is watched only from the moment when
the key goes down until it comes up, or until it cannot be heard any more because another window has the keyboard.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from qtpy.QtCore import QEvent, QObject
from qtpy.QtGui import QAction, QGuiApplication, QKeyEvent

_LONG_SECONDS = 0.35


class HeldKey(QObject):
    """Watches the key of an action from each time that the key itself triggered the action.

    Args:
        action: with a single key; it must not repeat while the key is held.
        released: called when the key is let go after a long press.
    """

    def __init__(self, action: QAction, released: Callable[[], None]) -> None:
        super().__init__(action)
        self._action = action
        self._released = released
        self._since = 0.0
        self._is_watching = False
        # An action hears of its key, and of nothing when a menu or a button triggers it.
        action.installEventFilter(self)
        application = _application()
        application.focusWindowChanged.connect(self._end)

    @property
    def is_watching(self) -> bool:
        """Whether the key is down, so that its release is waited for."""
        return self._is_watching

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Begin when the key triggers the action, and wait for the key to be let go."""
        if watched is self._action:
            if event.type() == QEvent.Type.Shortcut:
                self._begin()
        elif event.type() == QEvent.Type.KeyRelease and isinstance(event, QKeyEvent) and not event.isAutoRepeat():
            keys = [key[0].key() for key in self._action.shortcuts()]
            if not keys or event.key() in keys:
                self._end()
        return False

    def _begin(self) -> None:
        self._since = time.monotonic()
        if not self._is_watching:
            self._is_watching = True
            _application().installEventFilter(self)

    def _end(self, *_: object) -> None:
        if not self._is_watching:
            return
        self._is_watching = False
        _application().removeEventFilter(self)
        if time.monotonic() - self._since > _LONG_SECONDS:
            self._released()


def _application() -> QGuiApplication:
    application = QGuiApplication.instance()
    assert isinstance(application, QGuiApplication)
    return application
