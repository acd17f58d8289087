"""The list of holes: which there are, which are to be filled, and a click that turns the view to one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from qtpy.QtCore import QAbstractTableModel, QItemSelectionModel, QModelIndex, QPersistentModelIndex, Qt, Signal
from qtpy.QtGui import QColor, QKeyEvent, QPalette
from qtpy.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QPushButton,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTreeView,
    QVBoxLayout,
    QWidget,
)

from dmp_viewer.theme import LIGHT, Theme, box_palette

_COLUMNS = ("Hole", "Edges", "Size", "State")
_FEWEST_ROWS, _MOST_ROWS = 2, 7
_Index: TypeAlias = QModelIndex | QPersistentModelIndex


@dataclass(frozen=True)
class HoleRow:
    """One hole as the list tells it.

    Attributes:
        n_edges: edges of its rim.
        size: its largest extent, with as many digits as are of use, in the unit that the list names.
        is_filled: whether it is to be filled.
        can_be_filled: whether that can be chosen.
        state: one or two words, empty for a hole that is simply filled.
        details: everything about it, in full sentences.
    """

    n_edges: int
    size: str
    is_filled: bool
    can_be_filled: bool
    state: str
    details: str


class _Model(QAbstractTableModel):
    """The rows; a check box in the first column."""

    switched = Signal(int, bool)

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.rows: tuple[HoleRow, ...] = ()
        self.is_locked = False
        self.subtle = QColor(LIGHT.subtle)

    def set_rows(self, rows: Sequence[HoleRow]) -> None:
        if len(rows) != len(self.rows):
            self.beginResetModel()
            self.rows = tuple(rows)
            self.endResetModel()
        elif rows:
            self.rows = tuple(rows)
            self.dataChanged.emit(self.index(0, 0), self.index(len(rows) - 1, len(_COLUMNS) - 1))

    def rowCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(_COLUMNS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation is Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole:
            return _COLUMNS[section]
        return None

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row, column = self.rows[index.row()], index.column()
        texts = (f"{index.row() + 1:,}", f"{row.n_edges:,}", row.size, row.state)
        if role == Qt.ItemDataRole.DisplayRole:
            return texts[column]
        if role == Qt.ItemDataRole.CheckStateRole and column == 0:
            return Qt.CheckState.Checked if row.is_filled else Qt.CheckState.Unchecked
        if role == Qt.ItemDataRole.TextAlignmentRole and column in (1, 2):
            return int(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        if role == Qt.ItemDataRole.ToolTipRole:
            return f"<p>{row.details}</p>"
        if role == Qt.ItemDataRole.ForegroundRole and not row.is_filled:
            return self.subtle
        if role == Qt.ItemDataRole.AccessibleTextRole and column == 0:
            return f"{row.details} {'It is to be filled.' if row.is_filled else ''}"
        return None

    def flags(self, index: _Index) -> Qt.ItemFlag:
        result = Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable
        if index.column() == 0 and self.rows[index.row()].can_be_filled and not self.is_locked:
            result |= Qt.ItemFlag.ItemIsUserCheckable
        return result

    def setData(self, index: _Index, value: Any, role: int = Qt.ItemDataRole.EditRole) -> bool:
        if role != Qt.ItemDataRole.CheckStateRole or index.column() != 0:
            return False
        self.switched.emit(index.row(), Qt.CheckState(value) is Qt.CheckState.Checked)
        return True


class _Boxes(QStyledItemDelegate):
    """Draws check boxes that can be seen in both themes."""

    box_color: QColor | None = None

    def initStyleOption(self, option: QStyleOptionViewItem, index: _Index) -> None:
        super().initStyleOption(option, index)
        if self.box_color is not None:
            option.palette.setColor(QPalette.ColorRole.Base, self.box_color)


class _Table(QTreeView):
    """Space switches the hole of the current row, whichever column has the focus."""

    def keyPressEvent(self, event: QKeyEvent) -> None:
        index = self.currentIndex().siblingAtColumn(0)
        model = self.model()
        if event.key() == Qt.Key.Key_Space and index.isValid() and index.flags() & Qt.ItemFlag.ItemIsUserCheckable:
            on = Qt.CheckState(index.data(Qt.ItemDataRole.CheckStateRole)) is Qt.CheckState.Checked
            state = Qt.CheckState.Unchecked if on else Qt.CheckState.Checked
            model.setData(index, state, Qt.ItemDataRole.CheckStateRole)
            return
        super().keyPressEvent(event)


class HoleList(QWidget):
    """All holes in rows, with a check box each.

    Signals:
        switched: index of a hole and whether it is to be filled.
        allRequested: fill all but outer rims.
        noneRequested: fill none.
        pointed: index of the hole to turn the view to.
    """

    switched = Signal(int, bool)
    allRequested = Signal()
    noneRequested = Signal()
    pointed = Signal(int)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._model = _Model(self)
        self._model.switched.connect(self.switched)
        self._summary = QLabel(self)
        self._summary.setWordWrap(True)
        self.all_button = QPushButton("All", self)
        self.all_button.setToolTip("Fill all holes that can be filled, but no outer rim.")
        self.all_button.clicked.connect(self.allRequested)
        self.none_button = QPushButton("None", self)
        self.none_button.setToolTip("Leave all holes open.")
        self.none_button.clicked.connect(self.noneRequested)
        for button in (self.all_button, self.none_button):
            button.setMaximumWidth(button.fontMetrics().horizontalAdvance("None") + 24)
        head = QHBoxLayout()
        head.setSpacing(6)
        head.addWidget(self._summary, 1)
        head.addWidget(self.all_button)
        head.addWidget(self.none_button)
        self.table = _Table(self)
        self.table.setModel(self._model)
        # One that is held here: table.selectionModel() once gave something without its signals, rarely and late in a long
        # test run.
        self._selection = QItemSelectionModel(self._model, self)
        self.table.setSelectionModel(self._selection)
        self._boxes = _Boxes(self.table)
        self.table.setItemDelegate(self._boxes)
        self.table.setRootIsDecorated(False)
        self.table.setUniformRowHeights(True)
        self.table.setAllColumnsShowFocus(True)
        self.table.setAlternatingRowColors(True)
        self.table.setAccessibleName("Holes")
        self.table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.table.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        header = self.table.header()
        header.setMinimumSectionSize(30)
        header.setSectionsMovable(False)
        metrics = self.fontMetrics()
        for column, widest in enumerate(("0,000", "Edges", "00,000")):
            header.setSectionResizeMode(column, QHeaderView.ResizeMode.Fixed)
            box = 26 if column == 0 else 0
            header.resizeSection(column, metrics.horizontalAdvance(widest) + 16 + box)
        header.setStretchLastSection(True)
        self.table.clicked.connect(self._on_clicked)
        self._selection.currentRowChanged.connect(self._on_row_changed)
        self._details = QLabel(self)
        self._details.setWordWrap(True)
        self._details.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(6)
        layout.addLayout(head)
        layout.addWidget(self.table)
        layout.addWidget(self._details)
        self.set_rows([], "")

    def set_rows(self, rows: Sequence[HoleRow], summary: str) -> None:
        """List holes; the summary stands above them."""
        self._model.set_rows(rows)
        self._summary.setText(summary)
        for widget in (self.table, self.all_button, self.none_button):
            widget.setVisible(bool(rows))
        self._write_details()
        if rows:
            shown = min(max(len(rows), _FEWEST_ROWS), _MOST_ROWS)
            row_height = max(self.table.sizeHintForRow(0), self.fontMetrics().height() + 4)
            self.table.setFixedHeight(self.table.header().sizeHint().height() + shown * row_height + 4)

    def set_locked(self, locked: bool) -> None:
        """Let the choice be as it is, for instance during a training; holes can still be looked at."""
        self._model.is_locked = locked
        self.all_button.setEnabled(not locked)
        self.none_button.setEnabled(not locked)

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._model.subtle = QColor(theme.subtle)
        self._boxes.box_color = box_palette(theme).color(QPalette.ColorRole.Base)
        for label in (self._details, self._summary):
            palette = label.palette()
            palette.setColor(label.foregroundRole(), QColor(theme.subtle))
            label.setPalette(palette)

    @property
    def rows(self) -> tuple[HoleRow, ...]:
        """What is listed."""
        return self._model.rows

    @property
    def summary(self) -> str:
        """The text above the rows."""
        return self._summary.text()

    @property
    def details(self) -> str:
        """What is told about the hole that is looked at."""
        return self._details.text()

    def _on_clicked(self, index: QModelIndex) -> None:
        # Also a second click on the same row turns the view back to it.
        self.pointed.emit(index.row())

    def _on_row_changed(self, index: QModelIndex, _before: QModelIndex) -> None:
        self._write_details()
        if index.isValid() and self.table.hasFocus():
            self.pointed.emit(index.row())

    def _write_details(self) -> None:
        row = self.table.currentIndex().row()
        self._details.setText(self._model.rows[row].details if 0 <= row < len(self._model.rows) else "")
        self._details.setVisible(bool(self._details.text()))
