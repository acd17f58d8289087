"""Asks for a classical filter and its parameters, to compare the prediction with what it makes of the input."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from qtpy.QtCore import Qt
from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QDoubleSpinBox,
    QFormLayout,
    QLabel,
    QPushButton,
    QSpinBox,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from dmp.filters import FILTERS, Filter, FilterParameter

Value = int | float | str
_MOST = 1_000_000
# The strongest rival with parameters as they come.
_USUAL = "bilateral_normal"


@dataclass(frozen=True)
class FilterWish:
    """What was chosen.

    Attributes:
        name: key of :data:`dmp.filters.FILTERS`.
        parameters: by name; empty when they are to be found.
        is_tuned: whether the parameters are to be found by the ground truth.
    """

    name: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    is_tuned: bool = False


class _Form(QWidget):
    """The parameters of one filter."""

    def __init__(self, chosen: Filter) -> None:
        super().__init__()
        self._editors: dict[str, QSpinBox | QDoubleSpinBox | QComboBox] = {}
        text = QLabel(chosen.description)
        text.setWordWrap(True)
        form = QFormLayout(self)
        form.setContentsMargins(0, 0, 0, 0)
        form.addRow(text)
        for parameter in chosen.parameters:
            editor = _editor(parameter)
            editor.setToolTip(f"<p>{parameter.help}; {parameter.range_text}</p>")
            editor.setAccessibleDescription(parameter.help)
            self._editors[parameter.name] = editor
            form.addRow(parameter.name.replace("_", " ").capitalize(), editor)

    def values(self) -> dict[str, Value]:
        """Return what the editors hold."""
        return {
            name: str(editor.currentText()) if isinstance(editor, QComboBox) else editor.value()
            for name, editor in self._editors.items()
        }

    def set_values(self, values: Mapping[str, Value]) -> None:
        """Show other values."""
        for name, value in values.items():
            editor = self._editors[name]
            if isinstance(editor, QComboBox):
                editor.setCurrentText(str(value))
            else:
                editor.setValue(value)

    def set_enabled(self, enabled: bool) -> None:
        """Let the values be changed, or not."""
        for editor in self._editors.values():
            editor.setEnabled(enabled)


class FilterChoice(QDialog):
    """A list of filters with their parameters.

    Args:
        parent: the window.
        has_truth: whether parameters can be found by a ground truth.
        before: what was chosen last, or None.
    """

    def __init__(self, parent: QWidget, *, has_truth: bool, before: FilterWish | None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Compare with a filter")
        self.filters = QComboBox(self)
        self.filters.setAccessibleName("Filter")
        self._forms = {name: _Form(chosen) for name, chosen in FILTERS.items()}
        self._stack = QStackedWidget(self)
        for name, chosen in FILTERS.items():
            self.filters.addItem(chosen.title, name)
            self._stack.addWidget(self._forms[name])
        self.tune = QCheckBox("&Find the best parameters by the ground truth", self)
        self.tune.setEnabled(has_truth)
        self.tune.setToolTip(
            "<p>Tries many parameters and takes those with the lowest MAD, as published comparisons do. Nobody could for a "
            "scan without ground truth. It takes up to a few minutes.</p>"
            if has_truth
            else "<p>Needs a ground truth with the same faces.</p>"
        )
        self.tune.toggled.connect(self._on_tune_toggled)
        self.filters.currentIndexChanged.connect(self._stack.setCurrentIndex)
        buttons = QDialogButtonBox(self)
        compare = QPushButton("Compare")
        compare.setDefault(True)
        buttons.addButton(compare, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.addButton(QPushButton("Cancel"), QDialogButtonBox.ButtonRole.RejectRole)
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        layout = QVBoxLayout(self)
        layout.addWidget(self.filters)
        layout.addWidget(self._stack)
        layout.addWidget(self.tune)
        layout.addWidget(QLabel("The result is shown in the middle pane.", self))
        layout.addWidget(buttons)
        self.setMinimumWidth(440)
        self.filters.setCurrentIndex(self.filters.findData(_USUAL))
        if before is not None:
            self.filters.setCurrentIndex(self.filters.findData(before.name))
            self._forms[before.name].set_values(before.parameters)
            self.tune.setChecked(before.is_tuned and has_truth)

    @property
    def wish(self) -> FilterWish:
        """What is chosen now."""
        name = str(self.filters.currentData())
        if self.tune.isChecked():
            return FilterWish(name, is_tuned=True)
        return FilterWish(name, self._forms[name].values())

    def _on_tune_toggled(self, on: bool) -> None:
        for form in self._forms.values():
            form.set_enabled(not on)


def ask_filter(parent: QWidget, *, has_truth: bool, before: FilterWish | None) -> FilterWish | None:
    """Let the user choose a filter; None when nothing is to change."""
    dialog = FilterChoice(parent, has_truth=has_truth, before=before)
    return dialog.wish if dialog.exec() else None


def _editor(parameter: FilterParameter) -> QSpinBox | QDoubleSpinBox | QComboBox:
    if parameter.choices:
        box = QComboBox()
        box.addItems(list(parameter.choices))
        box.setCurrentText(str(parameter.default))
        return box
    most = _MOST if math.isinf(parameter.maximum) else parameter.maximum
    if isinstance(parameter.default, int):
        whole = QSpinBox()
        whole.setRange(int(parameter.minimum), int(most))
        whole.setValue(parameter.default)
        whole.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        return whole
    number = QDoubleSpinBox()
    number.setDecimals(3)
    number.setRange(parameter.minimum, most)
    number.setSingleStep(0.05 if most <= 10 else 1.0)
    number.setValue(float(parameter.default))
    number.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    return number
