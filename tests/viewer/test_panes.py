"""What the panes of the real window show: meshes, colours, cameras. Rendered pixels tell."""

from __future__ import annotations

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QCoreApplication, QEvent, QObject, QPoint, Qt
from qtpy.QtWidgets import QWidget
from qtpy.shiboken import getAllValidWrappers, isValid, ownedByPython

from dmp.problem import Problem
from dmp_viewer.controller import Controller
from dmp_viewer.model import Source
from dmp_viewer.views.interactor import Interactor
from dmp_viewer.views.mesh_panes import INPUT, PREDICTED, SMOOTHED
from tests.viewer.conftest import FakeRun, pane_pixels
from tests.viewer.driving import show_fake, trigger


def test_scrubbing_changes_the_predicted_pane_only_and_leaves_the_camera(
    viewer: Controller, trained_run: FakeRun, qtbot: QtBot
) -> None:
    show_fake(viewer, trained_run)
    camera = viewer.window.panes.camera_state()
    before = [pane_pixels(viewer, pane) for pane in (INPUT, SMOOTHED, PREDICTED)]
    viewer.window.timeline.go(-2)
    qtbot.waitUntil(lambda: viewer.workspace.shown_step == 20)
    after = [pane_pixels(viewer, pane) for pane in (INPUT, SMOOTHED, PREDICTED)]
    changed = [float((old != new).any(axis=2).mean()) for old, new in zip(before, after, strict=True)]
    assert changed[PREDICTED] > 0.05
    assert changed[SMOOTHED] == 0
    # The shared range may follow the step, so the input may change its colours, but not its outline.
    background = before[INPUT][2, 2]
    outline = [(picture != picture[:, :1]).any(axis=2) for picture in (before[INPUT], after[INPUT])]
    assert np.array_equal(*outline), background
    assert viewer.window.panes.camera_state() == camera


def test_a_pane_that_is_not_drawn_anew_keeps_its_picture(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> None:
    show_fake(viewer, trained_run)
    qtbot.wait(50)
    drawn: list[set[int]] = []
    viewer.window.panes.interactor.painted.connect(drawn.append)
    viewer.workspace.colors.set(quantity="plain")
    viewer.presenter.flush()
    qtbot.wait(50)
    before = viewer.window.grab().toImage()
    drawn.clear()
    viewer.workspace.show_step(20)
    viewer.presenter.flush()
    qtbot.waitUntil(lambda: bool(drawn))
    assert drawn[0] == {PREDICTED}
    after = viewer.window.grab().toImage()
    panes = viewer.window.panes
    place = panes.interactor.mapTo(viewer.window, QPoint(0, 0))
    middle = place + QPoint(panes.interactor.width() // 6, panes.interactor.height() // 2)
    assert before.pixelColor(middle) == after.pixelColor(middle)
    assert after.pixelColor(middle) != after.pixelColor(place + QPoint(3, 3))


def test_a_resting_view_costs_nothing(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> None:
    show_fake(viewer, trained_run)
    paints: list[object] = []
    viewer.window.panes.interactor.painted.connect(paints.append)
    for _ in range(10):  # on a slow machine the last paint of what was shown comes late
        paints.clear()
        qtbot.wait(400)
        if not paints:
            break
    assert paints == []


def test_the_whole_window_is_in_a_picture_of_it(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> None:
    show_fake(viewer, trained_run)
    qtbot.wait(50)
    image = viewer.exporter.picture().toImage()
    interactor = viewer.window.panes.interactor
    place = interactor.mapTo(viewer.window, QPoint(interactor.width() // 6, interactor.height() // 2))
    corner = interactor.mapTo(viewer.window, QPoint(4, 4))
    assert image.pixelColor(place) != image.pixelColor(corner)
    assert len({image.pixelColor(place + QPoint(dx, dy)).name() for dx in range(-20, 20, 4) for dy in range(-20, 20, 4)}) > 10


@pytest.mark.parametrize("quantity", ["magnitude", "signed", "plain"])
def test_colouring(viewer: Controller, trained_run: FakeRun, quantity: str) -> None:
    show_fake(viewer, trained_run)
    trigger(viewer, quantity)
    assert viewer.workspace.colors.quantity == quantity
    picture = pane_pixels(viewer, INPUT).astype(int)
    spread = picture.max(axis=2) - picture.min(axis=2)
    colourful = float((spread > 60).mean())
    assert (colourful > 0.1) is (quantity != "plain")
    assert viewer.window.color_bar.gradient.isVisible() is (quantity != "plain")
    low, high = viewer.window.color_bar.gradient.shown_limits
    assert high > 0
    if quantity == "signed":
        assert low == -high


def test_units_and_range_are_chosen_at_the_colour_bar(viewer: Controller, trained_run: FakeRun) -> None:
    show_fake(viewer, trained_run)
    gradient = viewer.window.color_bar.gradient
    edges = gradient.shown_limits[1]
    viewer.window.color_bar.unitChosen.emit("file")
    viewer.presenter.flush()
    assert gradient.unit == "file units"
    assert gradient.shown_limits[1] == pytest.approx(edges * trained_run.problem.edge_length)
    viewer.window.color_bar.rangeChosen.emit("run")
    viewer.presenter.flush()
    assert viewer.workspace.colors.policy.range == "run"


def test_linked_cameras_turn_together_and_unlinked_ones_do_not(viewer: Controller, trained_run: FakeRun) -> None:
    show_fake(viewer, trained_run)
    cameras = lambda: [renderer.GetActiveCamera() for renderer in viewer.window.panes.interactor.renderers]  # noqa: E731
    assert cameras()[0] is cameras()[2]
    trigger(viewer, "link")
    position = cameras()[2].GetPosition()
    cameras()[0].Azimuth(30)
    assert cameras()[2].GetPosition() == pytest.approx(position)
    trigger(viewer, "link")
    assert cameras()[2].GetPosition() == pytest.approx(cameras()[0].GetPosition())
    trigger(viewer, "reset_view")
    assert cameras()[1].GetPosition() == pytest.approx(position)


def test_the_axis_that_points_up_can_be_chosen(viewer: Controller, trained_run: FakeRun) -> None:
    show_fake(viewer, trained_run)
    before = viewer.window.panes.camera_state()[2]
    trigger(viewer, "z_up")
    after = viewer.window.panes.camera_state()[2]
    assert before[1] > 0.8
    assert after[2] > 0.8
    assert viewer.preferences.up == "z"


def test_a_fitted_view_stays_fitted_until_somebody_turns_it(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> None:
    show_fake(viewer, trained_run)
    qtbot.wait(50)
    panes = viewer.window.panes
    fitted = panes.camera_state()
    viewer.window.resize(760, 950)  # the panes become higher than wide
    qtbot.waitUntil(lambda: panes.camera_state() != fitted)
    panes.interactor.renderers[0].GetActiveCamera().Azimuth(20)
    turned = panes.camera_state()
    viewer.window.resize(900, 700)
    qtbot.wait(50)
    assert panes.camera_state() == turned


def test_turning_with_the_mouse_moves_all_panes(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> None:
    show_fake(viewer, trained_run)
    interactor = viewer.window.panes.interactor
    before = [pane_pixels(viewer, pane) for pane in range(3)]
    start = QPoint(interactor.width() // 6, interactor.height() // 2)
    qtbot.mousePress(interactor, Qt.MouseButton.LeftButton, pos=start)
    qtbot.mouseMove(interactor, start + QPoint(30, 10))
    qtbot.mouseMove(interactor, start + QPoint(60, 20))
    qtbot.mouseRelease(interactor, Qt.MouseButton.LeftButton, pos=start + QPoint(60, 20))
    for pane in range(3):
        assert (before[pane] != pane_pixels(viewer, pane)).any()


def test_edges_and_themes_change_the_picture(viewer: Controller, trained_run: FakeRun) -> None:
    show_fake(viewer, trained_run)
    light = pane_pixels(viewer, SMOOTHED)
    trigger(viewer, "edges")
    assert (pane_pixels(viewer, SMOOTHED) != light).any()
    trigger(viewer, "theme_dark")
    dark = pane_pixels(viewer, SMOOTHED)
    assert dark[:4].mean() < 80 < light[:4].mean()
    trigger(viewer, "theme_light")


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_meshes_of_any_size_and_place_fill_the_panes(viewer: Controller, problem: Problem, scale: float) -> None:
    from dmp.problem import denoising
    from dmp.settings import settings_for

    moved = problem.mesh.with_vertices(problem.mesh.vertices * scale + 100 * scale)
    viewer.workspace.open_problem(denoising(moved, settings_for()), Source("far", moved))
    picture = pane_pixels(viewer, INPUT)
    covered = (np.abs(picture.astype(int) - picture[:, :1]) > 6).any(axis=2)
    columns, rows = np.flatnonzero(covered.any(axis=0)), np.flatnonzero(covered.any(axis=1))
    height, width = covered.shape
    assert min(width - np.ptp(columns), height - np.ptp(rows)) < 0.1 * min(width, height)
    assert columns[0] + columns[-1] == pytest.approx(width, abs=8)
    assert rows[0] + rows[-1] == pytest.approx(height, abs=8)
    assert columns[0] > 0
    assert rows[0] > 0


@pytest.mark.usefixtures("qapp")
def test_a_deleted_view_leaves_no_name_for_memory_that_is_not_its_own(qtbot: QtBot) -> None:
    # PySide gives an object that Qt makes later at the same address the Python class of such a forgotten one.
    host = QWidget()
    interactor = Interactor(host, multi_samples=0)
    host.show()
    qtbot.waitExposed(host)
    interactor.grabFramebuffer()
    surface = interactor._surface
    assert isValid(surface)
    host.deleteLater()
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    assert not isValid(surface)
    foreign = [one for one in getAllValidWrappers() if not isinstance(one, QObject) and not ownedByPython(one)]
    assert {type(one).__name__ for one in foreign} <= {"QMetaObject"}
