"""The one 3-D widget of the window: three panes in one OpenGL surface, drawn only when something has changed.

Invariants, each with what happens when it is broken:

- One interactor for the whole life of the window. Opening and closing several crashes drivers.
- Nothing calls ``render()``; changes are marked with :meth:`Interactor.mark`, and the next paint draws them together. A
  mouse move that renders by itself costs every frame twice, because the paint that follows renders again.
- A paint draws only the panes that were marked. With software rendering each pane costs about 20 ms, and scrubbing changes
  one of three.
- Keys go to the window. VTK binds ``q``, ``e``, ``p``, ``3`` and more by itself; ``q`` would end the view.
- Files dropped here belong to the window. pyvistaqt would load them into the scene.
- The Python side of the surface ends with the surface. It is no QObject, so PySide cannot see it go, and hands the stale
  wrapper out for whatever object Qt makes next at that address: a menu action without ``setVisible``.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any

from pyvistaqt import QtInteractor
from qtpy.QtCore import QPoint, Qt, Signal
from qtpy.QtGui import QKeyEvent, QMouseEvent, QResizeEvent
from qtpy.QtWidgets import QWidget
from qtpy.shiboken import invalidate

N_PANES = 3
# A hand that moves less than this between press and release has clicked, not dragged.
_STILL_PIXELS = 3


class Interactor(QtInteractor):
    """Three panes side by side that paint on demand.

    Signals:
        painted: after each paint, with the indices of the panes that were drawn.
        resized: the widget has another size.
        clicked: where the left button was pressed and released without a move, a point.
        hovered: where the mouse is, a point.
        interacted: somebody turns, moves or zooms the view right now.
    """

    painted = Signal(object)
    resized = Signal()
    clicked = Signal(QPoint)
    hovered = Signal(QPoint)
    interacted = Signal()

    def __init__(self, parent: QWidget, *, multi_samples: int) -> None:
        super().__init__(
            parent, shape=(1, N_PANES), auto_update=False, multi_samples=multi_samples, lighting="light kit", border=False
        )
        self.setAcceptDrops(False)
        self.reset_key_events()
        self._marked: set[int] = set()
        self._pressed: QPoint | None = None
        self._is_resizing = False
        # Rendering on each mouse move would draw twice; the move asks for a paint instead.
        self._Iren.EnableRenderOff()
        self._render_observer = self._Iren.AddObserver("RenderEvent", self._on_interaction)

    def mark(self, panes: Iterable[int] = range(N_PANES)) -> None:
        """Have these panes drawn anew with the next paint."""
        self._marked.update(panes)
        self.update()

    def _on_interaction(self, *_: Any) -> None:
        if not self._in_paint:
            self.mark()
            self.interacted.emit()

    def initializeGL(self) -> None:
        """Give VTK the context that Qt made, and let go of its surface when Qt ends both."""
        super().initializeGL()
        if self._ctx is not None:
            # Qt deletes the surface right after the context. No method of this widget would hear that any more when the
            # window goes first, so the connection must not hang on it.
            self._ctx.aboutToBeDestroyed.connect(partial(invalidate, self._surface))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Take another size; Qt would paint at once, and once more with the rest of the window."""
        self._is_resizing = True
        try:
            super().resizeEvent(event)
        finally:
            self._is_resizing = False
        self.mark()

    def paintGL(self) -> None:
        """Draw the marked panes; all of them when the paint has another cause, such as a new size."""
        if self._is_resizing:
            return
        drawn = self._marked or set(range(N_PANES))
        self._marked = set()
        for index, renderer in enumerate(self.renderers):
            renderer.SetDraw(index in drawn)
        self._Iren.EnableRenderOn()
        try:
            super().paintGL()
        finally:
            if self._RenderWindow is not None:
                self._Iren.EnableRenderOff()
                for renderer in self.renderers:
                    renderer.SetDraw(True)
        self.painted.emit(drawn)

    def resizeGL(self, width: int, height: int) -> None:
        """Take a new size; what was drawn before is gone then."""
        self._marked = set(range(N_PANES))
        super().resizeGL(width, height)
        self.resized.emit()

    def showEvent(self, event: Any) -> None:
        """Draw everything when the widget comes into view."""
        self._marked = set(range(N_PANES))
        super().showEvent(event)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Turn the view from here on, unless it becomes a click."""
        plain = event.button() == Qt.MouseButton.LeftButton and not event.modifiers()
        self._pressed = event.position().toPoint() if plain else None
        super().mousePressEvent(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Tell where the mouse is."""
        super().mouseMoveEvent(event)
        self.hovered.emit(event.position().toPoint())

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """Tell a click from a drag."""
        super().mouseReleaseEvent(event)
        place = event.position().toPoint()
        if self._pressed is not None and (place - self._pressed).manhattanLength() <= _STILL_PIXELS:
            self.clicked.emit(place)
        self._pressed = None

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Leave keys to the window."""
        event.ignore()

    def keyReleaseEvent(self, event: QKeyEvent) -> None:
        """Leave keys to the window."""
        event.ignore()
