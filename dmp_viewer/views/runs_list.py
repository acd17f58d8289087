"""The list of runs: a picture, three lines for each, and everything that a keyboard can do in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, TypeAlias

from qtpy.QtCore import (
    QAbstractItemModel,
    QAbstractListModel,
    QItemSelectionModel,
    QModelIndex,
    QPersistentModelIndex,
    QPoint,
    QRect,
    QSize,
    Qt,
    Signal,
)
from qtpy.QtGui import QColor, QFont, QImage, QKeyEvent, QPainter, QPalette, QPen
from qtpy.QtWidgets import (
    QAbstractItemView,
    QLineEdit,
    QListView,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from dmp_viewer.icons import pixmap
from dmp_viewer.runs_entries import RunRow, day_text
from dmp_viewer.runs_pictures import HEIGHT, WIDTH
from dmp_viewer.theme import LIGHT, Theme

ROW = int(Qt.ItemDataRole.UserRole)
# Each state has a sign of its own form, so that nothing hangs on a colour.
_SIGNS = {
    "finished": "success", "stopped": "stop", "interrupted": "warning", "failed": "error", "running": "play",
    "waiting": "clock", "damaged": "error",
}  # fmt: skip
_MARGIN, _GAP, _SIGN = 8, 10, 14
_Index: TypeAlias = QModelIndex | QPersistentModelIndex


class _Model(QAbstractListModel):
    """The rows on show; a name can be edited."""

    renamed = Signal(object, str)

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.rows: list[RunRow] = []

    def set_rows(self, rows: Sequence[RunRow]) -> None:
        if [row.folder for row in rows] == [row.folder for row in self.rows]:
            changed = [place for place, row in enumerate(rows) if row != self.rows[place]]
            self.rows = list(rows)
            for place in changed:
                self.dataChanged.emit(self.index(place), self.index(place))
        else:
            self.beginResetModel()
            self.rows = list(rows)
            self.endResetModel()

    def rowCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(self.rows)

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row = self.rows[index.row()]
        if role in (Qt.ItemDataRole.DisplayRole, Qt.ItemDataRole.EditRole):
            return row.title
        if role == Qt.ItemDataRole.ToolTipRole:
            return row.details
        if role == Qt.ItemDataRole.AccessibleTextRole:
            return ", ".join(row.details.split("\n")[:-1])
        return row if role == ROW else None

    def flags(self, index: _Index) -> Qt.ItemFlag:
        result = Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable
        can_be_renamed = index.isValid() and self.rows[index.row()].can_be_opened
        return result | Qt.ItemFlag.ItemIsEditable if can_be_renamed else result

    def setData(self, index: _Index, value: Any, role: int = Qt.ItemDataRole.EditRole) -> bool:
        row = self.rows[index.row()]
        if role == Qt.ItemDataRole.EditRole and value != row.title:
            self.renamed.emit(row.folder, value)
        return False  # the list says what the run folder says


class _Painter(QStyledItemDelegate):
    """Draws a row in the colours of the theme."""

    def __init__(self, parent: QWidget, picture: Callable[[RunRow], QImage | None]) -> None:
        super().__init__(parent)
        self.theme = LIGHT
        self.shown: Path | None = None
        self._picture = picture

    def sizeHint(self, option: QStyleOptionViewItem, index: _Index) -> QSize:
        return QSize(260, max(HEIGHT, 3 * option.fontMetrics.lineSpacing() + 4) + 2 * _MARGIN)

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: _Index) -> None:
        row: RunRow = index.data(ROW)
        theme, area = self.theme, option.rect
        is_selected = bool(option.state & QStyle.StateFlag.State_Selected)
        has_focus = bool(option.state & QStyle.StateFlag.State_HasFocus)
        painter.save()
        painter.setRenderHints(QPainter.RenderHint.Antialiasing | QPainter.RenderHint.SmoothPixmapTransform)
        if is_selected:
            painter.fillRect(area, QColor(theme.accent))
        elif option.state & QStyle.StateFlag.State_MouseOver:
            painter.fillRect(area, QColor(theme.raised))
        ink = QColor(theme.on_accent if is_selected else theme.text)
        quiet = QColor(theme.on_accent if is_selected else theme.subtle)
        self._draw_picture(painter, row, area)
        lines = self._lines(option)
        bold = QFont(option.font)
        bold.setBold(True)
        day = day_text(row.created, datetime.now().astimezone())
        width = option.fontMetrics.horizontalAdvance(day)
        title = lines[0].adjusted(0, 0, -width - _GAP, 0)
        _write(painter, title, row.title, bold, ink)
        _write(painter, lines[0], day, option.font, quiet, align=Qt.AlignmentFlag.AlignRight)
        _write(painter, lines[1], row.about_text, option.font, quiet)
        ratio = painter.device().devicePixelRatioF()
        top = lines[2].top() + (lines[2].height() - _SIGN) // 2
        painter.drawPixmap(QPoint(lines[2].left(), top), pixmap(_SIGNS[row.state], ink, _SIGN, ratio))
        is_shown = row.folder == self.shown
        _write(painter, lines[2].adjusted(_SIGN + 5, 0, 0, 0), row.state_text, option.font, ink)
        if is_shown:
            painter.fillRect(QRect(area.left(), area.top(), 4, area.height()), ink if is_selected else QColor(theme.accent))
            self._draw_badge(painter, "On show", option, area)
        painter.setPen(QPen(QColor(theme.line), 1))
        painter.drawLine(area.bottomLeft(), area.bottomRight())
        if has_focus:
            painter.setPen(QPen(QColor(theme.on_accent if is_selected else theme.accent), 1.5, Qt.PenStyle.DashLine))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawRect(area.adjusted(2, 2, -3, -3))
        painter.restore()

    def _draw_picture(self, painter: QPainter, row: RunRow, area: QRect) -> None:
        frame = QRect(area.left() + _MARGIN, area.top() + (area.height() - HEIGHT) // 2, WIDTH, HEIGHT)
        painter.setPen(QPen(QColor(self.theme.line), 1))
        painter.setBrush(QColor(self.theme.base))
        painter.drawRoundedRect(frame, 4, 4)
        image = self._picture(row)
        if image is not None:
            painter.drawImage(frame.adjusted(2, 2, -2, -2), image)

    def _draw_badge(self, painter: QPainter, text: str, option: QStyleOptionViewItem, area: QRect) -> None:
        """Write something on the lower edge of the picture."""
        height = option.fontMetrics.height()
        bottom = area.top() + (area.height() + HEIGHT) // 2
        badge = QRect(area.left() + _MARGIN, bottom - height, WIDTH + 1, height + 1)
        painter.fillRect(badge, QColor(self.theme.accent))
        _write(painter, badge, text, option.font, QColor(self.theme.on_accent), align=Qt.AlignmentFlag.AlignHCenter)

    def _lines(self, option: QStyleOptionViewItem) -> list[QRect]:
        height = option.fontMetrics.lineSpacing() + 2
        left = option.rect.left() + _MARGIN + WIDTH + _GAP
        top = option.rect.top() + (option.rect.height() - 3 * height) // 2
        width = option.rect.right() - _MARGIN - left
        return [QRect(left, top + place * height, width, height) for place in range(3)]

    def createEditor(self, parent: QWidget, option: QStyleOptionViewItem, index: _Index) -> QWidget:
        editor = QLineEdit(parent)
        editor.setAccessibleName("Name of the run")
        editor.setMaxLength(120)
        return editor

    def updateEditorGeometry(self, editor: QWidget, option: QStyleOptionViewItem, index: _Index) -> None:
        line = self._lines(option)[0]
        editor.setGeometry(line.adjusted(-4, -4, 0, 4))

    def setModelData(self, editor: QWidget, model: QAbstractItemModel, index: _Index) -> None:
        if isinstance(editor, QLineEdit):
            model.setData(index, editor.text().strip(), Qt.ItemDataRole.EditRole)


class RunsList(QListView):
    """Shows runs; says what is chosen and what a key or a double click wants.

    Args:
        picture: returns the small picture of a row, None while there is none.
        parent: as usual.

    Signals:
        chosenChanged: other rows are selected.
        openRequested: open the chosen run.
        trashRequested: remove the chosen runs.
        renamed: folder of a run, and its new name.
    """

    chosenChanged = Signal()
    openRequested = Signal()
    trashRequested = Signal()
    renamed = Signal(object, str)

    def __init__(self, picture: Callable[[RunRow], QImage | None], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._model = _Model(self)
        self._painter = _Painter(self, picture)
        self.setModel(self._model)
        self.setItemDelegate(self._painter)
        self.setAccessibleName("Runs")
        self.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.setEditTriggers(QAbstractItemView.EditTrigger.EditKeyPressed)
        self.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setUniformItemSizes(True)
        self.setMouseTracking(True)
        self.setResizeMode(QListView.ResizeMode.Adjust)
        self._model.renamed.connect(self.renamed)
        self.doubleClicked.connect(lambda _index: self.openRequested.emit())
        self.selectionModel().selectionChanged.connect(lambda *_: self.chosenChanged.emit())

    def set_rows(self, rows: Sequence[RunRow]) -> None:
        """Show these rows; what was chosen stays chosen where it is still there."""
        chosen, place = {row.folder for row in self.chosen()}, self.verticalScrollBar().value()
        current = self.currentIndex().row()
        self._model.set_rows(rows)
        model = self.selectionModel()
        if chosen and not model.hasSelection():
            for index, row in enumerate(rows):
                if row.folder in chosen:
                    model.setCurrentIndex(self._model.index(index), QItemSelectionModel.SelectionFlag.Select)
            self.verticalScrollBar().setValue(place)
        if rows and current >= 0 and not self.currentIndex().isValid():
            # The keys go on from where they were, without choosing anything.
            beside = self._model.index(min(current, len(rows) - 1))
            model.setCurrentIndex(beside, QItemSelectionModel.SelectionFlag.NoUpdate)
        self.chosenChanged.emit()

    def rows(self) -> list[RunRow]:
        """Return the rows on show."""
        return list(self._model.rows)

    def chosen(self) -> list[RunRow]:
        """Return the selected rows, from top to bottom."""
        return [self._model.rows[place] for place in sorted(index.row() for index in self.selectedIndexes())]

    def choose(self, *folders: Path) -> None:
        """Select the rows of these folders, and bring the first into view."""
        model = self.selectionModel()
        model.clearSelection()
        for place, row in enumerate(self._model.rows):
            if row.folder in folders:
                model.setCurrentIndex(self._model.index(place), QItemSelectionModel.SelectionFlag.Select)

    def rename_chosen(self) -> None:
        """Let the name of the chosen run be typed."""
        (index, *_) = self.selectedIndexes() or (QModelIndex(),)
        if index.isValid() and self._model.flags(index) & Qt.ItemFlag.ItemIsEditable:
            self.setFocus()
            self.scrollTo(index)
            self.edit(index)

    def set_shown(self, folder: Path | None) -> None:
        """Say which run is in the window."""
        if folder != self._painter.shown:
            self._painter.shown = folder
            self.viewport().update()

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._painter.theme = theme
        palette = self.palette()
        palette.setColor(QPalette.ColorRole.Base, QColor(theme.base))
        self.setPalette(palette)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Enter opens, Delete removes; all else as in any list."""
        is_editing = self.state() == QAbstractItemView.State.EditingState
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and not is_editing:
            self.openRequested.emit()
        elif event.key() == Qt.Key.Key_Delete and not is_editing:
            self.trashRequested.emit()
        else:
            super().keyPressEvent(event)


def _write(
    painter: QPainter,
    area: QRect,
    text: str,
    font: QFont,
    color: QColor,
    *,
    align: Qt.AlignmentFlag = Qt.AlignmentFlag.AlignLeft,
) -> None:
    """Write one line, its end left out where there is no room."""
    painter.setFont(font)
    painter.setPen(color)
    shown = painter.fontMetrics().elidedText(text, Qt.TextElideMode.ElideRight, area.width())
    painter.drawText(area, int(align | Qt.AlignmentFlag.AlignVCenter), shown)
