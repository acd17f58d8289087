"""The few dialogs: choosing files, one question before a training is ended, keys, and about."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from qtpy.QtCore import Qt
from qtpy.QtGui import QIcon
from qtpy.QtWidgets import (
    QAbstractItemView,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QHeaderView,
    QLabel,
    QMessageBox,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from dmp_viewer.arguments import version_text
from dmp_viewer.keys import key_text, keys_table


def mesh_filter(suffixes: tuple[str, ...]) -> str:
    """Return the filter of a file dialog for these suffixes, such as (".ply", ".obj")."""
    patterns = " ".join(f"*{suffix} *{suffix.upper()}" for suffix in suffixes)
    return f"Meshes ({patterns});;All files (*)"


def ask_mesh(parent: QWidget, title: str, folder: str, suffixes: tuple[str, ...]) -> Path | None:
    """Let the user choose a mesh file to open."""
    name, _ = QFileDialog.getOpenFileName(parent, title, folder, mesh_filter(suffixes))
    return Path(name) if name else None


def ask_run(parent: QWidget, folder: str) -> Path | None:
    """Let the user choose a run folder."""
    name = QFileDialog.getExistingDirectory(parent, "Open the folder of a run", folder)
    return Path(name) if name else None


def ask_save_mesh(parent: QWidget, title: str, proposal: Path, suffixes: tuple[str, ...]) -> Path | None:
    """Let the user choose where to save a mesh; without a suffix it becomes a PLY file, which keeps everything."""
    filters = ";;".join(f"{suffix[1:].upper()} (*{suffix})" for suffix in suffixes)
    name, chosen = QFileDialog.getSaveFileName(parent, title, str(proposal), filters)
    if not name:
        return None
    path = Path(name)
    return path if path.suffix else path.with_suffix(chosen[chosen.find("*") + 1 : -1] if "*" in chosen else ".ply")


def ask_save_picture(parent: QWidget, proposal: Path) -> Path | None:
    """Let the user choose where to save a picture."""
    name, _ = QFileDialog.getSaveFileName(parent, "Save a picture of the window", str(proposal), "PNG picture (*.png)")
    if not name:
        return None
    path = Path(name)
    return path if path.suffix else path.with_suffix(".png")


def confirm(parent: QWidget, text: str, details: str, accept: str) -> bool:
    """Ask before something that cannot simply be done again; the safe answer is the default."""
    box = QMessageBox(QMessageBox.Icon.Question, "dmp-viewer", text, QMessageBox.StandardButton.NoButton, parent)
    box.setInformativeText(details)
    yes = box.addButton(accept, QMessageBox.ButtonRole.AcceptRole)
    cancel = box.addButton(QMessageBox.StandardButton.Cancel)
    cancel.setIcon(QIcon())
    box.setDefaultButton(cancel)
    box.exec()
    return box.clickedButton() is yes


class KeysDialog(QDialog):
    """All keys in one list; it does not block the window, so that they can be tried while it is open.

    Args:
        parent: the window.
        keys: key of each action, by name.
    """

    def __init__(self, parent: QWidget, keys: Mapping[str, str]) -> None:
        super().__init__(parent)
        self.setWindowTitle("Keys")
        rows = keys_table(keys)
        flip = key_text(keys.get("flip", ""))
        mouse = [
            ("View", "Turn all meshes", "Drag"),
            ("View", "Move", "Shift+drag, or middle button"),
            ("View", "Closer or further away", "Wheel, or right button"),
            ("View", "Pick a vertex", "Click"),
            ("View", "Move the swipe line; the lens follows the mouse", "Drag"),
            ("View", "Type the range of the colours", "Double click on the colours"),
            *([("View", "Show the input for a moment", f"Hold {flip}")] if flip else []),
            ("Timeline", "Why a step is marked", "Rest on its mark"),
            ("Runs", "Open, rename, move to the trash", "Enter, F2, Delete"),
            ("Runs", "What else can be done", "Right click, or Menu key"),
            ("Queue", "Change the order, take out", "Drag, Delete"),
            ("Curve", "Show the nearest snapshot", "Click"),
            ("Curve", "Closer, everything", "Wheel, double click"),
        ]
        table = QTableWidget(len(rows) + len(mouse), 3, self)
        table.setHorizontalHeaderLabels(["Menu", "What", "Key"])
        table.verticalHeader().hide()
        table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        table.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        table.setShowGrid(False)
        table.verticalHeader().setDefaultSectionSize(table.fontMetrics().height() + 8)
        table.setAlternatingRowColors(True)
        table.setAccessibleName("Keys")
        for row, entry in enumerate([*rows, *mouse]):
            for column, text in enumerate(entry):
                table.setItem(row, column, QTableWidgetItem(text))
        header = table.horizontalHeader()
        header.setSectionResizeMode(1, QHeaderView.ResizeMode.Stretch)
        header.setSectionResizeMode(2, QHeaderView.ResizeMode.ResizeToContents)
        buttons = _close_button(self)
        layout = QVBoxLayout(self)
        layout.addWidget(table)
        layout.addWidget(buttons)
        self.resize(560, 620)


class AboutDialog(QDialog):
    """What it is, versions and licence."""

    def __init__(self, parent: QWidget, device: str) -> None:
        super().__init__(parent)
        self.setWindowTitle("About dmp-viewer")
        text = QLabel(
            "<h3>dmp-viewer</h3>"
            "<p>Restores one damaged triangle mesh with nothing but that mesh: a network learns its shape "
            "before it learns its noise, and you choose when to stop.</p>"
            "<p>After Hattori, Yatagawa, Ohtake, Suzuki: <i>Deep Mesh Prior</i>, 2021.</p>"
            f"<p>{version_text().replace(chr(10), '<br>')}<br>{device}</p>"
            "<p>MIT licence.</p>"
        )
        text.setWordWrap(True)
        text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        buttons = _close_button(self)
        layout = QVBoxLayout(self)
        layout.addWidget(text)
        layout.addWidget(buttons)
        self.setMinimumWidth(420)


def _close_button(dialog: QDialog) -> QDialogButtonBox:
    buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close, dialog)
    # The style's own picture is dark in both themes.
    buttons.button(QDialogButtonBox.StandardButton.Close).setIcon(QIcon())
    buttons.rejected.connect(dialog.reject)
    return buttons
