"""Buttons that do and show what an action does."""

from __future__ import annotations

from qtpy.QtCore import Qt
from qtpy.QtGui import QAction, QKeySequence
from qtpy.QtWidgets import QPushButton, QToolButton


def tool_button(action: QAction, *, with_text: bool = False) -> QToolButton:
    """Return a flat button for an action, with a name for screen readers when it shows only a picture."""
    button = QToolButton()
    button.setDefaultAction(action)
    button.setAutoRaise(True)
    button.setAccessibleName(action.text().replace("&", ""))
    button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    style = Qt.ToolButtonStyle.ToolButtonTextBesideIcon if with_text else Qt.ToolButtonStyle.ToolButtonIconOnly
    button.setToolButtonStyle(style)
    return button


def with_key(text: str, action: QAction) -> str:
    """Return a text with the key of an action in brackets, when it has one."""
    key = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
    return f"{text} ({key})" if key else text


def follow_action(button: QPushButton, action: QAction) -> None:
    """Let a push button follow an action; QPushButton has no default action."""

    def update() -> None:
        button.setText(action.text().replace("&", ""))
        button.setIcon(action.icon())
        button.setEnabled(action.isEnabled())
        button.setToolTip(action.toolTip())

    button.clicked.connect(action.trigger)
    action.changed.connect(update)
    update()
