"""What stands above a pane: its name, facts about it, and a menu where it can show something else."""

from __future__ import annotations

from collections.abc import Sequence

from qtpy.QtCore import Qt
from qtpy.QtGui import QFont, QFontMetrics, QResizeEvent
from qtpy.QtWidgets import QHBoxLayout, QLabel, QMenu, QSizePolicy, QToolButton, QVBoxLayout, QWidget

_SEPARATOR = "  ·  "


class PaneTitle(QWidget):
    """Name of a pane in bold, facts about it in a quieter line below."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._title = QLabel(self)
        self._button = QToolButton(self)
        self._facts = QLabel(self)
        font = QFont(self._title.font())
        font.setBold(True)
        self._title.setFont(font)
        self._title.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self._facts.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        for label in (self._title, self._facts):
            label.setAlignment(Qt.AlignmentFlag.AlignCenter)
            label.setTextFormat(Qt.TextFormat.PlainText)
        self._button.setAutoRaise(True)
        self._button.setFont(font)
        self._button.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextOnly)
        self._button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self._button.setFixedHeight(self._title.fontMetrics().height() + 4)
        # As high as the button, so that all names stand on one line.
        self._title.setFixedHeight(self._button.height())
        self._button.hide()
        head = QHBoxLayout()
        head.setContentsMargins(0, 0, 0, 0)
        head.addWidget(self._title, 1)
        head.addWidget(self._button, 1, Qt.AlignmentFlag.AlignHCenter)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(8, 5, 8, 5)
        layout.setSpacing(1)
        layout.addLayout(head)
        layout.addWidget(self._facts)
        self._name = ""
        self._all_facts: tuple[str, ...] = ()
        self.setFixedHeight(self.sizeHint().height())

    def set_menu(self, menu: QMenu, name: str, tip: str) -> None:
        """Turn the name into a button that offers what else the pane can show."""
        # A menu given to the button itself would bring the style's own arrow, tiny and below the text.
        self._button.clicked.connect(lambda: menu.popup(self._button.mapToGlobal(self._button.rect().bottomLeft())))
        self._button.setAccessibleName(name)
        self._button.setToolTip(tip)
        self._button.show()
        self._title.hide()

    def set_texts(self, title: str, facts: Sequence[str], details: str = "") -> None:
        """Say what the pane shows; details are in the tool tip.

        Args:
            title: name of the pane.
            facts: the most important first. Those that do not fit any more are left out.
            details: what the tool tip says, by default all the facts.
        """
        self._name = title
        self._all_facts = tuple(facts)
        self.setToolTip(details or _SEPARATOR.join(facts))
        self._elide()

    @property
    def texts(self) -> tuple[str, str]:
        """Title and facts."""
        return self._name, _SEPARATOR.join(self._all_facts)

    def set_subtle_color(self, color: str) -> None:
        """Colour the line of facts."""
        palette = self._facts.palette()
        palette.setColor(self._facts.foregroundRole(), color)
        self._facts.setPalette(palette)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Cut the facts to the new width."""
        super().resizeEvent(event)
        self._elide()

    def _elide(self) -> None:
        width = max(20, self.width() - 16)
        bold = QFontMetrics(self._title.font())
        self._title.setText(bold.elidedText(self._name, Qt.TextElideMode.ElideMiddle, width))
        self._button.setText(bold.elidedText(self._name, Qt.TextElideMode.ElideMiddle, max(20, width - 28)) + "  ▾")
        metrics = QFontMetrics(self._facts.font())
        count = len(self._all_facts)
        while count > 1 and metrics.horizontalAdvance(_SEPARATOR.join(self._all_facts[:count])) > width:
            count -= 1
        text = _SEPARATOR.join(self._all_facts[:count])
        self._facts.setText(metrics.elidedText(text, Qt.TextElideMode.ElideRight, width))
