"""The run panel: settings of the next training, its controls and its progress."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from qtpy.QtCore import Qt, Signal
from qtpy.QtGui import QAction, QFont, QFontMetrics
from qtpy.QtWidgets import (
    QComboBox,
    QFormLayout,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from dmp.durations import duration
from dmp.errors import SettingsError
from dmp.settings import DENOISE_TOO, SETTING_FIELDS, Settings, choices, default_preset, presets_for, settings_for
from dmp_viewer.states import Controls, RunnerState
from dmp_viewer.theme import Theme
from dmp_viewer.views.buttons import follow_action
from dmp_viewer.views.collapsible import Collapsible
from dmp_viewer.views.hole_section import HOLE_SETTINGS, HoleSection, is_denoising_too
from dmp_viewer.views.run_place import RunPlace
from dmp_viewer.views.setting_editors import (
    PRESET_TEXTS,
    TASK_TEXTS,
    ChoiceEditor,
    Editor,
    NumberEditor,
    advanced_names,
    label,
    make_editor,
    matters_to,
)

_DEVICE_TEXTS = {"auto": "Automatic", "cpu": "Processor (CPU)"}
_KNOWN_TEXTS = {"keep": "Keep exactly", "predict": "Take the prediction"}
_PLAIN = ("steps", "snapshot_every", "seed", "device")


@dataclass(frozen=True)
class Status:
    """How far the training is.

    Attributes:
        state: what the training is doing.
        step: steps done.
        total: the last step, 0 when nothing has been trained.
        speed: steps per second, 0 while unknown.
        seconds: training time so far.
        device: where it computes.
        run_state: how the run on show ended, as :attr:`dmp.runs.Run.state` tells it, or ``rest`` when it ended early because
            nothing moved any more.
    """

    state: RunnerState = RunnerState.IDLE
    step: int = 0
    total: int = 0
    speed: float = 0.0
    seconds: float = 0.0
    device: str = ""
    run_state: str = ""


class RunPanel(QWidget):
    """Settings, Start, Pause, Resume, Continue, Stop, and how far the training is.

    Signals:
        settingsEdited: the user changed a setting.
        settingsChanged: the settings, whenever they have become others that can be used, whoever changed them.
        taskChosen: the user chose another task.
    """

    settingsEdited = Signal()
    settingsChanged = Signal(object)
    taskChosen = Signal()

    def __init__(
        self,
        actions: dict[str, QAction],
        *,
        tasks: tuple[str, ...] = ("denoise",),
        devices: tuple[tuple[str, str], ...] = (),
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self._actions = actions
        self._task = tasks[0]
        self._editors: dict[str, QWidget] = {}
        self._told: Settings | None = None
        self._preset_before: str | None = None
        self._form_area = QScrollArea(self)
        self._advanced: Collapsible
        self._build_form(tasks, devices)
        self._problem_text = QLabel(self)
        self._problem_text.setWordWrap(True)
        self._problem_text.hide()
        controls = self._build_controls()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self._form_area, 1)
        layout.addWidget(controls)
        content = self._form_area.widget()
        scroll_bar = self._form_area.verticalScrollBar().sizeHint().width()
        self.setMinimumWidth(content.minimumSizeHint().width() + scroll_bar)
        self.set_settings(settings_for(self._task))
        self.set_status(Status())
        self.set_controls(Controls(), RunnerState.IDLE)

    # -- settings -----------------------------------------------------------------------------------------------------

    def settings(self) -> Settings:
        """Return the settings as they stand (raises :class:`dmp.errors.SettingsError` when one is out of its range)."""
        values = {name: cast(Editor, editor).value() for name, editor in self._editors.items()}
        task, preset = values.pop("task", self._task), values.pop("preset")
        return settings_for(task, preset, **values)

    def set_settings(self, settings: Settings) -> None:
        """Show these settings."""
        for name, editor in self._editors.items():
            cast(Editor, editor).set_value(getattr(settings, name))
        self._check()

    def editor(self, name: str) -> QWidget:
        """Return the editor of a setting."""
        return self._editors[name]

    def _on_preset_chosen(self) -> None:
        self._take_preset({"preset": cast(Editor, self._editors["preset"]).value()})

    def _on_task_chosen(self) -> None:
        # Each task has a preset that it opens with; another one was chosen by the user and stays.
        preset = cast(Editor, self._editors["preset"]).value()
        before = self._told.task if self._told is not None else self._task
        stays = preset != default_preset(before) and preset in presets_for(cast(Editor, self._editors["task"]).value())
        self._take_preset({"preset": preset} if stays else {})

    def _take_preset(self, changes: Mapping[str, Any]) -> None:
        # A preset is a whole set of values; keeping single values of the last one would make something in between.
        kept = {name: cast(Editor, self._editors[name]).value() for name in ("seed", "device")}
        task = cast(Editor, self._editors["task"]).value() if "task" in self._editors else self._task
        self.set_settings(settings_for(task, **{**kept, **changes}))
        self.settingsEdited.emit()

    def _on_denoise_too_chosen(self, wanted: bool) -> None:
        if wanted:
            self._preset_before = cast(Editor, self._editors["preset"]).value()
        self._take_preset(DENOISE_TOO if wanted else {"preset": self._preset_before})

    def _on_reset_clicked(self) -> None:
        if self.hole_section.denoise_too.isChecked():
            self._take_preset(DENOISE_TOO)
        else:
            self._on_preset_chosen()

    def _on_edited(self) -> None:
        self._check()
        self.settingsEdited.emit()

    def _check(self) -> None:
        try:
            settings = self.settings()
        except SettingsError as error:
            self._say_problem(_in_panel_words(str(error)))
            self._reset.setVisible(True)
            return
        self._say_problem("")
        for name in _folded_names():
            matters = matters_to(name, settings.task, settings.method, settings.convolution)
            self._advanced_form.setRowVisible(self._editors[name], matters)
        cast(ChoiceEditor, self._editors["preset"]).offer_only(presets_for(settings.task))
        self.hole_section.setVisible(settings.task == "complete")
        self.hole_section.set_settings(settings)
        more = DENOISE_TOO if is_denoising_too(settings) else {"preset": settings.preset}
        preset = settings_for(settings.task, **{"seed": settings.seed, "device": settings.device, **more})
        changed = [name for name in self._editors if getattr(settings, name) != getattr(preset, name)]
        self._reset.setVisible(bool(changed))
        self._reset.setToolTip("Changed: " + ", ".join(label(name) for name in changed))
        for name, text in self._labels.items():
            font = text.font()
            font.setBold(name in changed)
            text.setFont(font)
        if settings != self._told:
            self._told = settings
            self._allow_known_vertices()
            self.settingsChanged.emit(settings)

    def _allow_known_vertices(self) -> None:
        """Offer the choice about known vertices where the method has it."""
        keeps = self._told is not None and self._told.method == "made-up-holes"
        editor = self._editors["known_vertices"]
        editor.setEnabled(self._labels["max_hole_edges"].isEnabled() and not keeps)
        text = SETTING_FIELDS["known_vertices"].metadata["help"]
        editor.setToolTip(f"<p>{_KEEPS_TIP if keeps else text}</p>")

    def _say_problem(self, text: str) -> None:
        self._problem_text.setText(text)
        self._problem_text.setVisible(bool(text))
        for editor in self._editors.values():
            if isinstance(editor, NumberEditor):
                role = editor.foregroundRole()
                palette = self.palette()
                if not editor.is_acceptable:
                    palette.setColor(role, self._problem_text.palette().color(self._problem_text.foregroundRole()))
                editor.setPalette(palette)

    @property
    def problem(self) -> str:
        """What is wrong with the settings, or an empty text."""
        return self._problem_text.text()

    # -- training -----------------------------------------------------------------------------------------------------

    def set_controls(self, controls: Controls, state: RunnerState) -> None:
        """Enable what makes sense; buttons follow their actions, and only those that can ever act now are in sight."""
        # What is set meanwhile is for the next training, which can wait in the queue; mesh and holes stay as they are.
        for name in ("task", *HOLE_SETTINGS):
            for widget in (self._labels.get(name), self._editors.get(name)):
                if widget is not None:
                    widget.setEnabled(not state.is_active)
        self._heading.setText(self._title if not state.is_active else "Next training")
        self.hole_section.set_locked(state.is_active)
        self._allow_known_vertices()
        shows_resume = state is RunnerState.PAUSED
        shows_proceed = controls.proceed
        # What can be continued cannot be stopped; the room is for the step to continue to.
        self._buttons["start"].setVisible(not state.is_active)
        self._buttons["queue_add"].setVisible(state.is_active)
        self._buttons["stop"].setVisible(not shows_proceed or state.is_active)
        self._buttons["resume"].setVisible(shows_resume)
        self._buttons["proceed"].setVisible(shows_proceed and not shows_resume)
        self._buttons["pause"].setVisible(not shows_resume and not shows_proceed)

    def set_status(self, status: Status) -> None:
        """Tell how far the training is."""
        state, step = status.state, status.step
        at_rest = status.run_state == "rest" and not state.is_active
        total = step if at_rest else status.total
        busy = state is RunnerState.PREPARING
        self._bar.setRange(0, 0 if busy else max(1, total))
        if not busy:
            self._bar.setValue(min(step, total))
        self._bar.setVisible(busy or total > 0)
        self._count.setText("" if busy or not total else f"{step:,} steps" if at_rest else f"{step:,} / {total:,}")
        self._state_text.setText(_STATE_TEXTS.get(state) or _RUN_TEXTS.get(status.run_state, "Ready"))
        self._state_text.setToolTip(_REST_TIP if at_rest else "")
        self._details.setText("  ·  ".join(pace_texts(status)))

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._advanced.set_theme(theme)
        self.hole_section.set_theme(theme)
        for widget, color in (
            (self._details, theme.subtle),
            (self._problem_text, "#b42318" if not theme.is_dark else "#ff9b94"),
        ):
            palette = widget.palette()
            palette.setColor(widget.foregroundRole(), color)
            widget.setPalette(palette)

    @property
    def state_text(self) -> str:
        """The line that tells what the training is doing."""
        return self._state_text.text()

    def button(self, name: str) -> QPushButton:
        """Return one of the buttons start, queue_add, pause, resume, proceed, stop."""
        return self._buttons[name]

    # -- building -----------------------------------------------------------------------------------------------------

    def _build_form(self, tasks: tuple[str, ...], devices: tuple[tuple[str, str], ...]) -> None:
        self._labels: dict[str, QLabel] = {}
        content = QWidget()
        self._title = "Training" if len(tasks) > 1 else TASK_TEXTS[tasks[0]]
        self._heading = heading = QLabel(self._title, content)
        font = heading.font()
        font.setBold(True)
        font.setPointSizeF(font.pointSizeF() * 1.15)
        heading.setFont(font)
        form = _form()
        # With a single task there is nothing to choose; a box with one entry would be a dead control.
        if len(tasks) > 1:
            self._add(form, "task", make_editor("task", tuple((task, TASK_TEXTS.get(task, task)) for task in tasks)))
            self._editors["task"].edited.connect(self._on_task_chosen)
            self._editors["task"].edited.connect(self.taskChosen)
        presets = tuple((name, PRESET_TEXTS.get(name, name.capitalize())) for name in choices("preset"))
        self._add(form, "preset", make_editor("preset", presets))
        self._editors["preset"].edited.connect(self._on_preset_chosen)
        hole_form = _form()
        hole_form.setContentsMargins(0, 0, 0, 0)
        for name in HOLE_SETTINGS:
            self._add(hole_form, name, make_editor(name, tuple(_KNOWN_TEXTS.items()) if name == "known_vertices" else None))
        self.hole_section = HoleSection(hole_form)
        self.hole_section.denoiseTooChosen.connect(self._on_denoise_too_chosen)
        device_options = tuple(_DEVICE_TEXTS.items()) + devices
        for name in _PLAIN:
            self._add(form, name, make_editor(name, device_options if name == "device" else None))
        self.place = RunPlace()
        place_label = QLabel("Run on")
        place_label.setToolTip(self.place.toolTip())
        place_label.setBuddy(self.place)
        form.addRow(place_label, self.place)
        advanced = QWidget()
        advanced_form = _form()
        advanced_form.setContentsMargins(0, 0, 0, 0)
        advanced.setLayout(advanced_form)
        self._advanced_form = advanced_form
        for name in _folded_names():
            self._add(advanced_form, name, make_editor(name))
        for name, editor in self._editors.items():
            if name not in ("task", "preset"):
                editor.edited.connect(self._on_edited)
        self._advanced = Collapsible("Advanced", advanced)
        self._reset = QPushButton("Back to the preset's values")
        self._reset.clicked.connect(self._on_reset_clicked)
        self._align_labels()
        layout = QVBoxLayout(content)
        layout.setContentsMargins(12, 10, 12, 8)
        layout.setSpacing(8)
        layout.addWidget(heading)
        layout.addLayout(form)
        layout.addWidget(self.hole_section)
        layout.addWidget(self._advanced)
        layout.addWidget(self._reset)
        layout.addStretch(1)
        self._form_area.setWidget(content)
        self._form_area.setWidgetResizable(True)
        self._form_area.setFrameShape(QFrame.Shape.NoFrame)
        self._form_area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)

    def _add(self, form: QFormLayout, name: str, editor: QWidget) -> None:
        self._editors[name] = editor
        editor.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        text = QLabel(label(name))
        text.setToolTip(editor.toolTip())
        text.setBuddy(editor)
        self._labels[name] = text
        if isinstance(editor, QComboBox):
            # Otherwise the longest entry, such as the name of a GPU, sets the width of the panel.
            editor.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
            editor.setMinimumContentsLength(12)
        editor.setMinimumWidth(130)
        form.addRow(text, editor)

    def _align_labels(self) -> None:
        """Give all labels the width of the longest in bold, so that nothing moves when one becomes bold."""
        bold = QFont(self.font())
        bold.setBold(True)
        width = max(QFontMetrics(bold).horizontalAdvance(text.text()) for text in self._labels.values()) + 2
        for text in self._labels.values():
            text.setFixedWidth(width)

    def _build_controls(self) -> QWidget:
        frame = QWidget(self)
        self._buttons: dict[str, QPushButton] = {}
        for name in ("start", "queue_add", "pause", "resume", "proceed", "stop"):
            button = QPushButton(frame)
            button.setObjectName(f"button_{name}")
            follow_action(button, self._actions[name])
            self._buttons[name] = button
        for name in ("start", "queue_add"):
            self._buttons[name].setMinimumHeight(36)
        self._buttons["start"].setDefault(True)
        row = QHBoxLayout()
        row.setSpacing(8)
        for name in ("pause", "resume", "proceed", "stop"):
            row.addWidget(self._buttons[name], 1)
        self._state_text = QLabel(frame)
        self._count = QLabel(frame)
        self._count.setAlignment(Qt.AlignmentFlag.AlignRight)
        self._bar = QProgressBar(frame)
        self._bar.setTextVisible(False)
        self._bar.setFixedHeight(8)
        self._bar.setAccessibleName("Progress of the training")
        keep_room = self._bar.sizePolicy()
        keep_room.setRetainSizeWhenHidden(True)
        self._bar.setSizePolicy(keep_room)
        self._details = QLabel(frame)
        self._details.setWordWrap(True)
        self._details.setMinimumHeight(self._details.fontMetrics().height())
        progress = QGridLayout()
        progress.setVerticalSpacing(4)
        progress.addWidget(self._state_text, 0, 0)
        progress.addWidget(self._count, 0, 1)
        progress.addWidget(self._bar, 1, 0, 1, 2)
        progress.addWidget(self._details, 2, 0, 1, 2)
        line = QFrame(frame)
        line.setFrameShape(QFrame.Shape.HLine)
        line.setForegroundRole(line.palette().ColorRole.Mid)
        layout = QVBoxLayout(frame)
        layout.setContentsMargins(12, 0, 12, 12)
        layout.setSpacing(8)
        layout.addWidget(line)
        layout.addWidget(self._problem_text)
        layout.addWidget(self._buttons["start"])
        layout.addWidget(self._buttons["queue_add"])
        layout.addLayout(row)
        layout.addLayout(progress)
        return frame


_STATE_TEXTS = {
    RunnerState.PREPARING: "Preparing…",
    RunnerState.RUNNING: "Training",
    RunnerState.PAUSED: "Paused",
    RunnerState.STOPPING: "Stopping…",
    RunnerState.FAILED: "Failed",
}
_RUN_TEXTS = {"finished": "Finished", "stopped": "Stopped", "interrupted": "Interrupted", "failed": "Failed", "rest": "At rest"}


def pace_texts(status: Status) -> list[str]:
    """Return how fast the training is, how long it takes yet or has taken, and where it computes."""
    texts = []
    if status.state is RunnerState.RUNNING and status.speed > 0:
        texts.append(f"{status.speed:.1f} steps/s" if status.speed < 100 else f"{status.speed:.0f} steps/s")
        texts.append(f"{duration((status.total - status.step) / status.speed)} left")
    elif status.total and status.seconds > 0:
        texts.append(f"{duration(status.seconds)} of training")
    return [*texts, status.device] if status.device else texts


def progress_text(status: Status, memory: str) -> str:
    """Return the progress of a training in one line, for the status bar; empty while nothing is trained."""
    if not status.state.is_active:
        return ""
    what = _STATE_TEXTS[status.state]
    steps = f" {status.step:,} of {status.total:,}" if status.total and status.state is not RunnerState.PREPARING else ""
    return "  ·  ".join([what + steps, *pace_texts(status), *([memory] if memory else [])])


_KEEPS_TIP = "Completion by made-up holes leaves known vertices where they are. Other presets can predict them."
_REST_TIP = "The inserted vertices hardly moved any more, so the training ended before its last step."


def _form() -> QFormLayout:
    form = QFormLayout()
    form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
    form.setLabelAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
    form.setHorizontalSpacing(12)
    form.setVerticalSpacing(6)
    return form


def _folded_names() -> list[str]:
    """Return the settings under "Advanced"."""
    return [name for name in advanced_names() if name not in HOLE_SETTINGS]


def _in_panel_words(text: str) -> str:
    """Return a message about a command line option with the name that the panel uses."""
    if text.startswith("--"):
        option, _, rest = text.partition(" ")
        return f"{label(option[2:].replace('-', '_'))} {rest}"
    return text


def available_devices() -> tuple[tuple[str, str], ...]:
    """Return the GPUs that can be chosen, as (setting, text)."""
    import torch

    if not torch.cuda.is_available():
        return ()
    return tuple(
        (f"cuda:{index}", f"GPU {index}: {torch.cuda.get_device_name(index)}") for index in range(torch.cuda.device_count())
    )
