"""One editor for each hyper-parameter, made from its declaration in :mod:`dmp.settings`."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Protocol

from qtpy.QtCore import QLocale, Qt, Signal
from qtpy.QtGui import QDoubleValidator, QValidator, QWheelEvent
from qtpy.QtWidgets import QCheckBox, QComboBox, QLineEdit, QSpinBox, QWidget

from dmp.errors import SettingsError
from dmp.settings import SETTING_FIELDS, Settings, check, choices

# What a person reads instead of the name in the code.
LABELS = {
    "preset": "Preset", "steps": "Steps", "snapshot_every": "Snapshot every", "seed": "Seed", "device": "Device",
    "task": "Task", "log_every": "Log every", "threads": "Threads", "convolution": "Convolution",
    "width_divisor": "Width divisor", "input_channels": "Input channels", "learning_rate": "Learning rate",
    "laplacian_weight": "Laplacian weight λ", "laplacian_form": "Laplacian form", "predict": "Predict",
    "smoothing": "Smoothing", "smoothing_steps": "Smoothing steps", "scaling": "Scaling", "hold_out": "Hold out",
    "average": "Running average", "method": "Method", "noise_level": "Noise level", "noise_tangential": "Tangential noise",
    "normal_weight": "Normal weight", "bilateral_layers": "Bilateral layers", "normal_passes": "Normal passes",
    "vertex_passes": "Vertex passes", "patch_size": "Patch size", "known_vertices": "Known vertices",
    "max_hole_edges": "Largest hole", "rest_movement": "At rest below", "chebyshev_order": "Chebyshev order",
    "gmm_kernels": "GMM kernels", "architecture": "Layers as in", "skip": "Skip connections",
    "laplacian_epsilon": "Laplacian floor",
}  # fmt: skip
PRESET_TEXTS = {"compact": "Compact", "paper": "Paper", "paper-2021-04": "Paper, April 2021", "best": "Best result"}
TASK_TEXTS = {"denoise": "Remove noise", "complete": "Fill holes"}
# What a person reads instead of a value where the value alone says too little.
_VALUE_TEXTS = {
    "convolution": {"gcn": "GCN", "chebyshev": "Chebyshev", "gmm": "GMM (valence)", "gmm-geometric": "GMM (geometric)"},
    "architecture": {"2024-06": "Code of June 2024", "2021-04": "Code of April 2021"},
    "smoothing": {"laplacian": "Laplacian", "spherical": "Sphere", "none": "None"},
}
# Settings of one convolution only.
_CONVOLUTIONS_OF = {"chebyshev_order": ("chebyshev",), "gmm_kernels": ("gmm", "gmm-geometric")}
# Settings that mean something to one task or one method only; the others do not show them.
_TASK_OF = dict.fromkeys(("known_vertices", "max_hole_edges", "rest_movement"), "complete")
_METHOD_OF = {
    **dict.fromkeys(
        (
            "convolution",
            "chebyshev_order",
            "gmm_kernels",
            "architecture",
            "skip",
            "width_divisor",
            "input_channels",
            "laplacian_weight",
            "laplacian_form",
            "laplacian_epsilon",
            "predict",
            "hold_out",
            "average",
        ),
        "prior",
    ),
    **dict.fromkeys(
        (
            "noise_level",
            "noise_tangential",
            "recorruption",
            "normal_weight",
            "bilateral_layers",
            "normal_passes",
            "vertex_passes",
            "patch_size",
        ),
        "recorrupted",
    ),
}
_SUFFIXES = {"snapshot_every": " steps", "log_every": " steps"}
_SPECIAL = {"threads": "automatic", "max_hole_edges": "any"}
_INT_MAX = 2**31 - 1


class Editor(Protocol):
    """What the run panel needs of an editor. ``edited`` is emitted when the user, not the program, changed it."""

    edited: Any

    def value(self) -> Any:
        """Return the value, which may be outside its range."""

    def set_value(self, value: Any) -> None:
        """Show a value without emitting ``edited``."""


class ChoiceEditor(QComboBox):
    """One of a few texts."""

    edited = Signal()

    def __init__(self, options: tuple[tuple[str, str], ...], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        for value, text in options:
            self.addItem(text, value)
        self.activated.connect(lambda _index: self.edited.emit())
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)

    def value(self) -> str:
        """Return the chosen value."""
        return str(self.currentData())

    def set_value(self, value: str) -> None:
        """Choose a value; one that is not offered is added, so that it is not changed in silence."""
        if self.findData(value) < 0:
            self.addItem(value, value)
        self.setCurrentIndex(self.findData(value))

    def offer_only(self, values: tuple[str, ...]) -> None:
        """Grey out all values but these."""
        for row in range(self.count()):
            # The role under which a combo box keeps whether an entry can be chosen: 0 greys it out, None lets it be.
            wanted = None if self.itemData(row) in values else 0
            self.setItemData(row, wanted, Qt.ItemDataRole.UserRole - 1)

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Scroll the panel, not the value, unless the editor is in use."""
        _only_with_focus(self, event, super().wheelEvent)


class SwitchEditor(QCheckBox):
    """Yes or no."""

    edited = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.clicked.connect(lambda _checked: self.edited.emit())

    def value(self) -> bool:
        """Return whether it is on."""
        return bool(self.isChecked())

    def set_value(self, value: bool) -> None:
        """Switch it on or off."""
        self.setChecked(value)


class WholeNumberEditor(QSpinBox):
    """A whole number that fits a spin box."""

    edited = Signal()

    def __init__(self, minimum: int, maximum: int, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setRange(minimum, min(maximum, _INT_MAX))
        self.setGroupSeparatorShown(True)
        self.setStepType(QSpinBox.StepType.AdaptiveDecimalStepType)
        self.setAccelerated(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.valueChanged.connect(lambda _value: self.edited.emit())

    def set_value(self, value: int) -> None:
        """Show a value."""
        self.blockSignals(True)
        self.setValue(value)
        self.blockSignals(False)

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Scroll the panel, not the value, unless the editor is in use."""
        _only_with_focus(self, event, super().wheelEvent)


class NumberEditor(QLineEdit):
    """A number of any size, written as people write it: 0.01, 1e-4, 12345678901."""

    edited = Signal()

    def __init__(self, name: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._name = name
        validator = QDoubleValidator(self)
        validator.setLocale(QLocale.c())
        self.setValidator(validator)
        self.textEdited.connect(lambda _text: self.edited.emit())

    def value(self) -> float | int | str:
        """Return the number, or the text when it is none."""
        text = self.text().strip()
        try:
            return int(text)
        except ValueError:
            pass
        try:
            return float(text)
        except ValueError:
            return text

    def set_value(self, value: float) -> None:
        """Show a value."""
        self.setText(str(value) if isinstance(value, int) else f"{value:g}")

    @property
    def is_acceptable(self) -> bool:
        """Whether the number is within its range."""
        if self.validator().validate(self.text(), 0)[0] != QValidator.State.Acceptable:
            return False
        try:
            check(self._name, self.value())
        except SettingsError:
            return False
        return True


def make_editor(name: str, options: tuple[tuple[str, str], ...] | None = None) -> QWidget:
    """Return the editor that suits the declaration of a setting.

    Args:
        name: field of :class:`dmp.settings.Settings`.
        options: (value, text) pairs where the possible values are not in the declaration, such as devices.
    """
    declared = SETTING_FIELDS[name]
    texts = _VALUE_TEXTS.get(name, {})
    allowed = options or tuple((value, texts.get(value, value)) for value in choices(name))
    editor: QWidget
    if allowed:
        editor = ChoiceEditor(allowed)
    elif isinstance(declared.default, bool):
        editor = SwitchEditor()
    elif isinstance(declared.default, int) and (declared.metadata["maximum"] or _INT_MAX) <= _INT_MAX:
        editor = WholeNumberEditor(int(declared.metadata["minimum"] or 0), int(declared.metadata["maximum"] or _INT_MAX))
        editor.setSuffix(_SUFFIXES.get(name, ""))
        if name in _SPECIAL:
            editor.setSpecialValueText(_SPECIAL[name])
    else:
        editor = NumberEditor(name)
    editor.setToolTip(f"<p>{declared.metadata['help']}</p>")
    editor.setAccessibleName(label(name))
    editor.setAccessibleDescription(declared.metadata["help"])
    editor.setObjectName(f"setting_{name}")
    return editor


def label(name: str) -> str:
    """Return what a setting is called in the panel."""
    return LABELS.get(name, name.replace("_", " ").capitalize())


def advanced_names() -> list[str]:
    """Return the settings that are hidden at first, without those that leave no choice."""
    return [item.name for item in fields(Settings) if item.metadata["advanced"] and len(choices(item.name)) != 1]


def matters_to(name: str, task: str, method: str, convolution: str = "gcn") -> bool:
    """Tell whether a setting means something to a task, a method and a convolution."""
    return (
        _METHOD_OF.get(name, method) == method
        and _TASK_OF.get(name, task) == task
        and convolution in _CONVOLUTIONS_OF.get(name, (convolution,))
    )


def _only_with_focus(widget: QWidget, event: QWheelEvent, handle: Any) -> None:
    if widget.hasFocus():
        handle(event)
    else:
        event.ignore()
