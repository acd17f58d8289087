"""The view without perspective."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt

from dmp_viewer.controller import Controller
from dmp_viewer.settings import load
from dmp_viewer.views.mesh_panes import MeshPanes
from tests.viewer.conftest import FakeRun, pane_pixels
from tests.viewer.driving import MakeViewer, show_fake, trigger


@pytest.fixture
def full(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> Controller:
    show_fake(viewer, trained_run)
    with qtbot.waitActive(viewer.window):
        viewer.window.activateWindow()
    return viewer


def _seen_length(panes: MeshPanes, depth: float) -> float:
    """Return how many pixels long a short upright line is, at a depth behind what the camera looks at."""
    renderer = panes.interactor.renderers[0]
    camera = renderer.GetActiveCamera()
    place = np.array(camera.GetFocalPoint()) + depth * np.array(camera.GetDirectionOfProjection())
    ends = []
    for end in (place, place + 0.1 * np.array(camera.GetViewUp())):
        renderer.SetWorldPoint(*end, 1.0)
        renderer.WorldToDisplay()
        ends.append(np.array(renderer.GetDisplayPoint()[:2]))
    return float(np.linalg.norm(ends[1] - ends[0]))


def test_without_perspective_near_and_far_are_equally_large(full: Controller, qtbot: QtBot) -> None:
    panes = full.window.panes
    assert _seen_length(panes, -0.5) > 1.1 * _seen_length(panes, 0.5)
    middle = _seen_length(panes, 0.0)
    panes.interactor.renderers[0].GetActiveCamera().Azimuth(20)  # no fitted view any more, so its size has to stay
    before = pane_pixels(full, 0)
    qtbot.keyClick(full.window, Qt.Key.Key_5)
    full.presenter.flush()
    assert full.window.named_actions["orthographic"].isChecked()
    assert _seen_length(panes, -0.5) == pytest.approx(_seen_length(panes, 0.5), rel=1e-6)
    assert _seen_length(panes, 0.0) == pytest.approx(middle, rel=1e-6)
    assert not np.array_equal(pane_pixels(full, 0), before)
    qtbot.keyClick(full.window, Qt.Key.Key_5)
    full.presenter.flush()
    assert _seen_length(panes, 0.0) == pytest.approx(middle, rel=1e-6)
    # Up to rounding at a few rims, the same picture.
    assert np.mean(pane_pixels(full, 0) != before) < 0.01


def test_all_panes_follow_when_they_turn_by_themselves(full: Controller) -> None:
    trigger(full, "link")
    trigger(full, "orthographic")
    cameras = [renderer.GetActiveCamera() for renderer in full.window.panes.interactor.renderers]
    assert len(set(map(id, cameras))) == 3
    assert all(camera.GetParallelProjection() for camera in cameras)
    trigger(full, "link")
    assert full.window.panes.interactor.renderers[2].GetActiveCamera().GetParallelProjection()


def test_a_fitted_mesh_fills_its_pane_without_perspective_too(full: Controller) -> None:
    trigger(full, "orthographic")
    trigger(full, "view_side")
    panes = full.window.panes
    pane = panes._panes[0]
    renderer = panes.interactor.renderers[0]
    corners = []
    for point in pane.coordinates:
        renderer.SetWorldPoint(*map(float, point), 1.0)
        renderer.WorldToView()
        corners.append(renderer.GetViewPoint()[:2])
    reach = np.abs(corners).max(axis=0)
    assert 0.9 < reach.max() < 1.0


def test_an_exported_picture_sees_what_the_view_sees(full: Controller) -> None:
    panes = full.window.panes
    trigger(full, "orthographic")
    viewpoint = panes.viewpoints()[0]
    distance = np.linalg.norm(np.subtract(viewpoint.position, viewpoint.focal_point))
    scale = panes.interactor.renderers[0].GetActiveCamera().GetParallelScale()
    half_height = distance * np.tan(np.radians(viewpoint.angle / 2))
    assert half_height == pytest.approx(scale, rel=1e-6)
    # What lies one unit nearer is hardly larger.
    assert distance / (distance - 1) < 1.02


def test_the_view_is_remembered(make_viewer: MakeViewer, trained_run: FakeRun, tmp_path: Path) -> None:
    viewer = make_viewer()
    show_fake(viewer, trained_run)
    trigger(viewer, "orthographic")
    viewer.save_preferences()
    preferences = load(tmp_path / "window.json")
    assert preferences.orthographic
    other = make_viewer(preferences)
    show_fake(other, trained_run)
    assert other.window.panes.interactor.renderers[0].GetActiveCamera().GetParallelProjection()
    assert other.window.named_actions["orthographic"].isChecked()
