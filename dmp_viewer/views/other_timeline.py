"""A second timeline below the first: the steps of the run that is laid beside the one on show."""

from __future__ import annotations

from collections.abc import Sequence

from qtpy.QtCore import Qt, Signal
from qtpy.QtGui import QAction, QFontMetrics
from qtpy.QtWidgets import QHBoxLayout, QLabel, QWidget

from dmp_viewer.views.buttons import tool_button
from dmp_viewer.views.snapshot_slider import SliderMark, SnapshotSlider


class OtherTimeline(QWidget):
    """There only while two runs are compared.

    Signals:
        stepChosen: the step of the snapshot that the user moved to.
    """

    stepChosen = Signal(int)

    def __init__(self, actions: dict[str, QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._steps: list[int] = []
        self._name = QLabel(self)
        self._label = QLabel(self)
        self._label.setMinimumWidth(self.fontMetrics().horizontalAdvance("Step 00,000 of 00,000"))
        self.slider = SnapshotSlider(self)
        self.slider.setAccessibleName("Shown snapshot of the compared run")
        self.slider.valueChanged.connect(self._on_value_changed)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(8, 0, 8, 2)
        layout.setSpacing(6)
        layout.addWidget(self._name)
        for name in ("other_previous", "other_next"):
            layout.addWidget(tool_button(actions[name]))
        layout.addWidget(self.slider, 1)
        layout.addWidget(self._label)
        layout.addWidget(tool_button(actions["forget_other"]))
        self.hide()

    def set_run(self, name: str, steps: Sequence[int], shown: int | None, marks: Sequence[SliderMark]) -> None:
        """Show the snapshots of a run; none hides the row."""
        self.setVisible(bool(steps))
        self._steps = list(steps)
        if not steps:
            return
        text = f"Compared with {name}"
        self._name.setText(QFontMetrics(self._name.font()).elidedText(text, Qt.TextElideMode.ElideMiddle, 380))
        self._name.setToolTip(text)
        self.slider.blockSignals(True)
        self.slider.setRange(0, max(0, len(self._steps) - 1))
        if shown in self._steps:
            self.slider.setValue(self._steps.index(shown))
        self.slider.blockSignals(False)
        self.slider.set_marks(marks)
        self._label.setText("" if shown is None else f"Step {shown:,} of {self._steps[-1]:,}")
        self.slider.set_text(self._label.text())

    @property
    def label(self) -> str:
        """The text beside the slider."""
        return self._label.text()

    def _on_value_changed(self, index: int) -> None:
        if 0 <= index < len(self._steps):
            self.stepChosen.emit(self._steps[index])
