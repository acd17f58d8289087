"""Where the next training is done: this computer, or the address of another one."""

from __future__ import annotations

from collections.abc import Sequence

from qtpy.QtCore import Signal
from qtpy.QtWidgets import QComboBox, QSizePolicy, QWidget

HERE = "This computer"
_TIP = (
    "<p>Type the address of a scheduler to train over there, such as <b>tcp://127.0.0.1:8786</b>. Start it on that computer "
    "with <b>dmp serve</b>; the guide tells how to reach it through a tunnel.</p>"
)


class RunPlace(QComboBox):
    """A list of addresses that another one can be typed into.

    Signals:
        placeChanged: the address that was chosen, empty for this computer.
    """

    placeChanged = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setEditable(True)
        self.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        self.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumContentsLength(12)
        self.setMinimumWidth(130)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setAccessibleName("Run on")
        self.setToolTip(_TIP)
        self.addItem(HERE)
        self.currentTextChanged.connect(lambda _text: self.placeChanged.emit(self.address))

    @property
    def address(self) -> str:
        """What was chosen or typed; empty for this computer."""
        text = self.currentText().strip()
        return "" if text.lower() == HERE.lower() else text

    def set_address(self, address: str) -> None:
        """Show an address; empty for this computer."""
        self.setCurrentText(address or HERE)

    def offer(self, addresses: Sequence[str]) -> None:
        """Offer these addresses, and leave what is chosen."""
        chosen = self.currentText()
        self.blockSignals(True)
        self.clear()
        self.addItems([HERE, *addresses])
        self.setCurrentText(chosen or HERE)
        self.blockSignals(False)
