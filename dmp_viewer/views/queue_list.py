"""The part of the runs' dock that shows which trainings wait, in their order."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qtpy.QtCore import QSize, Qt, QTimer, Signal
from qtpy.QtGui import QAction, QColor, QKeyEvent, QPalette
from qtpy.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QVBoxLayout,
    QWidget,
)

from dmp_viewer.icons import icon
from dmp_viewer.queue_model import Waiting
from dmp_viewer.theme import LIGHT, Theme
from dmp_viewer.views.buttons import tool_button

_FOLDER = int(Qt.ItemDataRole.UserRole)
_HINT = "Nothing waits. Add takes the open mesh with the settings of the run panel."
_MOST_ROWS = 4


class _Rows(QListWidget):
    """Rows that can be dragged into another order."""

    moved = Signal()
    removeRequested = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setAccessibleName("Trainings that wait")
        self.setDragDropMode(QAbstractItemView.DragDropMode.InternalMove)
        self.setDefaultDropAction(Qt.DropAction.MoveAction)
        self.setSpacing(1)
        self.setTextElideMode(Qt.TextElideMode.ElideRight)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        # With the next turn: rows must not be made anew while Qt is still moving one.
        self.model().rowsMoved.connect(lambda *_: QTimer.singleShot(0, self.moved.emit))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Delete takes the chosen one out."""
        if event.key() == Qt.Key.Key_Delete:
            self.removeRequested.emit()
        else:
            super().keyPressEvent(event)


class QueueList(QWidget):
    """Shows what waits; the actions act on the chosen row.

    Args:
        actions: all actions of the window by name.
        parent: as usual.

    Signals:
        chosenChanged: another row is chosen.
        arranged: folders of all rows in the order they were dragged to.
        removeRequested: take the chosen one out.
    """

    chosenChanged = Signal()
    arranged = Signal(object)
    removeRequested = Signal()

    def __init__(self, actions: dict[str, QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = LIGHT
        heading = QLabel("Queue", self)
        font = heading.font()
        font.setBold(True)
        heading.setFont(font)
        self._status = QLabel(self)
        self._status.setAlignment(Qt.AlignmentFlag.AlignRight)
        self._hint = QLabel(_HINT, self)
        self._hint.setWordWrap(True)
        self.rows = _Rows(self)
        self.rows.moved.connect(lambda: self.arranged.emit(self.folders()))
        self.rows.removeRequested.connect(self.removeRequested)
        self.rows.currentRowChanged.connect(lambda _row: self.chosenChanged.emit())
        self._go = tool_button(actions["queue_go"], with_text=True)
        top, buttons = QHBoxLayout(), QHBoxLayout()
        top.addWidget(heading)
        top.addWidget(self._status, 1)
        buttons.setSpacing(2)
        buttons.addWidget(tool_button(actions["queue_add"], with_text=True))
        buttons.addWidget(self._go)
        buttons.addStretch(1)
        # Short, for the buttons; the menus say it in full.
        actions["queue_add"].setIconText("Add")
        for name in ("queue_up", "queue_down", "queue_remove"):
            buttons.addWidget(tool_button(actions[name]))
        layout = QVBoxLayout(self)
        layout.setContentsMargins(8, 6, 8, 8)
        layout.setSpacing(6)
        layout.addLayout(top)
        layout.addWidget(self._hint)
        layout.addWidget(self.rows)
        layout.addLayout(buttons)
        self.set_items([], "")

    def set_items(self, items: Sequence[Waiting], status: str) -> None:
        """Show what waits, and in a few words what is going to happen."""
        chosen = self.chosen()
        self.rows.blockSignals(True)
        self.rows.clear()
        for number, item in enumerate(items, start=1):
            row = QListWidgetItem(f"{number}.  {item.title}\n{item.problem or item.text}", self.rows)
            row.setData(_FOLDER, item.folder)
            row.setToolTip(f"{item.title}\n{item.text}\n{item.problem}".strip())
            row.setSizeHint(QSize(40, 2 * self.fontMetrics().lineSpacing() + 8))
            if item.problem:
                row.setIcon(icon("error", self._theme))
            if item.folder == chosen:
                self.rows.setCurrentItem(row)
        if items and self.rows.currentRow() < 0:
            self.rows.setCurrentRow(0)
        self.rows.blockSignals(False)
        self.rows.setVisible(bool(items))
        self._hint.setVisible(not items)
        self._go.setVisible(bool(items))
        height = 2 * self.fontMetrics().lineSpacing() + 10
        self.rows.setFixedHeight(min(len(items), _MOST_ROWS) * height + 2 * self.rows.frameWidth() + 2)
        self._status.setText(status)
        self.chosenChanged.emit()

    @property
    def status(self) -> str:
        """The words beside the heading."""
        return self._status.text()

    def folders(self) -> list[Path]:
        """Return the folders of the rows, from top to bottom."""
        return [self.rows.item(place).data(_FOLDER) for place in range(self.rows.count())]

    def chosen(self) -> Path | None:
        """Return the folder of the chosen row."""
        item = self.rows.currentItem()
        return None if item is None else item.data(_FOLDER)

    def choose(self, folder: Path) -> None:
        """Choose the row of a folder."""
        if folder in self.folders():
            self.rows.setCurrentRow(self.folders().index(folder))

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        for text in (self._status, self._hint):
            palette = text.palette()
            palette.setColor(QPalette.ColorRole.WindowText, QColor(theme.subtle))
            text.setPalette(palette)
