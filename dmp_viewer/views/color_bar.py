"""The row below the meshes that tells what their colours mean, and lets it be chosen."""

from __future__ import annotations

from typing import Any, cast

from qtpy.QtCore import QEvent, QObject, Qt, Signal
from qtpy.QtGui import QMouseEvent, QStandardItemModel
from qtpy.QtWidgets import QComboBox, QHBoxLayout, QLabel, QSizePolicy, QWidget

from dmp_viewer.colors import QUANTITIES, Quantity
from dmp_viewer.views.gradient import Gradient

_UNITS = {
    "length": {"edges": "in edge lengths", "file": "in file units", "diagonal": "in % of diagonal"},
    "curvature": {"edges": "per edge length", "file": "per file unit", "diagonal": "per % of diagonal"},
}
_NOTES = {
    "plain": "Bare surfaces without colours",
    "normals": "Red: x, green: y, blue: z of the normal; bright along the axis, dark against it",
}


class ColorBar(QWidget):
    """The gradient with the choices that belong to it: what is coloured, over which range, in which unit.

    Signals:
        quantityChosen, rangeChosen, unitChosen: the new value, as in :class:`dmp_viewer.colors.ColorPolicy`.
        limitsWanted: the user wants to type the range.
    """

    quantityChosen = Signal(str)
    rangeChosen = Signal(str)
    unitChosen = Signal(str)
    limitsWanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._quantity = _choice("Colour", [(name, spec.label) for name, spec in QUANTITIES.items()], "What the colours show.")
        self._range = _choice(
            "Range of the colours",
            [("step", "Range: this step"), ("run", "Range: whole run"), ("locked", "Range: locked")],
            "Fit the colours to the shown step, or to all snapshots of the run so that steps can be compared, "
            "or hold them as they are.",
        )
        self._unit = _choice(
            "Unit",
            list(_UNITS["length"].items()),
            "Mean edge lengths of the input, the units of the file, or per cent of the diagonal of the bounding box.",
        )
        for index, spec in enumerate(QUANTITIES.values()):
            needs = f" Needs {spec.needs}." if spec.needs else ""
            self._quantity.setItemData(index, f"<p>{spec.help}{needs}</p>", Qt.ItemDataRole.ToolTipRole)
        self.gradient = Gradient(self)
        self.gradient.installEventFilter(self)
        self._note = QLabel(self)
        self._note.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._note.setWordWrap(True)
        self._note.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(8, 2, 8, 2)
        layout.addWidget(self._quantity)
        layout.addWidget(self.gradient, 1)
        layout.addWidget(self._note, 1)
        layout.addWidget(self._unit)
        layout.addWidget(self._range)
        self.setFixedHeight(self.gradient.sizeHint().height() + 4)
        self._note.hide()
        for box, signal in (
            (self._quantity, self.quantityChosen),
            (self._range, self.rangeChosen),
            (self._unit, self.unitChosen),
        ):
            box.activated.connect(lambda _index, box=box, signal=signal: signal.emit(box.currentData()))

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What is offered to be coloured."""
        return tuple(QUANTITIES)

    def set_policy(self, quantity: Quantity, range_: str, unit: str) -> None:
        """Show the policy that is in force."""
        spec = QUANTITIES[quantity]
        for index in range(self._unit.count()):
            texts = _UNITS.get(spec.kind, _UNITS["length"])
            self._unit.setItemText(index, "in degrees" if spec.kind == "angle" else texts[self._unit.itemData(index)])
        for box, value in ((self._quantity, quantity), (self._range, range_), (self._unit, unit)):
            box.setCurrentIndex(box.findData(value))
        self._quantity.setToolTip(f"<p>What the colours show. {spec.label}: {spec.help}</p>")
        has_values = spec.kind not in ("none", "direction")
        self.gradient.setVisible(has_values)
        self.gradient.set_locked(range_ == "locked")
        self._note.setText(_NOTES.get(quantity, ""))
        self._note.setVisible(not has_values)
        self._range.setEnabled(has_values)
        self._unit.setEnabled(has_values and spec.kind != "angle")

    def set_possible(self, quantities: set[Quantity]) -> None:
        """Offer only what can be shown for the open mesh; the tool tip of the others says what they need."""
        items = cast(QStandardItemModel, self._quantity.model())
        for index, name in enumerate(QUANTITIES):
            items.item(index).setEnabled(name in quantities)

    def is_offered(self, quantity: Quantity) -> bool:
        """Tell whether a quantity can be chosen now."""
        items = cast(QStandardItemModel, self._quantity.model())
        return bool(items.item(self._quantity.findData(quantity)).isEnabled())

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """A double click on the colours asks for the range."""
        if isinstance(event, QMouseEvent) and event.type() == QEvent.Type.MouseButtonDblClick:
            self.limitsWanted.emit()
            return True
        return super().eventFilter(watched, event)


def _choice(name: str, entries: list[tuple[Any, str]], tip: str) -> QComboBox:
    box = QComboBox()
    box.setAccessibleName(name)
    box.setToolTip(f"<p>{tip}</p>")
    box.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    for value, text in entries:
        box.addItem(text, value)
    return box
