"""Meshes above, curve below: who of both gives way when the room changes."""

from __future__ import annotations

from qtpy.QtCore import Qt, QTimer
from qtpy.QtGui import QResizeEvent
from qtpy.QtWidgets import QSplitter, QWidget


class Rows(QSplitter):
    """Two parts one above the other that share a higher or lower window, except for what passes by.

    Meshes that get another size have to be drawn anew, by software in a tenth of a second and more. So a message that comes
    for a while takes its room from the part below alone, and gives it back to it.

    Args:
        upper: widget above, with the larger share.
        lower: widget below.
    """

    def __init__(self, upper: QWidget, lower: QWidget) -> None:
        super().__init__(Qt.Orientation.Vertical)
        self._lower = lower
        self._upper_stays = False
        self.addWidget(upper)
        self.addWidget(lower)
        self.setStretchFactor(0, 3)
        self.setStretchFactor(1, 1)

    def keep_upper(self) -> None:
        """Let the part below alone take the next change of height, which comes in this turn of the event loop."""
        self._upper_stays = True
        QTimer.singleShot(0, self, self._share_again)

    def _share_again(self) -> None:
        self._upper_stays = False

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Share the new height."""
        upper, lower = self.sizes()
        rest = self.height() - self.handleWidth() - upper
        if self._upper_stays and self._lower.isVisible() and lower and rest >= self._lower.minimumSizeHint().height():
            self.setSizes([upper, rest])
        else:
            super().resizeEvent(event)
