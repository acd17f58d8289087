"""Messages in the window: one sentence each, details on demand, never a dialog in the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from qtpy.QtCore import QEvent, Qt, Signal
from qtpy.QtGui import QColor, QPalette
from qtpy.QtWidgets import (
    QApplication,
    QFrame,
    QHBoxLayout,
    QLabel,
    QPlainTextEdit,
    QPushButton,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from dmp_viewer.icons import icon, pixmap
from dmp_viewer.theme import LIGHT, Theme

Kind = Literal["info", "warning", "error", "success"]
_MOST_BANNERS = 3


@dataclass(frozen=True)
class Message:
    """What is told.

    Attributes:
        kind: how serious it is.
        text: one or two sentences.
        details: what helps to find the cause, shown on demand; may be empty.
        action: text of a button and what it does, or None.
        other: likewise of a second button, behind the first one.
    """

    kind: Kind
    text: str
    details: str = ""
    action: tuple[str, Callable[[], None]] | None = None
    other: tuple[str, Callable[[], None]] | None = None


class Banner(QFrame):
    """One message with its buttons.

    Signals:
        dismissed: it goes; with the next turn it is deleted.
    """

    dismissed = Signal()

    def __init__(self, message: Message, parent: QWidget) -> None:
        super().__init__(parent)
        self.message = message
        self._count = 1
        self.setAutoFillBackground(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self._sign = QLabel(self)
        self._text = QLabel(message.text, self)
        self._text.setWordWrap(True)
        self._text.setTextFormat(Qt.TextFormat.PlainText)
        self._text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        row = QHBoxLayout()
        row.setSpacing(8)
        row.addWidget(self._sign, 0, Qt.AlignmentFlag.AlignTop)
        row.addWidget(self._text, 1)
        for action in (message.action, message.other):
            if action is not None:
                button = QPushButton(action[0], self)
                button.clicked.connect(action[1])
                button.clicked.connect(self.dismiss)
                row.addWidget(button)
        self._details = QPlainTextEdit(message.details, self)
        self._details.setReadOnly(True)
        self._details.setFixedHeight(110)
        self._details.hide()
        if message.details:
            self.details_button = QPushButton("Details", self)
            self.details_button.setCheckable(True)
            self.details_button.toggled.connect(self._details.setVisible)
            copy = QPushButton("Copy", self)
            copy.setToolTip("Copy the message with its details, for a bug report.")
            copy.clicked.connect(self._copy)
            row.addWidget(self.details_button)
            row.addWidget(copy)
        self._close = QToolButton(self)
        self._close.setAutoRaise(True)
        self._close.setAccessibleName("Close this message")
        self._close.setToolTip("Close this message")
        self._close.clicked.connect(self.dismiss)
        row.addWidget(self._close, 0, Qt.AlignmentFlag.AlignTop)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(12, 6, 8, 6)
        layout.addLayout(row)
        layout.addWidget(self._details)

    def repeat(self) -> None:
        """The same message came again: count it instead of stacking it."""
        self._count += 1
        self._text.setText(f"{self.message.text} ({self._count} times)")

    def dismiss(self) -> None:
        """Take the message away."""
        self.hide()
        self.dismissed.emit()
        self.deleteLater()

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        color = {"info": theme.info, "warning": theme.warning, "error": theme.error, "success": theme.success}[
            self.message.kind
        ]
        palette = self.palette()
        palette.setColor(QPalette.ColorRole.Window, QColor(color))
        self.setPalette(palette)
        self._sign.setPixmap(pixmap(self.message.kind, theme.text, 18, 2.0))
        self._sign.setAccessibleName(self.message.kind)
        self._close.setIcon(icon("close", theme))

    def _copy(self) -> None:
        QApplication.clipboard().setText(f"{self.message.text}\n\n{self.message.details}")


class BannerArea(QWidget):
    """The place of the messages, above the meshes; empty most of the time.

    Signals:
        heightChanging: messages come or go; what lies below gets its new height right after this.
    """

    heightChanging = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = LIGHT
        self._banners: list[Banner] = []
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setSpacing(1)

    def show_message(self, message: Message) -> None:
        """Show a message; a repeated one is counted, and the oldest goes when there are too many."""
        banners = self.banners()
        for banner in banners:
            if banner.message.text == message.text and banner.message.kind == message.kind:
                banner.repeat()
                return
        for banner in banners[: max(0, len(banners) + 1 - _MOST_BANNERS)]:
            banner.dismiss()
        banner = Banner(message, self)
        banner.set_theme(self._theme)
        banner.dismissed.connect(partial(self._forget, banner))
        self._banners.append(banner)
        self._layout.addWidget(banner)
        self.heightChanging.emit()
        banner.show()

    def banners(self) -> list[Banner]:
        """Return the messages on show, oldest first."""
        return list(self._banners)

    def _forget(self, banner: Banner) -> None:
        if banner in self._banners:
            self._banners.remove(banner)
            self._layout.removeWidget(banner)

    def texts(self) -> list[str]:
        """Return the sentences on show, oldest first."""
        return [banner.message.text for banner in self.banners()]

    def clear(self, *kinds: Kind) -> None:
        """Take messages of these kinds away; all without arguments."""
        for banner in self.banners():
            if not kinds or banner.message.kind in kinds:
                banner.dismiss()

    def event(self, event: QEvent) -> bool:
        """Tell before a message that goes, or has more to say, changes the height."""
        if event.type() == QEvent.Type.LayoutRequest:
            self.heightChanging.emit()
        return super().event(event)

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        for banner in self.banners():
            banner.set_theme(theme)
