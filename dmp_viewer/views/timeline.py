"""The timeline: which snapshot is shown, and which steps matter."""

from __future__ import annotations

from collections.abc import Sequence

from qtpy.QtCore import Qt, QTimer, Signal
from qtpy.QtGui import QAction
from qtpy.QtWidgets import QComboBox, QHBoxLayout, QLabel, QPushButton, QSizePolicy, QVBoxLayout, QWidget

from dmp_viewer.step_mark import StepMark
from dmp_viewer.theme import LIGHT, Theme
from dmp_viewer.views.buttons import follow_action, tool_button, with_key
from dmp_viewer.views.snapshot_slider import SliderMark, SnapshotSlider
from dmp_viewer.views.thumbnail_strip import ThumbnailStrip

SPEEDS = (1, 2, 5, 10, 20, 50)
_USUAL_SPEED = 5


class Timeline(QWidget):
    """Slider with pictures, keys to step, play, follow and keep.

    Signals:
        stepChosen: the step of the snapshot that the user moved to.
        playToggled: whether playing has begun or ended, by the user or at the last snapshot.
        speedChosen: snapshots per second to play.
    """

    stepChosen = Signal(int)
    playToggled = Signal(bool)
    speedChosen = Signal(int)

    def __init__(self, actions: dict[str, QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._steps: list[int] = []
        self._marks: list[StepMark] = []
        self._bookmarks: list[int] = []
        self._theme = LIGHT
        self.slider = SnapshotSlider(self)
        self.slider.setAccessibleName("Shown snapshot")
        self.slider.valueChanged.connect(self._on_value_changed)
        self.strip = ThumbnailStrip(self.slider.x_of, self)
        self.strip.stepChosen.connect(self.stepChosen)
        self._strip_wanted = True
        self._speed = QComboBox(self)
        for speed in SPEEDS:
            self._speed.addItem(f"{speed} / s", speed)
        self._speed.setCurrentIndex(SPEEDS.index(_USUAL_SPEED))
        self._speed.setAccessibleName("Speed of playing")
        self._speed.setToolTip(
            f"Snapshots per second when playing. The menu Step has {with_key('Play faster', actions['faster'])} "
            f"and {with_key('Play slower', actions['slower'])}."
        )
        self._speed.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self._speed.activated.connect(lambda _index: self.speedChosen.emit(self._speed.currentData()))
        self._label = QLabel("No snapshots yet", self)
        self._label.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Preferred)
        self._label.setMinimumWidth(self.fontMetrics().horizontalAdvance("Step 00,000 of 00,000"))
        self.keep_button = QPushButton(self)
        follow_action(self.keep_button, actions["keep"])
        controls = QHBoxLayout()
        controls.setSpacing(2)
        for name in ("first_step", "previous_step", "play", "next_step", "last_step"):
            controls.addWidget(tool_button(actions[name]))
        controls.addWidget(self._speed)
        controls.addSpacing(12)
        controls.addWidget(self._label)
        controls.addStretch(1)
        for name in ("bookmark", "follow"):
            controls.addWidget(tool_button(actions[name], with_text=True))
        controls.addSpacing(4)
        controls.addWidget(self.keep_button)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(8, 0, 8, 2)
        layout.setSpacing(0)
        layout.addWidget(self.strip)
        layout.addWidget(self.slider)
        layout.addLayout(controls)
        self.strip.hide()
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._advance)

    # -- what is shown ------------------------------------------------------------------------------------------------

    def set_steps(self, steps: Sequence[int]) -> None:
        """Offer other snapshots."""
        self._steps = list(steps)
        self.slider.blockSignals(True)
        self.slider.setRange(0, max(0, len(self._steps) - 1))
        self.slider.setEnabled(len(self._steps) > 1)
        self.slider.blockSignals(False)
        self._show_strip()
        self.strip.set_steps(self._steps)
        self._update_marks()

    def set_shown_step(self, step: int | None, total: int) -> None:
        """Move the handle; the label tells the step and the last one."""
        self.slider.blockSignals(True)
        if step in self._steps:
            self.slider.setValue(self._steps.index(step))
        self.slider.blockSignals(False)
        self.strip.set_shown_step(step)
        self._label.setText("No snapshots yet" if step is None else f"Step {step:,} of {total:,}")
        self.slider.set_text("" if step is None else self._label.text())

    def set_marks(self, marks: Sequence[StepMark], bookmarks: Sequence[int]) -> None:
        """Mark the steps that matter, and those that a person marked."""
        self._marks, self._bookmarks = list(marks), list(bookmarks)
        self._update_marks()

    def set_strip_wanted(self, wanted: bool) -> None:
        """Show small pictures of the snapshots, or not."""
        self._strip_wanted = wanted
        self._show_strip()

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        self.strip.set_theme(theme)
        self._update_marks()

    @property
    def label(self) -> str:
        """The text beside the slider."""
        return self._label.text()

    def _show_strip(self) -> None:
        self.strip.setVisible(self._strip_wanted and len(self._steps) > 1)

    def _update_marks(self) -> None:
        self.slider.set_marks(slider_marks(self._marks, self._bookmarks, self._steps, self._theme))

    # -- moving -------------------------------------------------------------------------------------------------------

    def go(self, places: int) -> None:
        """Move by so many snapshots."""
        self.slider.setValue(self.slider.value() + places)

    def go_to_end(self, last: bool) -> None:
        """Move to the first or the last snapshot."""
        self.slider.setValue(self.slider.maximum() if last else self.slider.minimum())

    @property
    def speed(self) -> int:
        """Snapshots per second when playing."""
        return int(self._speed.currentData())

    def set_speed(self, speed: int) -> None:
        """Play so many snapshots per second, or the nearest speed that is offered."""
        nearest = min(SPEEDS, key=lambda offered: abs(offered - speed))
        self._speed.setCurrentIndex(SPEEDS.index(nearest))
        self._timer.setInterval(round(1000 / nearest))

    def change_speed(self, places: int) -> None:
        """Play faster or slower by so many of the offered speeds."""
        index = min(max(SPEEDS.index(self.speed) + places, 0), len(SPEEDS) - 1)
        self.speedChosen.emit(SPEEDS[index])

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
            self._timer.start(round(1000 / self.speed))
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


def slider_marks(marks: Sequence[StepMark], bookmarks: Sequence[int], steps: Sequence[int], theme: Theme) -> list[SliderMark]:
    """Return what a slider over ``steps`` draws for marks and bookmarks; steps without a snapshot are left out."""
    colors = {
        "kept": theme.kept, "suggested": theme.suggested, "best": theme.best, "held_out": theme.curves["held_out_error"],
        "bookmark": theme.accent, "reference": theme.text,
    }  # fmt: skip
    places = {step: index for index, step in enumerate(steps)}
    flags = [StepMark("bookmark", step, "", f"Bookmark: step {step:,}.") for step in bookmarks]
    return [
        SliderMark(places[mark.step], mark.name, colors[mark.name], mark.sentence)
        for mark in (*marks, *flags)
        if mark.step in places
    ]
