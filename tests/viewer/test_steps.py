"""Going from step to step in the real window: by keys, the timeline and the curve."""

from __future__ import annotations

from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt

from dmp_viewer.controller import Controller
from dmp_viewer.model import Source
from dmp_viewer.views.mesh_panes import PREDICTED
from tests.viewer.conftest import FakeRun
from tests.viewer.driving import show_fake, trigger


def test_keys_step_through_the_snapshots(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> None:
    show_fake(viewer, trained_run)
    with qtbot.waitActive(viewer.window):
        viewer.window.activateWindow()
    viewer.window.panes.interactor.setFocus()
    shown = []
    for key in (Qt.Key.Key_Home, Qt.Key.Key_Right, Qt.Key.Key_Right, Qt.Key.Key_Left, Qt.Key.Key_End):
        qtbot.keyClick(viewer.window.panes.interactor, key)
        viewer.presenter.flush()
        shown.append(viewer.workspace.shown_step)
    assert shown == [0, 10, 20, 10, 40]
    qtbot.keyClick(viewer.window.panes.interactor, Qt.Key.Key_K)
    assert viewer.workspace.kept_step == 40
    qtbot.keyClick(viewer.window.panes.interactor, Qt.Key.Key_Q)
    qtbot.keyClick(viewer.window.panes.interactor, Qt.Key.Key_W)
    assert viewer.window.isVisible()


def test_space_presses_the_button_that_has_the_focus(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> None:
    show_fake(viewer, trained_run)
    viewer.window.activateWindow()
    button = viewer.window.timeline.keep_button
    button.setFocus()
    qtbot.keyClick(button, Qt.Key.Key_Space)
    assert viewer.workspace.kept_step == 40
    assert not viewer.window.timeline.is_playing


def test_following_ends_with_a_look_back_and_begins_again_at_a_click(viewer: Controller, trained_run: FakeRun) -> None:
    show_fake(viewer, trained_run)
    assert viewer.window.named_actions["follow"].isChecked()
    trigger(viewer, "first_step")
    assert not viewer.window.named_actions["follow"].isChecked()
    trigger(viewer, "follow")
    assert viewer.workspace.shown_step == 40
    assert viewer.window.named_actions["follow"].isChecked()


def test_a_click_on_the_curve_shows_the_nearest_snapshot(viewer: Controller, trained_run: FakeRun) -> None:
    show_fake(viewer, trained_run)
    viewer.window.curve.stepClicked.emit(12.3)
    viewer.presenter.flush()
    assert viewer.window.panes.titles[PREDICTED].texts[0] == "Predicted @ step 10"
    assert viewer.window.timeline.label == "Step 10 of 40"


def test_the_best_and_the_suggested_step_are_told(viewer: Controller, trained_run: FakeRun) -> None:
    from dmp.stopping import suggest

    suggestion = suggest(trained_run.curve(), trained_run.snapshot_steps())
    viewer.workspace.open_run(trained_run, trained_run.problem, Source("scan", trained_run.problem.mesh), suggestion)
    assert suggestion is not None
    trigger(viewer, "show_suggested")
    assert viewer.workspace.shown_step == suggestion.step == 20
    assert "suggested" in viewer.window.panes.titles[PREDICTED].texts[1]
    assert "best MAD" in viewer.window.panes.titles[PREDICTED].texts[1]
    assert viewer.window.curve.advice == suggestion.reason
