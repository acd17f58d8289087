"""Looking closely in the real window: shading, colours, flip, swipe, lens, picking. Rendered pixels tell."""

from __future__ import annotations

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, QPoint, QPointF, Qt
from qtpy.QtGui import QKeyEvent
from qtpy.QtWidgets import QApplication

from dmp.problem import denoising
from dmp.settings import settings_for
from dmp_viewer.colors import QUANTITIES, Limits
from dmp_viewer.controller import Controller
from dmp_viewer.model import Source
from dmp_viewer.views import questions
from dmp_viewer.views.mesh_panes import INPUT, MIDDLE, PREDICTED
from tests.viewer.conftest import FakeRun, pane_pixels
from tests.viewer.driving import show_fake, trigger


def share_changed(before: np.ndarray, after: np.ndarray) -> float:
    """Return the share of pixels that look different; shades differ a little from pane to pane."""
    return float((np.abs(before.astype(int) - after) > 10).any(axis=2).mean())


@pytest.fixture
def judged(viewer: Controller, trained_run: FakeRun) -> Controller:
    """A window that shows step 10, in the bare colours of the surface."""
    show_fake(viewer, trained_run)
    viewer.workspace.show_step(10)
    trigger(viewer, "plain")
    return viewer


# -- shading and colours ----------------------------------------------------------------------------------------------


def test_smooth_shading_hides_the_faces_of_every_snapshot(judged: Controller) -> None:
    flat = pane_pixels(judged, INPUT)
    trigger(judged, "smooth")
    assert share_changed(flat, pane_pixels(judged, INPUT)) > 0.1
    judged.workspace.show_step(40)
    # The normals go with the positions: the last step is the input itself, and looks like it.
    assert share_changed(pane_pixels(judged, PREDICTED), pane_pixels(judged, INPUT)) < 0.02
    trigger(judged, "smooth")
    assert share_changed(pane_pixels(judged, PREDICTED), flat) < 0.02


@pytest.mark.parametrize("quantity", [name for name in QUANTITIES if name not in ("plain", "step")])
def test_every_quantity_colours_the_prediction_and_tells_its_unit(judged: Controller, quantity: str) -> None:
    bare = pane_pixels(judged, PREDICTED)
    trigger(judged, quantity)
    colored = pane_pixels(judged, PREDICTED)
    assert share_changed(bare, colored) > 0.1
    assert np.ptp(colored.astype(int), axis=2).max() > 60
    bar = judged.window.color_bar
    assert bar.gradient.isVisible() is (quantity != "normals")
    if quantity != "normals":
        assert bar.gradient.unit
        assert bar.gradient.histogram is not None
        assert bar.gradient.histogram.counts.sum() > 200


def test_quantities_that_need_something_say_what(judged: Controller) -> None:
    bar = judged.window.color_bar
    assert not bar.is_offered("step")
    assert not judged.window.named_actions["step"].isEnabled()
    trigger(judged, "set_reference")
    assert bar.is_offered("step")
    problem = denoising(judged.workspace.problem.mesh, settings_for())  # type: ignore[union-attr]
    judged.workspace.open_problem(problem, Source("scan", problem.mesh))
    judged.presenter.flush()
    assert not bar.is_offered("error")
    assert not judged.window.named_actions["normal_error"].isEnabled()
    assert all("Needs" not in spec.help for spec in QUANTITIES.values())


def test_the_range_of_the_whole_run_comes_from_all_snapshots(judged: Controller) -> None:
    trigger(judged, "input_distance")
    judged.workspace.show_step(40)
    judged.presenter.flush()
    before = judged.window.color_bar.gradient.shown_limits[1]
    trigger(judged, "range_run")
    assert judged.scanner.wait(20)
    judged.presenter.flush()
    # Step 40 is the input itself; the others are farther away.
    assert judged.window.color_bar.gradient.shown_limits[1] != before
    assert judged.workspace.colors.steps_to_measure() == []


def test_the_range_is_locked_typed_and_let_go(judged: Controller, monkeypatch: pytest.MonkeyPatch) -> None:
    trigger(judged, "magnitude")
    asked = []
    monkeypatch.setattr(questions, "ask_range", lambda _parent, *now: asked.append(now) or (0.5, 1.5))
    trigger(judged, "set_range")
    assert asked[0][2] == "edge lengths"
    assert judged.window.color_bar.gradient.shown_limits == pytest.approx((0.5, 1.5))
    assert judged.window.named_actions["lock_range"].isChecked()
    before = pane_pixels(judged, PREDICTED)
    trigger(judged, "lock_range")
    assert judged.window.named_actions["range_step"].isChecked()
    assert share_changed(before, pane_pixels(judged, PREDICTED)) > 0.05


def test_the_range_dialog_takes_only_a_range(judged: Controller) -> None:
    dialog = questions.RangeDialog(judged.window, 0.0, 2.0, "edge lengths")
    low, high = dialog._ends
    low.setText("0,5")
    assert dialog.ends == (0.5, 2.0)
    high.setText("0.1")
    assert dialog.ends is None
    assert not dialog._use.isEnabled()
    high.setText("")
    assert dialog.ends is None


def test_the_colours_reach_the_bar_as_they_are_locked(judged: Controller) -> None:
    trigger(judged, "magnitude")
    judged.workspace.colors.lock(Limits(0.0, 1e-9))
    judged.presenter.flush()
    # Everything lies beyond the range, and has the colour of its end.
    assert judged.window.color_bar.gradient.histogram is not None
    assert judged.window.color_bar.gradient.histogram.share_outside > 0.99
    assert "beyond the range" in judged.window.color_bar.gradient.toolTip()


# -- both in one pane -------------------------------------------------------------------------------------------------


def test_flipping_shows_the_input_in_place_of_the_prediction(judged: Controller) -> None:
    predicted, given = pane_pixels(judged, PREDICTED), pane_pixels(judged, INPUT)
    trigger(judged, "flip")
    assert share_changed(pane_pixels(judged, PREDICTED), given) < 0.02
    assert judged.window.panes.titles[PREDICTED].texts == ("Input", "in place of the prediction")
    trigger(judged, "flip")
    assert share_changed(pane_pixels(judged, PREDICTED), predicted) == 0


def test_a_held_key_shows_the_input_only_as_long_as_it_is_held(
    judged: Controller, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dmp_viewer.views.held_key._LONG_SECONDS", 0.1)
    with qtbot.waitActive(judged.window):
        judged.window.activateWindow()
    view = judged.window.panes.interactor
    view.setFocus()
    comparison = judged.workspace.comparison
    qtbot.keyPress(view, Qt.Key.Key_A)
    assert comparison.flipped
    qtbot.wait(150)
    repeated = QKeyEvent(QEvent.Type.KeyRelease, Qt.Key.Key_A, Qt.KeyboardModifier.NoModifier, "a", True)
    QApplication.sendEvent(view, repeated)
    assert comparison.flipped
    qtbot.keyRelease(view, Qt.Key.Key_A)
    assert not comparison.flipped
    qtbot.keyClick(view, Qt.Key.Key_A)
    assert comparison.flipped
    qtbot.keyClick(view, Qt.Key.Key_A)
    assert not comparison.flipped


def test_a_key_is_watched_only_while_it_is_down(judged: Controller, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dmp_viewer.views.held_key._LONG_SECONDS", 0.0)
    with qtbot.waitActive(judged.window):
        judged.window.activateWindow()
    view, key, comparison = judged.window.panes.interactor, judged.judging.flip_key, judged.workspace.comparison
    view.setFocus()
    trigger(judged, "flip")  # as from the menu: no key is down
    assert not key.is_watching
    assert comparison.flipped
    trigger(judged, "flip")
    qtbot.keyPress(view, Qt.Key.Key_A)
    assert key.is_watching
    qtbot.keyClick(view, Qt.Key.Key_X)  # another key comes up, this one stays down
    assert key.is_watching
    assert comparison.flipped
    qtbot.keyRelease(view, Qt.Key.Key_A)
    assert not key.is_watching
    assert not comparison.flipped


def test_a_held_key_ends_when_the_keyboard_goes_to_another_window(
    judged: Controller, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dmp_viewer.views.held_key._LONG_SECONDS", 0.0)
    with qtbot.waitActive(judged.window):
        judged.window.activateWindow()
    judged.window.panes.interactor.setFocus()
    qtbot.keyPress(judged.window.panes.interactor, Qt.Key.Key_A)
    assert judged.workspace.comparison.flipped
    QApplication.instance().focusWindowChanged.emit(None)
    assert not judged.judging.flip_key.is_watching
    assert not judged.workspace.comparison.flipped


def test_swiping_shows_the_input_left_of_the_line(judged: Controller, qtbot: QtBot) -> None:
    predicted, given = pane_pixels(judged, PREDICTED), pane_pixels(judged, INPUT)
    trigger(judged, "swipe")
    handle = judged.window.panes.handle
    assert handle.isVisible()
    middle = predicted.shape[1] // 2
    both = pane_pixels(judged, PREDICTED)
    assert share_changed(both[:, : middle - 4], given[:, : middle - 4]) < 0.02
    assert share_changed(both[:, middle + 4 :], predicted[:, middle + 4 :]) < 0.02
    assert share_changed(both[:, : middle - 4], predicted[:, : middle - 4]) > 0.1
    assert judged.window.panes.titles[PREDICTED].texts[0] == "Input  |  Predicted @ step 10"

    qtbot.mousePress(handle, Qt.MouseButton.LeftButton)
    QApplication.sendEvent(handle, _moved(handle, -70))
    qtbot.mouseRelease(handle, Qt.MouseButton.LeftButton)
    moved = pane_pixels(judged, PREDICTED)
    assert share_changed(moved[:, middle - 50 :], predicted[:, middle - 50 :]) < 0.02
    before = handle.centre.x()
    handle.setFocus()
    qtbot.keyClick(handle, Qt.Key.Key_Right)
    assert handle.centre.x() > before
    assert judged.workspace.shown_step == 10
    trigger(judged, "swipe")
    assert not handle.isVisible()
    assert share_changed(pane_pixels(judged, PREDICTED), predicted) == 0


def _moved(handle: object, places: int) -> QEvent:
    from qtpy.QtGui import QMouseEvent

    place = QPointF(handle.width() / 2 + places, 20)  # type: ignore[attr-defined]
    button = Qt.MouseButton.LeftButton
    return QMouseEvent(
        QEvent.Type.MouseMove,
        place,
        handle.mapToGlobal(place),
        button,
        button,
        Qt.KeyboardModifier.NoModifier,  # type: ignore[attr-defined]
    )


def test_the_lens_follows_the_mouse(judged: Controller, qtbot: QtBot) -> None:
    predicted, given = pane_pixels(judged, PREDICTED), pane_pixels(judged, INPUT)
    trigger(judged, "lens")
    panes = judged.window.panes
    both = pane_pixels(judged, PREDICTED)
    height, width = both.shape[:2]
    inside = (slice(height // 2 - 20, height // 2 + 20), slice(width // 2 - 20, width // 2 + 20))
    assert share_changed(both[inside], given[inside]) < 0.02
    assert share_changed(both[:20], predicted[:20]) == 0
    panes.interactor.hovered.emit(QPoint(5, 5))  # in another pane
    assert share_changed(pane_pixels(judged, PREDICTED), both) == 0
    panes.interactor.hovered.emit(QPoint(panes.interactor.width() - 20, 20))
    moved = pane_pixels(judged, PREDICTED)
    assert share_changed(moved[inside], predicted[inside]) < 0.02
    assert "in the lens: Input" in panes.titles[PREDICTED].texts[1]
    trigger(judged, "swipe")
    assert not judged.window.named_actions["lens"].isChecked()


def test_the_middle_pane_shows_the_truth_and_can_be_compared_with(judged: Controller) -> None:
    trigger(judged, "middle_truth")
    truth = pane_pixels(judged, MIDDLE)
    assert judged.window.panes.titles[MIDDLE].texts[0] == "Ground truth"
    trigger(judged, "flip")
    trigger(judged, "against_middle")
    assert share_changed(pane_pixels(judged, PREDICTED), truth) < 0.02
    assert judged.window.panes.titles[PREDICTED].texts[0] == "Ground truth"
    trigger(judged, "next_middle")
    assert judged.window.panes.titles[MIDDLE].texts[0] == "Smoothed"
    assert share_changed(pane_pixels(judged, PREDICTED), truth) > 0.05


def test_a_reference_step_is_shown_and_coloured_by(judged: Controller) -> None:
    trigger(judged, "set_reference")
    judged.workspace.show_step(40)
    trigger(judged, "step")
    trigger(judged, "middle_step")
    assert judged.window.panes.titles[MIDDLE].texts[0] == "Reference: step 10"
    colored = pane_pixels(judged, PREDICTED)
    judged.workspace.show_step(10)
    bare = pane_pixels(judged, PREDICTED)
    assert np.ptp(colored.astype(int), axis=2).max() > np.ptp(bare.astype(int), axis=2).max() + 60


# -- picking ----------------------------------------------------------------------------------------------------------


def click(viewer: Controller, qtbot: QtBot, pane: int, across: float = 0.5, down: float = 0.5) -> None:
    view = viewer.window.panes.interactor
    place = QPoint(round(view.width() / 3 * (pane + across)), round(view.height() * down))
    qtbot.mouseClick(view, Qt.MouseButton.LeftButton, pos=place)
    viewer.presenter.flush()


def test_a_click_picks_a_vertex_and_shows_its_values_and_history(judged: Controller, qtbot: QtBot) -> None:
    trigger(judged, "magnitude")
    picked = judged.window.picked
    assert not picked.isVisible()
    before = pane_pixels(judged, INPUT)
    click(judged, qtbot, PREDICTED)
    vertex = judged.workspace.picking.vertex
    assert vertex is not None
    assert judged.window.panes.marked_panes == [INPUT, MIDDLE, PREDICTED]
    assert share_changed(before, pane_pixels(judged, INPUT)) > 0.0005
    problem, colors = judged.workspace.problem, judged.workspace.colors
    assert problem is not None
    expected = np.linalg.norm(problem.target[vertex] - problem.base[vertex]) * colors.unit[0]
    assert picked.isVisible()
    assert picked.texts[0] == f"Vertex {vertex:,}"
    assert float(picked.texts[2]) == pytest.approx(expected, rel=1e-3)
    assert picked.texts[3] == "0"
    assert float(picked.texts[4]) == pytest.approx(expected / 4, rel=1e-3)
    assert judged.scanner.wait(20)
    judged.presenter.flush()
    assert picked.history.n_points == 5
    assert judged.workspace.picking.history[40] == pytest.approx(expected / colors.unit[0], rel=1e-3)
    picked.history.stepClicked.emit(30)
    assert judged.workspace.shown_step == 30
    trigger(judged, "forget_vertex")
    assert not picked.isVisible()
    assert judged.window.panes.marked_panes == []


def test_a_drag_or_a_click_beside_the_mesh_picks_nothing(judged: Controller, qtbot: QtBot) -> None:
    view = judged.window.panes.interactor
    start = QPoint(view.width() // 6, view.height() // 2)
    qtbot.mousePress(view, Qt.MouseButton.LeftButton, pos=start)
    qtbot.mouseMove(view, start + QPoint(40, 0))
    qtbot.mouseRelease(view, Qt.MouseButton.LeftButton, pos=start + QPoint(40, 0))
    assert judged.workspace.picking.vertex is None
    judged.workspace.picking.pick(7)
    click(judged, qtbot, INPUT, 0.02, 0.02)
    assert judged.workspace.picking.vertex is None


def test_the_picked_vertex_is_the_one_under_the_mouse(judged: Controller, qtbot: QtBot) -> None:
    panes = judged.window.panes
    for pane, across, down in ((INPUT, 0.4, 0.6), (PREDICTED, 0.6, 0.45)):
        click(judged, qtbot, pane, across, down)
        vertex = judged.workspace.picking.vertex
        assert vertex is not None
        renderer = panes.interactor.renderers[pane]
        x, y, z = (float(number) for number in panes._panes[pane].coordinates[vertex])
        renderer.SetWorldPoint(x, y, z, 1.0)
        renderer.WorldToDisplay()
        found = np.array(renderer.GetDisplayPoint()[:2])
        wanted = np.array([(pane + across) * panes.interactor.width() / 3, (1 - down) * panes.interactor.height()])
        assert np.linalg.norm(found - wanted) < 0.12 * panes.interactor.height()


def test_a_vertex_is_picked_by_its_number(judged: Controller, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(questions, "ask_vertex", lambda _parent, count, _proposal: count - 1)
    trigger(judged, "pick_vertex")
    assert judged.workspace.picking.vertex == 257
    judged.workspace.picking.pick(258)
    assert judged.workspace.picking.vertex is None


def test_the_history_follows_the_quantity_and_new_snapshots(judged: Controller, trained_run: FakeRun) -> None:
    trigger(judged, "magnitude")
    judged.workspace.picking.pick(3)
    assert judged.scanner.wait(20)
    displacement = dict(judged.workspace.picking.history)
    trigger(judged, "normal_error")
    assert judged.scanner.wait(20)
    angles = dict(judged.workspace.picking.history)
    assert displacement.keys() == angles.keys() == {0, 10, 20, 30, 40}
    assert displacement != angles
    trained_run.settings = settings_for(steps=50, snapshot_every=10)
    judged.workspace.add_snapshot(trained_run.record(50).snapshot)  # type: ignore[arg-type]
    assert judged.scanner.wait(20)
    assert 50 in judged.workspace.picking.history


def test_rows_that_come_and_go_leave_the_meshes_where_they_are(judged: Controller, qtbot: QtBot) -> None:
    qtbot.wait(50)  # until the status bar has its text, and with it its height
    height, layout = judged.window.panes.height(), judged.window.layout_state()[1]
    judged.workspace.picking.pick(3)
    judged.presenter.flush()
    qtbot.wait(20)
    assert judged.window.picked.isVisible()
    assert judged.window.panes.height() == height
    assert judged.window.layout_state()[1] == layout
    judged.workspace.picking.pick(None)
    judged.presenter.flush()
    qtbot.wait(20)
    assert judged.window.panes.height() == height
    assert judged.window.layout_state()[1] == layout
