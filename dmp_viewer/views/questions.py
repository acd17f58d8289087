"""Small dialogs that ask for a number or two."""

from __future__ import annotations

from qtpy.QtGui import QDoubleValidator, QIcon
from qtpy.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QFormLayout,
    QInputDialog,
    QLabel,
    QLineEdit,
    QPushButton,
    QVBoxLayout,
    QWidget,
)


class RangeDialog(QDialog):
    """Asks for both ends of the colours.

    Args:
        parent: the window.
        low: lower end now, in ``unit``.
        high: upper end now.
        unit: what both are counted in.
    """

    def __init__(self, parent: QWidget, low: float, high: float, unit: str) -> None:
        super().__init__(parent)
        self.setWindowTitle("Range of the colours")
        self._ends = [QLineEdit(f"{value:.6g}", self) for value in (low, high)]
        self._problem = QLabel(self)
        self._problem.setWordWrap(True)
        self._buttons = QDialogButtonBox(self)
        self._use = QPushButton("Use")
        self._use.setDefault(True)
        # Buttons of Qt's own making would have pictures that are dark in both themes.
        self._buttons.addButton(self._use, QDialogButtonBox.ButtonRole.AcceptRole)
        self._buttons.addButton(QPushButton("Cancel"), QDialogButtonBox.ButtonRole.RejectRole)
        self._buttons.accepted.connect(self.accept)
        self._buttons.rejected.connect(self.reject)
        form = QFormLayout()
        for text, editor in zip(("&From", "&To"), self._ends, strict=True):
            editor.setValidator(QDoubleValidator(editor))
            editor.textChanged.connect(self._check)
            form.addRow(f"{text} ({unit})" if unit else text, editor)
        layout = QVBoxLayout(self)
        layout.addLayout(form)
        layout.addWidget(self._problem)
        layout.addWidget(self._buttons)
        self._check()

    @property
    def ends(self) -> tuple[float, float] | None:
        """What was typed, or None when it is no range."""
        try:
            low, high = (float(editor.text().replace(",", ".")) for editor in self._ends)
        except ValueError:
            return None
        return (low, high) if low < high else None

    def _check(self) -> None:
        possible = self.ends is not None
        self._problem.setText("The range then stays locked." if possible else "Type two numbers, the lower one first.")
        self._use.setEnabled(possible)


def ask_range(parent: QWidget, low: float, high: float, unit: str) -> tuple[float, float] | None:
    """Let the user type the range of the colours; None when nothing is to change."""
    dialog = RangeDialog(parent, low, high, unit)
    return dialog.ends if dialog.exec() else None


def ask_vertex(parent: QWidget, n_vertices: int, proposal: int) -> int | None:
    """Let the user type the number of a vertex; None when none was chosen."""
    text = f"Number of the vertex, 0 to {n_vertices - 1:,}:"
    dialog = QInputDialog(parent)
    dialog.setWindowTitle("Pick a vertex")
    dialog.setLabelText(text)
    dialog.setInputMode(QInputDialog.InputMode.IntInput)
    dialog.setIntRange(0, n_vertices - 1)
    dialog.setIntValue(proposal)
    dialog.setOkButtonText("Pick")
    for button in dialog.findChildren(QPushButton):
        button.setIcon(QIcon())
    return dialog.intValue() if dialog.exec() else None
