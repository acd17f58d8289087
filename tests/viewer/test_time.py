"""Going through time in the real window: bookmarks, speed, small pictures, the steps that matter and why."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, QPoint, QPointF, Qt
from qtpy.QtGui import QHelpEvent, QImage
from qtpy.QtWidgets import QApplication, QToolTip

from dmp.bookmarks import read_bookmarks
from dmp_viewer.controller import Controller
from dmp_viewer.marks import step_marks
from dmp_viewer.model import Source, Workspace
from dmp_viewer.settings import Preferences
from tests.viewer.conftest import FakeRun
from tests.viewer.driving import MakeViewer, show_fake, trigger


def pixels(image: QImage) -> np.ndarray:
    image = image.convertToFormat(QImage.Format.Format_RGB888)
    return np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine()).copy()


# -- bookmarks --------------------------------------------------------------------------------------------------------


def test_bookmarks_are_set_jumped_to_and_kept_in_the_run_folder(
    viewer: Controller, trained_run: FakeRun, tmp_path: Path
) -> None:
    trained_run.folder = tmp_path
    show_fake(viewer, trained_run)
    slider = viewer.window.timeline.slider
    bare = pixels(slider.grab().toImage())
    for step in (30, 10):
        viewer.workspace.show_step(step)
        trigger(viewer, "bookmark")
    assert viewer.window.named_actions["bookmark"].isChecked()
    assert read_bookmarks(tmp_path) == [10, 30]
    viewer.workspace.show_step(0)
    viewer.presenter.flush()
    assert not viewer.window.named_actions["bookmark"].isChecked()
    assert not viewer.window.named_actions["previous_bookmark"].isEnabled()
    shown = []
    for name in ("next_bookmark", "next_bookmark", "next_bookmark", "previous_bookmark"):
        trigger(viewer, name)
        shown.append(viewer.workspace.shown_step)
    assert shown == [10, 30, 30, 10]
    viewer.workspace.show_step(40)
    viewer.presenter.flush()
    assert not np.array_equal(pixels(slider.grab().toImage())[:9], bare[:9])
    assert "Bookmark: step 10." in [mark.sentence for mark in slider.marks_at(slider.x_of(1))]

    show_fake(viewer, trained_run)
    assert viewer.workspace.bookmarks.steps == [10, 30]
    viewer.workspace.show_step(10)
    trigger(viewer, "bookmark")
    assert read_bookmarks(tmp_path) == [30]


def test_bookmarks_that_cannot_be_written_are_told_and_last(viewer: Controller, trained_run: FakeRun, tmp_path: Path) -> None:
    trained_run.folder = tmp_path / "gone"
    show_fake(viewer, trained_run)
    trigger(viewer, "bookmark")
    assert "bookmarks cannot be written" in viewer.window.banners.texts()[-1]
    assert viewer.workspace.bookmarks.steps == [40]


# -- playing ----------------------------------------------------------------------------------------------------------


def test_the_speed_is_chosen_by_keys_and_remembered(make_viewer: MakeViewer, trained_run: FakeRun, qtbot: QtBot) -> None:
    viewer = make_viewer(Preferences(theme="light", play_speed=20))
    show_fake(viewer, trained_run)
    timeline = viewer.window.timeline
    assert timeline.speed == 20
    trigger(viewer, "faster")
    trigger(viewer, "faster")
    assert timeline.speed == viewer.preferences.play_speed == 50
    for _ in range(9):
        trigger(viewer, "slower")
    assert timeline.speed == 1
    timeline.set_speed(50)
    trigger(viewer, "first_step")
    trigger(viewer, "play")
    qtbot.waitUntil(lambda: not timeline.is_playing, timeout=5000)
    assert viewer.workspace.shown_step == 40


# -- the steps that matter --------------------------------------------------------------------------------------------


def test_each_criterion_marks_its_best_step_and_says_why(trained_run: FakeRun) -> None:
    from dmp.stopping import suggest

    workspace = Workspace()
    suggestion = suggest(trained_run.curve(), trained_run.snapshot_steps())
    workspace.open_run(trained_run, trained_run.problem, Source("scan", trained_run.problem.mesh), suggestion)
    workspace.keep(30)
    marks = {mark.name: mark for mark in step_marks(workspace)}
    assert {name: mark.step for name, mark in marks.items()} == {"kept": 30, "suggested": 20, "held_out": 20, "best": 20}
    assert all(mark.sentence.endswith(".") and f"step {mark.step}" in mark.sentence for mark in marks.values())
    assert "ground truth" in marks["best"].sentence
    assert "10.20°" in marks["best"].sentence
    assert "never sees" in marks["held_out"].sentence


def test_a_mark_is_explained_where_the_mouse_rests(viewer: Controller, trained_run: FakeRun) -> None:
    show_fake(viewer, trained_run)
    viewer.workspace.show_step(30)
    trigger(viewer, "keep")
    slider = viewer.window.timeline.slider
    rest(slider, QPoint(round(slider.x_of(3)), slider.height() - 5))
    assert QToolTip.text() == "Kept: you chose step 30 as the result."
    rest(slider, QPoint(round(slider.x_of(1)), 10))
    assert QToolTip.text() == "Step 30 of 40"
    assert "Kept: you chose step 30" in slider.accessibleDescription()

    QApplication.processEvents()
    viewer.presenter._draw_curve()
    plot = viewer.window.curve.plot
    box = plot.getViewBox()
    place = plot.mapFromScene(box.mapViewToScene(QPointF(30.0, sum(box.viewRange()[1]) / 2)))
    rest(plot.viewport(), place)
    assert "Kept: you chose step 30" in QToolTip.text()
    rest(plot.viewport(), plot.mapFromScene(box.mapViewToScene(QPointF(5.0, sum(box.viewRange()[1]) / 2))))
    assert QToolTip.text().startswith("Click to show")


def rest(widget: object, place: QPoint) -> None:
    QToolTip.hideText()
    QApplication.sendEvent(widget, QHelpEvent(QEvent.Type.ToolTip, place, widget.mapToGlobal(place)))  # type: ignore[attr-defined]


def test_marks_of_one_step_lie_side_by_side(viewer: Controller, trained_run: FakeRun) -> None:
    show_fake(viewer, trained_run)
    viewer.workspace.show_step(20)
    trigger(viewer, "keep")
    slider = viewer.window.timeline.slider
    places = slider._places()
    assert len(places) == 3  # kept, held-out, best
    assert sorted(np.diff(sorted(places)).tolist()) == pytest.approx([9, 9])
    viewer.workspace.show_step(40)
    trigger(viewer, "keep")
    assert all(0 <= place <= slider.width() for place in slider._places())


# -- small pictures ---------------------------------------------------------------------------------------------------


def test_snapshots_have_small_pictures_that_can_be_clicked(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> None:
    show_fake(viewer, trained_run)
    strip = viewer.window.timeline.strip
    qtbot.waitUntil(strip.isVisible)
    empty = pixels(strip.grab().toImage())
    assert viewer.scanner.wait(20)
    assert strip.missing() == []
    assert not np.array_equal(pixels(strip.grab().toImage()), empty)
    place = strip._place(strip.indices()[0]).center().toPoint()
    qtbot.mouseClick(strip, Qt.MouseButton.LeftButton, pos=place)
    assert viewer.workspace.shown_step == 0
    trigger(viewer, "show_thumbnails")
    assert not strip.isVisible()
    assert not viewer.preferences.show_thumbnails


def test_as_many_pictures_as_fit_are_chosen_evenly(viewer: Controller, trained_run: FakeRun) -> None:
    show_fake(viewer, trained_run)
    strip = viewer.window.timeline.strip
    for count in (2, 7, 50, 101, 1000):
        strip._steps = list(range(count))
        indices = strip.indices()
        assert indices[0] == 0
        assert len(set(np.diff(indices).tolist())) <= 1
        assert len(indices) * 50 <= strip.width()
        assert len(indices) > 1


def test_pictures_are_those_of_the_run_on_show(viewer: Controller, trained_run: FakeRun, problem: object) -> None:
    show_fake(viewer, trained_run)
    assert viewer.scanner.wait(20)
    strip = viewer.window.timeline.strip
    assert strip._pictures
    viewer.workspace.open_problem(trained_run.problem, Source("scan", trained_run.problem.mesh))
    assert strip._pictures == {}


def test_a_strip_with_another_width_gets_all_its_pictures(viewer: Controller, fake_run: FakeRun, qtbot: QtBot) -> None:
    fake_run.settings = replace(fake_run.settings, steps=120, snapshot_every=5)
    assert len(list(fake_run.records())) == 121
    show_fake(viewer, fake_run)
    strip = viewer.window.timeline.strip
    qtbot.waitUntil(lambda: not strip.missing(), timeout=20_000)
    for width in (700, 1240, 860):
        viewer.window.resize(width, 700)
        qtbot.wait(50)
        qtbot.waitUntil(lambda: not strip.missing(), timeout=20_000)
