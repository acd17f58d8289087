"""Asks which run to compare with: those of the open mesh in a list, any other by its folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QDialog, QDialogButtonBox, QLabel, QListWidget, QListWidgetItem, QPushButton, QVBoxLayout, QWidget

from dmp_viewer.comparing import RunEntry
from dmp_viewer.views import dialogs


class RunChoice(QDialog):
    """A list of runs.

    Args:
        parent: the window.
        runs: to choose from, newest first.
        folder: where to look for others.
    """

    def __init__(self, parent: QWidget, runs: Sequence[RunEntry], folder: Path) -> None:
        super().__init__(parent)
        self.setWindowTitle("Compare with a run")
        self._folder = folder
        self.chosen: Path | None = None
        text = "Runs of this mesh:" if runs else "There is no other run of this mesh among your runs."
        self.list = QListWidget(self)
        self.list.setAccessibleName("Runs of this mesh")
        self.list.setAlternatingRowColors(True)
        for run in runs:
            item = QListWidgetItem(f"{run.name}\n{run.details}", self.list)
            item.setData(Qt.ItemDataRole.UserRole, run.folder)
            item.setToolTip(str(run.folder))
        self.list.setVisible(bool(runs))
        self.list.setCurrentRow(0)
        self.list.itemDoubleClicked.connect(self._on_accepted)
        buttons = QDialogButtonBox(self)
        self.compare = QPushButton("Compare")
        self.compare.setEnabled(bool(runs))
        self.compare.setDefault(bool(runs))
        self.elsewhere = QPushButton("Another folder…")
        buttons.addButton(self.compare, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.addButton(self.elsewhere, QDialogButtonBox.ButtonRole.ActionRole)
        buttons.addButton(QPushButton("Cancel"), QDialogButtonBox.ButtonRole.RejectRole)
        buttons.accepted.connect(self._on_accepted)
        buttons.rejected.connect(self.reject)
        self.elsewhere.clicked.connect(self._on_elsewhere)
        layout = QVBoxLayout(self)
        layout.addWidget(QLabel(text, self))
        layout.addWidget(self.list, 1)
        layout.addWidget(buttons)
        self.resize(560, 340 if runs else 120)

    def _on_accepted(self) -> None:
        item = self.list.currentItem()
        if item is not None:
            self.chosen = item.data(Qt.ItemDataRole.UserRole)
            self.accept()

    def _on_elsewhere(self) -> None:
        path = dialogs.ask_run(self, str(self._folder))
        if path is not None:
            self.chosen = path
            self.accept()


def ask_run_to_compare(parent: QWidget, runs: Sequence[RunEntry], folder: Path) -> Path | None:
    """Let the user choose a run; None when nothing is to change."""
    dialog = RunChoice(parent, runs, folder)
    return dialog.chosen if dialog.exec() else None
