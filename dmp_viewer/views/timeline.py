"""The timeline: which snapshot is shown, and which one is kept."""

from __future__ import annotations

from collections.abc import Sequence

from qtpy.QtCore import QPointF, Qt, QTimer, Signal
from qtpy.QtGui import QAction, QColor, QPainter, QPaintEvent, QPolygonF
from qtpy.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSizePolicy,
    QSlider,
    QStyle,
    QStyleOptionSlider,
    QWidget,
)

from dmp_viewer.theme import LIGHT, Theme
from dmp_viewer.views.buttons import follow_action, tool_button

_PLAY_INTERVAL_MS = 200


class SnapshotSlider(QSlider):
    """A slider over the snapshots with marks for the kept, the suggested and the best one."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self._marks: list[tuple[int, QColor, bool]] = []
        self.setTracking(True)
        self.setPageStep(5)
        self.setMinimumHeight(30)

    def set_marks(self, marks: list[tuple[int, QColor, bool]]) -> None:
        """Mark positions: (index of the snapshot, colour, whether filled)."""
        self._marks = marks
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the slider and small triangles below the marked snapshots."""
        super().paintEvent(event)
        if self.maximum() <= self.minimum():
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for index, color, filled in self._marks:
            x, bottom = self._x_of(index), self.height() - 1.0
            painter.setPen(color)
            painter.setBrush(color if filled else QColor(0, 0, 0, 0))
            painter.drawPolygon(QPolygonF([QPointF(x, bottom - 6), QPointF(x - 4, bottom), QPointF(x + 4, bottom)]))
        painter.end()

    def _x_of(self, index: int) -> float:
        option = QStyleOptionSlider()
        self.initStyleOption(option)
        length = self.style().pixelMetric(QStyle.PixelMetric.PM_SliderLength, option, self)
        span = self.width() - length
        share = (index - self.minimum()) / (self.maximum() - self.minimum())
        return length / 2 + share * span


class Timeline(QWidget):
    """Slider, keys to step, play, follow and keep.

    Signals:
        stepChosen: the step of the snapshot that the user moved to.
        playToggled: whether playing has begun or ended, by the user or at the last snapshot.
    """

    stepChosen = Signal(int)
    playToggled = Signal(bool)

    def __init__(self, actions: dict[str, QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._steps: list[int] = []
        self._marks: dict[str, int | None] = {"kept": None, "suggested": None, "best": None}
        self._theme = LIGHT
        self.slider = SnapshotSlider(self)
        self.slider.setAccessibleName("Shown snapshot")
        self.slider.valueChanged.connect(self._on_value_changed)
        self._label = QLabel("No snapshots yet", self)
        self._label.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self._label.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Preferred)
        self._label.setMinimumWidth(self.fontMetrics().horizontalAdvance("Step 00,000 of 00,000"))
        layout = QHBoxLayout(self)
        layout.setContentsMargins(8, 2, 8, 2)
        layout.setSpacing(2)
        for name in ("first_step", "previous_step", "play", "next_step", "last_step"):
            layout.addWidget(tool_button(actions[name]))
        layout.addSpacing(6)
        layout.addWidget(self.slider, 1)
        layout.addSpacing(6)
        layout.addWidget(self._label)
        layout.addSpacing(10)
        follow = tool_button(actions["follow"], with_text=True)
        layout.addWidget(follow)
        layout.addSpacing(4)
        self.keep_button = QPushButton(self)
        follow_action(self.keep_button, actions["keep"])
        layout.addWidget(self.keep_button)
        self._timer = QTimer(self)
        self._timer.setInterval(_PLAY_INTERVAL_MS)
        self._timer.timeout.connect(self._advance)

    # -- what is shown ------------------------------------------------------------------------------------------------

    def set_steps(self, steps: Sequence[int]) -> None:
        """Offer other snapshots."""
        self._steps = list(steps)
        self.slider.blockSignals(True)
        self.slider.setRange(0, max(0, len(self._steps) - 1))
        self.slider.setEnabled(len(self._steps) > 1)
        self.slider.blockSignals(False)
        self._update_marks()

    def set_shown_step(self, step: int | None, total: int) -> None:
        """Move the handle; the label tells the step and the last one."""
        self.slider.blockSignals(True)
        if step in self._steps:
            self.slider.setValue(self._steps.index(step))
        self.slider.blockSignals(False)
        self._label.setText("No snapshots yet" if step is None else f"Step {step:,} of {total:,}")
        self.slider.setToolTip("" if step is None else self._label.text())

    def set_markers(self, kept: int | None, suggested: int | None, best: int | None) -> None:
        """Mark the kept, the suggested and the best snapshot."""
        self._marks = {"kept": kept, "suggested": suggested, "best": best}
        self._update_marks()

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        self._update_marks()

    @property
    def label(self) -> str:
        """The text beside the slider."""
        return self._label.text()

    def _update_marks(self) -> None:
        colors = {"suggested": self._theme.suggested, "best": self._theme.best, "kept": self._theme.kept}
        self.slider.set_marks(
            [
                (self._steps.index(step), QColor(color), name == "kept")
                for name, color in colors.items()
                if (step := self._marks[name]) is not None and step in self._steps
            ]
        )

    # -- moving -------------------------------------------------------------------------------------------------------

    def go(self, places: int) -> None:
        """Move by so many snapshots."""
        self.slider.setValue(self.slider.value() + places)

    def go_to_end(self, last: bool) -> None:
        """Move to the first or the last snapshot."""
        self.slider.setValue(self.slider.maximum() if last else self.slider.minimum())

    @property
    def is_playing(self) -> bool:
        """Whether the snapshots are being played."""
        return self._timer.isActive()

    def set_playing(self, playing: bool) -> None:
        """Play the snapshots one after the other, from the beginning when the last one is shown."""
        if playing == self.is_playing:
            return
        if playing and len(self._steps) < 2:
            self.playToggled.emit(False)
            return
        if playing:
            if self.slider.value() == self.slider.maximum():
                self.slider.setValue(self.slider.minimum())
            self._timer.start()
        else:
            self._timer.stop()
        self.playToggled.emit(playing)

    def _advance(self) -> None:
        self.go(1)
        if self.slider.value() >= self.slider.maximum():
            self.set_playing(False)

    def _on_value_changed(self, index: int) -> None:
        if 0 <= index < len(self._steps):
            self.stepChosen.emit(self._steps[index])
