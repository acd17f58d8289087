"""The timeline by itself."""

from __future__ import annotations

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtGui import QAction
from qtpy.QtWidgets import QMainWindow, QToolButton

from dmp_viewer.step_mark import StepMark
from dmp_viewer.views.timeline import Timeline


@pytest.fixture
def timeline(qtbot: QtBot, window: QMainWindow, named_actions: dict[str, QAction]) -> Timeline:
    timeline = Timeline(named_actions)
    window.setCentralWidget(timeline)
    window.resize(900, 80)
    window.show()
    qtbot.waitExposed(window)
    return timeline


def test_moving_the_handle_names_steps_and_showing_a_step_is_silent(timeline: Timeline) -> None:
    chosen: list[int] = []
    timeline.stepChosen.connect(chosen.append)
    timeline.set_steps([0, 25, 50, 60])
    timeline.set_shown_step(25, 60)
    assert timeline.label == "Step 25 of 60"
    assert chosen == []
    timeline.go(1)
    timeline.go(-1)
    timeline.go_to_end(last=True)
    timeline.go_to_end(last=False)
    assert chosen == [50, 25, 60, 0]


def test_playing_starts_over_at_the_end_and_stops_there(timeline: Timeline, qtbot: QtBot) -> None:
    chosen: list[int] = []
    timeline.stepChosen.connect(chosen.append)
    timeline.set_steps([0, 5, 10])
    timeline.set_shown_step(10, 10)
    with qtbot.waitSignals(
        [timeline.playToggled, timeline.playToggled], timeout=5000, check_params_cbs=[bool, lambda on: not on]
    ):
        timeline.set_playing(True)
    assert chosen == [0, 5, 10]
    assert not timeline.is_playing


def test_there_is_nothing_to_play_with_one_snapshot(timeline: Timeline, qtbot: QtBot) -> None:
    timeline.set_steps([0])
    with qtbot.waitSignal(timeline.playToggled, check_params_cb=lambda on: not on):
        timeline.set_playing(True)
    assert not timeline.is_playing


def test_marks_are_drawn(timeline: Timeline) -> None:
    timeline.set_steps([0, 5, 10])
    before = timeline.slider.grab().toImage()
    timeline.set_marks([StepMark("kept", 5, "kept", "Kept."), StepMark("best", 10, "best", "Best.")], [0])
    assert timeline.slider.grab().toImage() != before


def test_picture_buttons_have_names_and_keys_in_their_tips(timeline: Timeline) -> None:
    for button in timeline.findChildren(QToolButton):
        assert button.accessibleName()
        assert "(" in button.toolTip()
