"""The mesh report: what is odd about the open mesh, what that means for the result, and what can be mended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qtpy.QtCore import Qt, Signal
from qtpy.QtGui import QCloseEvent, QFont
from qtpy.QtWidgets import (
    QCheckBox,
    QDialog,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from dmp_viewer.icons import pixmap
from dmp_viewer.theme import LIGHT, Theme

_WIDTH, _HEIGHT = 620, 560
NOTHING_ODD = "There is nothing odd about this mesh."


@dataclass(frozen=True)
class ReportRow:
    """One finding as it is shown.

    Attributes:
        is_warning: whether it harms the result.
        text: what was found, one sentence.
        meaning: what it means, one or two sentences.
        remedy: what repair does about it; empty when it does nothing.
        is_mended: whether repair does so without being asked to.
        can_be_shown: whether there are places to mark on the mesh.
    """

    is_warning: bool
    text: str
    meaning: str
    remedy: str
    is_mended: bool
    can_be_shown: bool


@dataclass(frozen=True)
class RepairChoice:
    """One thing that repair does only when it is asked to: its name, and the text of its box."""

    name: str
    text: str


class MeshReportDialog(QDialog):
    """Lists findings, marks them on the mesh, and asks for a repair. It does not block the window.

    Signals:
        shownChanged: index of the finding to mark on the mesh, -1 for none.
        repairRequested: names of the choices that are ticked, a tuple.
        backRequested: show the mesh as it was before the repair.
        saveRequested: save the mesh that is described.
    """

    shownChanged = Signal(int)
    repairRequested = Signal(object)
    backRequested = Signal()
    saveRequested = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle("Mesh report")
        self.resize(_WIDTH, _HEIGHT)
        self._theme = LIGHT
        self._rows: tuple[ReportRow, ...] = ()
        self._can_repair = False
        self._empty = NOTHING_ODD
        self._empty_label: QLabel | None = None
        self._heading = QLabel(self)
        self._heading.setTextFormat(Qt.TextFormat.PlainText)
        font = QFont(self._heading.font())
        font.setBold(True)
        font.setPointSizeF(font.pointSizeF() * 1.15)
        self._heading.setFont(font)
        self._heading.setWordWrap(True)
        self._signs: list[QLabel] = []
        self._quiet: list[QLabel] = []
        self.show_buttons: list[QPushButton] = []
        self.choices: dict[str, QCheckBox] = {}
        self._list = QScrollArea(self)
        self._list.setWidgetResizable(True)
        self._list.setFrameShape(QFrame.Shape.NoFrame)
        self._list.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._choice_area = QVBoxLayout()
        self._note = QLabel("The repaired mesh becomes a new input. The file stays as it is.", self)
        self._note.setWordWrap(True)
        self.repair_button = QPushButton("&Repair", self)
        self.repair_button.clicked.connect(lambda: self.repairRequested.emit(self.chosen()))
        self.back_button = QPushButton("&Back to the original", self)
        self.back_button.clicked.connect(self.backRequested)
        self.save_button = QPushButton("&Save this mesh…", self)
        self.save_button.clicked.connect(self.saveRequested)
        self.close_button = QPushButton("Close", self)
        self.close_button.clicked.connect(self.close)
        for button in (self.repair_button, self.back_button, self.save_button, self.close_button):
            button.setAutoDefault(False)
        buttons = QHBoxLayout()
        for button in (self.repair_button, self.back_button, self.save_button):
            buttons.addWidget(button)
        buttons.addStretch(1)
        buttons.addWidget(self.close_button)
        layout = QVBoxLayout(self)
        layout.setSpacing(10)
        layout.addWidget(self._heading)
        layout.addWidget(self._list, 1)
        layout.addLayout(self._choice_area)
        layout.addWidget(self._note)
        layout.addLayout(buttons)
        self.set_report("", (), (), can_go_back=False, can_save=False)

    def set_report(
        self, heading: str, rows: Sequence[ReportRow], choices: Sequence[RepairChoice], *, can_go_back: bool, can_save: bool
    ) -> None:
        """Describe another mesh.

        Args:
            heading: which mesh it is, and how it is, one line.
            rows: the findings.
            choices: what repair can do on request; those that were ticked before stay so.
            can_go_back: whether it is a repaired mesh whose original is still there.
            can_save: whether it is a mesh that no file holds.
        """
        self._heading.setText(heading)
        self._rows = tuple(rows)
        self._can_repair = any(row.is_mended for row in rows)
        self._fill_list()
        ticked = {name for name, box in self.choices.items() if box.isChecked()}
        while self._choice_area.count():
            item = self._choice_area.takeAt(0)
            if item is not None and (widget := item.widget()) is not None:
                widget.deleteLater()
        self.choices = {}
        for choice in choices:
            box = QCheckBox(choice.text, self)
            box.setChecked(choice.name in ticked)
            box.toggled.connect(self._update_buttons)
            self._choice_area.addWidget(box)
            self.choices[choice.name] = box
        self.back_button.setVisible(can_go_back)
        self.save_button.setVisible(can_save)
        self._update_buttons()
        self.set_theme(self._theme)

    def set_empty(self, text: str) -> None:
        """Say this where nothing is listed."""
        self._empty = text
        if not self._rows and self._empty_label is not None:
            self._empty_label.setText(text)

    @property
    def empty_text(self) -> str:
        """What is said where nothing is listed; empty beside a list."""
        return self._empty if not self._rows else ""

    def chosen(self) -> tuple[str, ...]:
        """Return the names of the choices that are ticked."""
        return tuple(name for name, box in self.choices.items() if box.isChecked())

    @property
    def texts(self) -> list[str]:
        """The sentences of the findings, as listed."""
        return [row.text for row in self._rows]

    @property
    def heading(self) -> str:
        """What stands above the findings."""
        return self._heading.text()

    def set_busy(self, busy: bool) -> None:
        """Accept no second repair while one is being done."""
        self.repair_button.setText("Repairing…" if busy else "&Repair")
        self.repair_button.setEnabled(not busy)
        if not busy:
            self._update_buttons()

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        for sign, row in zip(self._signs, self._rows, strict=False):
            ink = theme.text if row.is_warning else theme.subtle
            sign.setPixmap(pixmap("warning" if row.is_warning else "info", ink, 18, 2.0))
        for label in (*self._quiet, self._note):
            palette = label.palette()
            palette.setColor(label.foregroundRole(), theme.subtle)
            label.setPalette(palette)

    def closeEvent(self, event: QCloseEvent) -> None:
        """Take the marks away with the report."""
        self._show_none()
        super().closeEvent(event)

    def reject(self) -> None:
        """Close on Escape, too."""
        self._show_none()
        super().reject()

    def _fill_list(self) -> None:
        self._signs, self._quiet, self.show_buttons = [], [], []
        content = QWidget()
        grid = QGridLayout(content)
        grid.setContentsMargins(0, 0, 8, 0)
        grid.setHorizontalSpacing(10)
        grid.setVerticalSpacing(2)
        grid.setColumnStretch(1, 1)
        for index, row in enumerate(self._rows):
            top = 4 * index
            sign = QLabel(content)
            sign.setAccessibleName("Warning" if row.is_warning else "Note")
            self._signs.append(sign)
            grid.addWidget(sign, top, 0, Qt.AlignmentFlag.AlignTop)
            grid.addWidget(_text(row.text, content, bold=True), top, 1)
            meaning = _text(" ".join(part for part in (row.meaning, row.remedy) if part), content)
            self._quiet.append(meaning)
            grid.addWidget(meaning, top + 1, 1, 1, 2)
            button = QPushButton("Show", content)
            button.setCheckable(True)
            button.setAutoDefault(False)
            button.setVisible(row.can_be_shown)
            button.setToolTip("Mark the places on the input mesh")
            button.setAccessibleName(f"Show: {row.text}")
            button.toggled.connect(lambda on, index=index: self._on_show_toggled(index, on))
            button.setMinimumWidth(button.sizeHint().width())
            self.show_buttons.append(button)
            grid.addWidget(button, top, 2, Qt.AlignmentFlag.AlignTop)
            grid.setRowMinimumHeight(top + 2, 12)
        if not self._rows:
            self._empty_label = _text(self._empty, content)
            grid.addWidget(self._empty_label, 0, 1)
        grid.setRowStretch(4 * len(self._rows) + 1, 1)
        self._list.setWidget(content)

    def _on_show_toggled(self, index: int, on: bool) -> None:
        # A checked button hardly looks different in all themes; its word does.
        self.show_buttons[index].setText("Hide" if on else "Show")
        for other, button in enumerate(self.show_buttons):
            if on and other != index and button.isChecked():
                button.blockSignals(True)
                button.setChecked(False)
                button.blockSignals(False)
                button.setText("Show")
        self.shownChanged.emit(index if on else -1)

    def _show_none(self) -> None:
        for button in self.show_buttons:
            button.setChecked(False)

    def _update_buttons(self) -> None:
        self.repair_button.setEnabled(self._can_repair or bool(self.chosen()))
        self._note.setVisible(self.repair_button.isEnabled())


def _text(text: str, parent: QWidget, *, bold: bool = False) -> QLabel:
    label = QLabel(text, parent)
    label.setTextFormat(Qt.TextFormat.PlainText)
    label.setWordWrap(True)
    label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    if bold:
        font = QFont(label.font())
        font.setBold(True)
        label.setFont(font)
    return label
