"""The run panel: settings in, settings out, buttons and state."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt
from qtpy.QtGui import QAction
from qtpy.QtWidgets import QComboBox, QMainWindow, QPushButton, QSpinBox, QToolButton

from dmp.durations import duration
from dmp.settings import SETTING_FIELDS, Settings, choices, settings_for
from dmp_viewer.states import Controls, RunnerState
from dmp_viewer.views.run_panel import RunPanel, Status
from dmp_viewer.views.setting_editors import NumberEditor, label, matters_to


@pytest.fixture
def panel(window: QMainWindow, named_actions: dict[str, QAction]) -> RunPanel:
    panel = RunPanel(named_actions)
    window.setCentralWidget(panel)
    window.resize(320, 700)
    window.show()
    return panel


def test_the_panel_returns_what_it_shows(panel: RunPanel) -> None:
    wanted = settings_for(
        preset="paper", steps=123, snapshot_every=7, seed=2**62, learning_rate=3e-4, hold_out=0.125, laplacian_form="sum"
    )
    panel.set_settings(wanted)
    assert panel.settings() == wanted
    assert panel.problem == ""


def test_every_setting_can_be_reached_or_leaves_no_choice(panel: RunPanel) -> None:
    for name in SETTING_FIELDS:
        if name == "task" or len(choices(name)) == 1:
            continue
        assert panel.editor(name).toolTip()
        assert label(name)[0].isupper()


def test_a_preset_brings_all_its_values_but_not_another_seed_or_device(panel: RunPanel, qtbot: QtBot) -> None:
    panel.set_settings(replace(settings_for(), seed=7, device="cpu", steps=17))
    preset = panel.editor("preset")
    assert isinstance(preset, QComboBox)
    preset.setCurrentIndex(preset.findData("paper"))
    with qtbot.waitSignal(panel.settingsEdited):
        preset.activated.emit(preset.currentIndex())
    assert panel.settings() == settings_for(preset="paper", seed=7, device="cpu")


def test_a_number_out_of_its_range_is_told_in_the_panels_words(panel: RunPanel, qtbot: QtBot) -> None:
    editor = panel.editor("learning_rate")
    assert isinstance(editor, NumberEditor)
    editor.clear()
    qtbot.keyClicks(editor, "500")
    assert panel.problem == "Learning rate is 500, but must be between 1e-08 and 10."
    editor.clear()
    qtbot.keyClicks(editor, "1e-3")
    assert panel.problem == ""
    assert panel.settings().learning_rate == 0.001


def test_changed_values_are_marked_and_can_be_taken_back(panel: RunPanel, qtbot: QtBot) -> None:
    reset = next(button for button in panel.findChildren(QPushButton) if button.text().startswith("Back to"))
    assert not reset.isVisible()
    steps = panel.editor("steps")
    assert isinstance(steps, QSpinBox)
    steps.setValue(77)
    assert reset.isVisible()
    assert "Steps" in reset.toolTip()
    qtbot.mouseClick(reset, Qt.MouseButton.LeftButton)
    assert panel.settings() == settings_for()
    assert not reset.isVisible()


def test_advanced_settings_are_folded_and_belong_to_the_method(panel: RunPanel, qtbot: QtBot) -> None:
    heading = next(button for button in panel.findChildren(QToolButton) if button.text() == "Advanced")
    weight = panel.editor("laplacian_weight")
    assert not weight.isVisible()
    qtbot.mouseClick(heading, Qt.MouseButton.LeftButton)
    assert weight.isVisible()
    for method in choices("method"):
        panel.set_settings(replace(Settings(), method=method))  # type: ignore[arg-type]
        for name, item in SETTING_FIELDS.items():
            if item.metadata["advanced"] and len(choices(name)) != 1:
                assert panel.editor(name).isVisible() == matters_to(name, "denoise", method), (method, name)


def test_nothing_in_the_panel_is_cut(panel: RunPanel, qtbot: QtBot) -> None:
    qtbot.waitExposed(panel)
    for editor in (panel.editor(name) for name in ("preset", "steps", "snapshot_every", "seed", "device")):
        right = editor.mapTo(panel, QPoint(editor.width(), 0)).x()
        assert right <= panel.width()


@pytest.mark.parametrize(
    ("state", "controls", "visible"),
    [
        (RunnerState.IDLE, Controls(start=True), {"start", "pause", "stop"}),
        (RunnerState.RUNNING, Controls(pause=True, stop=True), {"queue_add", "pause", "stop"}),
        (RunnerState.PAUSED, Controls(resume=True, stop=True), {"queue_add", "resume", "stop"}),
        (RunnerState.FINISHED, Controls(start=True, proceed=True), {"start", "proceed"}),
    ],
)
def test_the_buttons_in_sight(panel: RunPanel, state: RunnerState, controls: Controls, visible: set[str]) -> None:
    panel.set_controls(controls, state)
    names = ("start", "queue_add", "pause", "resume", "proceed", "stop")
    assert {name for name in names if panel.button(name).isVisible()} == visible
    # What is set during a training is for the next one, of the same mesh.
    assert panel.editor("steps").isEnabled()
    assert panel.editor("known_vertices").isEnabled() is not state.is_active


@pytest.mark.parametrize(
    ("status", "told"),
    [
        (Status(), "Ready"),
        (Status(RunnerState.PREPARING), "Preparing…"),
        (Status(RunnerState.RUNNING, 30, 100, 5.0, 6.0, "CPU"), "Training"),
        (Status(RunnerState.STOPPING, 30, 100), "Stopping…"),
        (Status(RunnerState.FINISHED, 30, 100, run_state="stopped"), "Stopped"),
        (Status(RunnerState.IDLE, 30, 100, run_state="interrupted"), "Interrupted"),
    ],
)
def test_the_state_is_told(panel: RunPanel, status: Status, told: str) -> None:
    panel.set_status(status)
    assert panel.state_text == told


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.2, "under 1 s"), (7.6, "8 s"), (125, "2 min 05 s"), (3600, "1 h 00 min"), (9000, "2 h 30 min")]
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text
