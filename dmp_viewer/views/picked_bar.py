"""What is known of the picked vertex: its value in each pane, and its history over the steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qtpy.QtCore import Qt, Signal
from qtpy.QtGui import QAction
from qtpy.QtWidgets import QFrame, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from dmp_viewer.theme import Theme
from dmp_viewer.views.buttons import tool_button
from dmp_viewer.views.history_plot import HistoryPlot


@dataclass(frozen=True)
class PickedValue:
    """What a pane shows of the picked vertex.

    Attributes:
        pane: name of the pane.
        value: with its unit or "–".
        details: the position, for the tool tip.
    """

    pane: str
    value: str
    details: str


class PickedBar(QWidget):
    """A row that is there only while a vertex is picked.

    Signals:
        stepClicked: a step in the history.
    """

    stepClicked = Signal(int)

    def __init__(self, actions: dict[str, QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._name = QLabel(self)
        self._unit = QLabel(self)
        self._texts: list[tuple[QLabel, QLabel]] = []
        font = self._name.font()
        font.setBold(True)
        self._name.setFont(font)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(8, 4, 8, 2)
        layout.setSpacing(14)
        layout.addLayout(_column(self._name, self._unit))
        for _ in range(3):
            name, value = QLabel(self), QLabel(self)
            value.setFont(font)
            value.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
            self._texts.append((name, value))
            line = QFrame(self)
            line.setFrameShape(QFrame.Shape.VLine)
            line.setFrameShadow(QFrame.Shadow.Plain)
            line.setForegroundRole(self.palette().ColorRole.Mid)
            layout.addWidget(line)
            layout.addLayout(_column(name, value))
        self.history = HistoryPlot(self)
        self.history.stepClicked.connect(self.stepClicked)
        layout.addWidget(self.history, 1)
        layout.addWidget(tool_button(actions["forget_vertex"]))
        self.setAccessibleName("Picked vertex")
        self.hide()

    def set_vertex(self, index: int | None, quantity: str, unit: str, values: Sequence[PickedValue]) -> None:
        """Show a vertex with its value in each pane; None hides the row."""
        self.setVisible(index is not None)
        if index is None:
            return
        self._name.setText(f"Vertex {index:,}")
        self._unit.setText(f"{quantity}, {unit}" if unit else quantity)
        for (name, value), shown in zip(self._texts, values, strict=True):
            name.setText(shown.pane)
            value.setText(shown.value)
            for label in (name, value):
                label.setToolTip(shown.details)
        self.setAccessibleDescription("; ".join(f"{shown.pane}: {shown.value}" for shown in values))

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        for label in (self._unit, *(name for name, _ in self._texts)):
            palette = label.palette()
            palette.setColor(label.foregroundRole(), theme.subtle)
            label.setPalette(palette)
        self.history.set_theme(theme)

    @property
    def texts(self) -> list[str]:
        """All that is written."""
        return [self._name.text(), self._unit.text(), *(value.text() for _, value in self._texts)]


def _column(first: QLabel, second: QLabel) -> QVBoxLayout:
    column = QVBoxLayout()
    column.setSpacing(1)
    column.addWidget(first)
    column.addWidget(second)
    return column
