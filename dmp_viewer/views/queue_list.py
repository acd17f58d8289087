"""The part of the runs' dock that shows which trainings wait, in their order."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

from qtpy.QtCore import QAbstractListModel, QModelIndex, QPersistentModelIndex, QSize, Qt, QTimer, Signal
from qtpy.QtGui import QAction, QColor, QKeyEvent, QPalette
from qtpy.QtWidgets import QAbstractItemView, QHBoxLayout, QLabel, QListView, QVBoxLayout, QWidget

from dmp_viewer.icons import icon
from dmp_viewer.queue_model import Waiting
from dmp_viewer.theme import LIGHT, Theme
from dmp_viewer.views.buttons import tool_button

_HINT = "Nothing waits. Add takes the open mesh with the settings of the run panel."
_MOST_ROWS = 4
_Index: TypeAlias = QModelIndex | QPersistentModelIndex


class _Model(QAbstractListModel):
    """What waits. Values and no item objects, whose ends Python and Qt would have to agree on."""

    moved = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.items: list[Waiting] = []
        self.theme = LIGHT
        self._widget = parent

    def show(self, items: Sequence[Waiting]) -> None:
        self.beginResetModel()
        self.items = list(items)
        self.endResetModel()

    def rowCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(self.items)

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        item = self.items[index.row()]
        if role == Qt.ItemDataRole.DisplayRole:
            return f"{index.row() + 1}.  {item.title}\n{item.problem or item.text}"
        if role == Qt.ItemDataRole.ToolTipRole:
            return f"{item.title}\n{item.text}\n{item.problem}".strip()
        if role == Qt.ItemDataRole.SizeHintRole:
            return QSize(40, 2 * self._widget.fontMetrics().lineSpacing() + 8)
        if role == Qt.ItemDataRole.DecorationRole and item.problem:
            return icon("error", self.theme)
        return None

    def flags(self, index: _Index) -> Qt.ItemFlag:
        if not index.isValid():
            return Qt.ItemFlag.ItemIsDropEnabled
        return Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable | Qt.ItemFlag.ItemIsDragEnabled

    def supportedDropActions(self) -> Qt.DropAction:
        return Qt.DropAction.MoveAction

    def moveRows(self, source: _Index, first: int, count: int, target: _Index, before: int) -> bool:
        """Take rows to another place, as a drag does."""
        if not self.beginMoveRows(source, first, first + count - 1, target, before):
            return False
        taken = self.items[first : first + count]
        del self.items[first : first + count]
        place = before if before <= first else before - count
        self.items[place:place] = taken
        self.endMoveRows()
        # With the next turn: rows must not be made anew while Qt is still moving one.
        QTimer.singleShot(0, self, self.moved.emit)
        return True


class _Rows(QListView):
    """Rows that can be dragged into another order."""

    removeRequested = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setAccessibleName("Trainings that wait")
        self.setDragDropMode(QAbstractItemView.DragDropMode.InternalMove)
        self.setDefaultDropAction(Qt.DropAction.MoveAction)
        self.setSpacing(1)
        self.setTextElideMode(Qt.TextElideMode.ElideRight)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)

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
        self._is_filling = False
        heading = QLabel("Queue", self)
        font = heading.font()
        font.setBold(True)
        heading.setFont(font)
        self._status = QLabel(self)
        self._status.setAlignment(Qt.AlignmentFlag.AlignRight)
        self._hint = QLabel(_HINT, self)
        self._hint.setWordWrap(True)
        self.rows = _Rows(self)
        self._model = _Model(self.rows)
        self.rows.setModel(self._model)
        self._model.moved.connect(lambda: self.arranged.emit(self.folders()))
        self.rows.removeRequested.connect(self.removeRequested)
        self._selection = self.rows.selectionModel()
        self._selection.currentChanged.connect(self._on_current_changed)
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

    def set_items(self, items: Sequence[Waiting], status: str, note: str = "") -> None:
        """Show what waits.

        Args:
            items: the next one first.
            status: in a few words what is going to happen.
            note: why nothing can be changed; empty while it can.
        """
        chosen = self.chosen()
        self._is_filling = True
        self._model.show(items)
        folders = self.folders()
        if chosen in folders:
            self._choose_row(folders.index(chosen))
        elif items and not note:
            self._choose_row(0)
        self._is_filling = False
        self.rows.setEnabled(not note)
        self.rows.setVisible(bool(items))
        self._hint.setText(note or _HINT)
        self._hint.setVisible(bool(note) or not items)
        self._go.setVisible(bool(items) and not note)
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
        return [item.folder for item in self._model.items]

    def chosen(self) -> Path | None:
        """Return the folder of the chosen row."""
        index = self.rows.currentIndex()
        return self._model.items[index.row()].folder if index.isValid() else None

    def choose(self, folder: Path) -> None:
        """Choose the row of a folder."""
        if folder in self.folders():
            self._choose_row(self.folders().index(folder))

    def _on_current_changed(self, *_: object) -> None:
        if not self._is_filling:
            self.chosenChanged.emit()

    def _choose_row(self, row: int) -> None:
        self.rows.setCurrentIndex(self._model.index(row))

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._model.theme = theme
        for text in (self._status, self._hint):
            palette = text.palette()
            palette.setColor(QPalette.ColorRole.WindowText, QColor(theme.subtle))
            text.setPalette(palette)
