"""Stories in the real window: open, train, scrub, keep, save, reopen, continue, close. They look at what is shown."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QMimeData, QPoint, QPointF, Qt, QUrl
from qtpy.QtGui import QDragEnterEvent, QDropEvent
from qtpy.QtWidgets import QApplication

from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh, write_mesh
from dmp.problem import Problem
from dmp.runs import Run, is_run_folder
from dmp_viewer.controller import Controller
from dmp_viewer.model import Source
from dmp_viewer.runner import Session
from dmp_viewer.settings import Preferences, load
from dmp_viewer.states import RunnerState
from dmp_viewer.tasks import OpenedRun
from dmp_viewer.views import dialogs
from dmp_viewer.views.mesh_panes import INPUT, PREDICTED, SMOOTHED
from tests.viewer.conftest import FakeRun, pane_pixels, quick_settings

MakeViewer = Callable[..., Controller]


def trigger(viewer: Controller, name: str) -> None:
    """Do what a click in the menu does; an action that is off does nothing, as for a person."""
    viewer.presenter.flush()
    viewer.window.named_actions[name].trigger()
    viewer.presenter.flush()


def open_files(viewer: Controller, mesh: Path, truth: Path | None = None) -> None:
    viewer.opener.open_path(mesh, truth)
    assert viewer.background.wait(20)
    viewer.presenter.flush()


def show_fake(viewer: Controller, run: FakeRun) -> None:
    """Show a finished run that was never trained."""
    viewer.workspace.open_run(run, run.problem, Source("scan", run.problem.mesh), None)
    viewer.presenter.flush()


def wait_until_trained(viewer: Controller, qtbot: QtBot) -> None:
    qtbot.waitUntil(lambda: not viewer.runner.state.is_active, timeout=60_000)
    viewer.presenter.flush()


# -- the whole way ----------------------------------------------------------------------------------------------------


def test_open_train_scrub_keep_save_reopen_continue(
    make_viewer: MakeViewer, qtbot: QtBot, tmp_path: Path, mesh_files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer = make_viewer()
    window, workspace = viewer.window, viewer.workspace
    assert window.start_page.isVisible()
    assert not window.panes.isVisible()

    open_files(viewer, *mesh_files)
    assert window.panes.isVisible()
    assert window.panes.titles[INPUT].texts[0] == "Input"
    assert "scan.ply" in window.panes.titles[INPUT].texts[1]
    assert "258 vertices" in window.panes.titles[INPUT].texts[1]
    assert "MAD" in window.panes.titles[INPUT].texts[1]
    assert "Start" in window.panes.titles[PREDICTED].texts[1]
    assert "clean" not in window.banners.texts()

    qtbot.mouseClick(window.panel.button("start"), Qt.MouseButton.LeftButton)
    assert viewer.runner.state is RunnerState.PREPARING
    wait_until_trained(viewer, qtbot)
    assert workspace.snapshot_steps == [0, 5, 10, 15, 20, 25, 30]
    assert window.panel.state_text == "Finished"
    assert window.panes.titles[PREDICTED].texts[0] == "Predicted @ step 30"
    qtbot.wait(150)
    assert window.curve.drawn_names() == ["data_loss", "laplacian_loss", "held_out_error", "mad"]

    trigger(viewer, "previous_step")
    assert workspace.shown_step == 25
    assert not workspace.follow_latest
    qtbot.mouseClick(window.timeline.keep_button, Qt.MouseButton.LeftButton)
    viewer.presenter.flush()
    assert workspace.kept_step == 25
    assert "kept" in window.panes.titles[PREDICTED].texts[1]
    assert not window.named_actions["keep"].isEnabled()
    trigger(viewer, "first_step")
    assert window.named_actions["save"].text() == "&Save kept step 25…"

    asked: list[tuple[str, Path]] = []

    def answer(_parent: object, title: str, proposal: Path, _suffixes: object) -> Path:
        asked.append((title, proposal))
        return proposal

    monkeypatch.setattr(dialogs, "ask_save_mesh", answer)
    trigger(viewer, "save")
    trigger(viewer, "save_shown")
    assert asked == [
        ("Save the kept step 25", tmp_path / "scan_step25.ply"),
        ("Save the shown step 0", tmp_path / "scan_step0.ply"),
    ]
    kept = workspace.snapshot(25)
    assert kept is not None
    saved = read_mesh(tmp_path / "scan_step25.ply")
    assert np.allclose(saved.vertices, kept.vertices, atol=1e-6)
    assert "displacement" in saved.vertex_attributes
    assert any("scan_step25.ply" in text for text in window.banners.texts())

    run = workspace.run
    assert isinstance(run, Run)
    again = make_viewer()
    open_files(again, run.folder)
    assert again.workspace.shown_step == again.workspace.kept_step == 25
    assert len(again.workspace.curve) == len(workspace.curve)
    assert again.window.panel.settings() == quick_settings()
    assert not again.workspace.controls.proceed
    assert "scan.ply" in again.window.panes.titles[INPUT].texts[1]


def test_stop_keeps_the_step_reached_and_continue_goes_on(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path]
) -> None:
    open_files(viewer, mesh_files[0])
    viewer.window.panel.set_settings(quick_settings(steps=100_000, snapshot_every=1000))
    trigger(viewer, "start")
    qtbot.waitUntil(lambda: viewer.workspace.current_step >= 5, timeout=20_000)
    trigger(viewer, "stop")
    assert viewer.window.panel.state_text == "Stopping…"
    wait_until_trained(viewer, qtbot)
    reached = viewer.workspace.snapshot_steps[-1]
    assert viewer.window.panel.state_text == "Stopped"
    assert 5 <= reached < 1000
    assert viewer.workspace.shown_step == reached
    assert viewer.window.panel.button("proceed").isVisible()

    trigger(viewer, "proceed")
    qtbot.waitUntil(lambda: viewer.workspace.current_step > reached + 3, timeout=20_000)
    assert viewer.workspace.curve.rows[0]["step"] == 0
    trigger(viewer, "pause")
    qtbot.waitUntil(lambda: viewer.window.panel.state_text == "Paused")
    qtbot.wait(200)  # for the step it was in
    paused_at = viewer.workspace.current_step
    qtbot.wait(200)
    assert viewer.workspace.current_step == paused_at
    trigger(viewer, "resume")
    qtbot.waitUntil(lambda: viewer.workspace.current_step > paused_at + 3, timeout=20_000)
    steps = [row["step"] for row in viewer.workspace.curve.rows]
    assert steps == sorted(set(steps))


def test_closing_in_mid_training_ends_it_within_three_seconds(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path]
) -> None:
    open_files(viewer, mesh_files[0])
    viewer.window.panel.set_settings(quick_settings(steps=100_000, snapshot_every=1000))
    trigger(viewer, "start")
    qtbot.waitUntil(lambda: viewer.workspace.current_step >= 3, timeout=20_000)
    run = viewer.workspace.run
    assert isinstance(run, Run)
    started = time.monotonic()
    assert viewer.window.close()
    assert time.monotonic() - started < 3
    assert not viewer.runner.state.is_active
    reopened = Run.open(run.folder)
    assert reopened.state == "stopped"
    assert reopened.last_step >= 3


def test_a_training_that_does_not_answer_can_be_left_behind(
    viewer: Controller, qtbot: QtBot, fake_run: FakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    import threading

    hang = threading.Event()

    def prepare() -> Session:
        def records() -> object:
            yield fake_run.record(0)
            hang.wait(30)

        return Session(fake_run, fake_run.problem, "CPU", records())  # type: ignore[arg-type]

    questions: list[str] = []
    monkeypatch.setattr(dialogs, "confirm", lambda _parent, text, *_: bool(questions.append(text)) or True)
    monkeypatch.setattr("dmp_viewer.controller._CLOSE_SECONDS", 0.3)
    viewer.runner.start(prepare)
    qtbot.waitUntil(lambda: viewer.workspace.run is not None)
    assert viewer.window.close()
    assert questions == ["The training does not answer. Leave it behind?"]
    hang.set()


# -- what is shown ----------------------------------------------------------------------------------------------------


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
    viewer.workspace.set_coloring(quantity="plain")
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
    qtbot.wait(200)
    paints: list[object] = []
    viewer.window.panes.interactor.painted.connect(paints.append)
    qtbot.wait(400)
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
    assert viewer.workspace.coloring.quantity == quantity
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
    assert viewer.workspace.coloring.range == "run"


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
    viewer.window.resize(1300, 620)
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


# -- timeline, keys, curve --------------------------------------------------------------------------------------------


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


# -- opening ----------------------------------------------------------------------------------------------------------


def test_errors_are_sentences_in_the_window(viewer: Controller, tmp_path: Path, qtbot: QtBot) -> None:
    bad = tmp_path / "bad.ply"
    bad.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 3\n")
    open_files(viewer, bad)
    assert len(viewer.window.banners.texts()) == 1
    assert str(bad) in viewer.window.banners.texts()[0]
    assert viewer.window.start_page.isVisible()
    open_files(viewer, tmp_path / "missing.ply")
    assert "missing.ply" in viewer.window.banners.texts()[-1]


def test_faults_of_the_program_have_details(viewer: Controller) -> None:
    try:
        raise ZeroDivisionError("by zero")
    except ZeroDivisionError as error:
        viewer.tell_error(error, "Training")
    banner = viewer.window.banners.banners()[0]
    assert "inside the program" in banner.message.text
    assert "test_faults_of_the_program" in banner.message.details


def test_a_ground_truth_can_come_later_and_must_belong_to_the_mesh(
    viewer: Controller, mesh_files: tuple[Path, Path], tmp_path: Path, cube: TriangleMesh, trained_run: FakeRun
) -> None:
    open_files(viewer, mesh_files[0])
    assert "MAD" not in viewer.window.panes.titles[INPUT].texts[1]
    viewer.opener.open_ground_truth(mesh_files[1])
    assert viewer.background.wait(20)
    viewer.presenter.flush()
    assert "MAD" in viewer.window.panes.titles[INPUT].texts[1]
    write_mesh(tmp_path / "cube.ply", cube)
    viewer.opener.open_ground_truth(tmp_path / "cube.ply")
    assert viewer.background.wait(20)
    assert "ground truth" in viewer.window.banners.texts()[-1]


def test_files_are_dropped_anywhere_on_the_window(viewer: Controller, mesh_files: tuple[Path, Path], qtbot: QtBot) -> None:
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path)) for path in mesh_files])
    action, button, modifier = Qt.DropAction.CopyAction, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
    enter = QDragEnterEvent(QPoint(50, 50), action, data, button, modifier)
    QApplication.sendEvent(viewer.window, enter)
    assert enter.isAccepted()
    QApplication.sendEvent(viewer.window, QDropEvent(QPointF(50, 50), action, data, button, modifier))
    assert viewer.background.wait(20)
    viewer.presenter.flush()
    assert "scan.ply" in viewer.window.panes.titles[INPUT].texts[1]
    assert "only scan.ply was opened" in viewer.window.banners.texts()[-1]
    assert not viewer.window.panes.interactor.acceptDrops()


def test_opening_during_a_training_asks_first(
    viewer: Controller, mesh_files: tuple[Path, Path], qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    open_files(viewer, mesh_files[0])
    viewer.window.panel.set_settings(quick_settings(steps=100_000))
    trigger(viewer, "start")
    qtbot.waitUntil(lambda: viewer.workspace.current_step >= 2, timeout=20_000)
    answers = [False, True]
    monkeypatch.setattr(dialogs, "confirm", lambda *_: answers.pop(0))
    open_files(viewer, mesh_files[1])
    assert viewer.runner.state.is_active
    run = viewer.workspace.run
    assert isinstance(run, Run)
    open_files(viewer, mesh_files[1])
    assert not viewer.runner.state.is_active
    assert "clean.ply" in viewer.window.panes.titles[INPUT].texts[1]
    assert Run.open(run.folder).state == "stopped"


def test_samples_are_offered_with_pictures_and_opened_with_their_truth(viewer: Controller, qtbot: QtBot) -> None:
    viewer.opener.offer_samples()
    assert viewer.background.wait(30)
    cards = viewer.window.start_page.cards
    assert cards
    assert all(card.has_picture for card in cards.values())
    qtbot.mouseClick(next(iter(cards.values())), Qt.MouseButton.LeftButton)
    assert viewer.background.wait(30)
    viewer.presenter.flush()
    assert viewer.workspace.problem is not None
    assert viewer.workspace.problem.ground_truth is not None


def test_an_interrupted_run_is_offered_at_the_next_start(
    viewer: Controller, mesh_files: tuple[Path, Path], qtbot: QtBot
) -> None:
    import json

    open_files(viewer, mesh_files[0])
    trigger(viewer, "start")
    wait_until_trained(viewer, qtbot)
    run = viewer.workspace.run
    assert isinstance(run, Run)
    assert is_run_folder(run.folder)
    manifest = json.loads((run.folder / "run.json").read_text())
    (run.folder / "run.json").write_text(json.dumps({**manifest, "state": "running"}))  # as a killed process leaves it
    viewer.workspace.problem = None
    viewer.window.banners.clear()
    viewer.opener.offer_interrupted_run()
    assert viewer.background.wait(20)
    banner = viewer.window.banners.banners()[0]
    assert "interrupted at step 30" in banner.message.text
    assert banner.message.action is not None
    banner.message.action[1]()
    assert viewer.background.wait(20)
    assert viewer.workspace.shown_step == 30


def test_events_of_another_run_are_not_heard(viewer: Controller, trained_run: FakeRun, problem: Problem) -> None:
    show_fake(viewer, trained_run)
    foreign = FakeRun(problem, run_id="other").record(10).snapshot
    viewer.runner.snapshotTaken.emit(foreign)
    assert viewer.workspace.snapshot(10) is trained_run.snapshots[10]


def test_warnings_of_the_run_are_told_once(viewer: Controller, trained_run: FakeRun) -> None:
    from dmp_viewer.runner import Progress

    show_fake(viewer, trained_run)
    trained_run.warnings.append("The disk is full. The training goes on in memory.")
    for step in (41, 42):
        viewer.runner.progressed.emit(Progress("fake", (trained_run.record(step),), 1.0))
    assert viewer.window.banners.texts() == trained_run.warnings


# -- what is remembered -----------------------------------------------------------------------------------------------


def test_layout_and_choices_are_remembered(make_viewer: MakeViewer, trained_run: FakeRun, tmp_path: Path) -> None:
    viewer = make_viewer()
    show_fake(viewer, trained_run)
    for name in ("signed", "edges", "show_curve", "theme_dark"):
        trigger(viewer, name)
    viewer.window.curve.logAxisChanged.emit(False)
    viewer.window.resize(760, 560)
    QApplication.processEvents()
    assert viewer.window.close()
    preferences = load(tmp_path / "window.json")
    assert (preferences.quantity, preferences.edges, preferences.show_curve) == ("signed", True, False)
    assert (preferences.theme, preferences.log_axis) == ("dark", False)
    again = make_viewer(preferences)
    show_fake(again, trained_run)
    assert again.workspace.coloring.quantity == "signed"
    assert (again.window.width(), again.window.height()) == (760, 560)
    assert not again.window.curve.isVisible()
    assert again.window.named_actions["theme_dark"].isChecked()
    trigger(again, "theme_light")


def test_a_window_that_was_on_a_screen_that_is_gone_comes_back(make_viewer: MakeViewer) -> None:
    viewer = make_viewer()
    viewer.window.move(40_000, 40_000)
    geometry, splitters = viewer.window.layout_state()
    again = make_viewer(Preferences(theme="light", geometry=geometry, splitters=splitters))
    screens = [screen.availableGeometry() for screen in QApplication.screens()]
    assert any(screen.intersects(again.window.frameGeometry()) for screen in screens)


def test_opened_files_are_recent_files(viewer: Controller, mesh_files: tuple[Path, Path]) -> None:
    open_files(viewer, mesh_files[0])
    assert viewer.preferences.existing_recent() == [mesh_files[0]]


def test_every_action_answers(
    viewer: Controller, trained_run: FakeRun, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """No menu entry is without effect or raises, whatever the state."""
    for name in ("ask_mesh", "ask_run", "ask_save_mesh", "ask_save_picture"):
        monkeypatch.setattr(dialogs, name, lambda *_: None)
    show_fake(viewer, trained_run)
    for name in viewer.window.named_actions:
        if name not in ("quit", "start"):
            viewer.window.actionTriggered.emit(name)
            viewer.presenter.flush()
    for dialog in viewer.window.findChildren(dialogs.QDialog):
        assert dialog.isVisible()
        dialog.close()
    trigger(viewer, "theme_light")


def test_a_picture_is_saved_where_it_is_wanted(
    viewer: Controller, trained_run: FakeRun, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    show_fake(viewer, trained_run)
    wanted = [tmp_path / "shot.png", tmp_path / "no" / "such" / "shot.png"]
    monkeypatch.setattr(dialogs, "ask_save_picture", lambda *_: wanted.pop(0))
    trigger(viewer, "screenshot")
    assert (tmp_path / "shot.png").stat().st_size > 10_000
    trigger(viewer, "screenshot")
    assert "cannot be written" in viewer.window.banners.texts()[-1]


def test_opened_run_type_is_what_the_library_gives(tmp_path: Path) -> None:
    assert OpenedRun.__dataclass_fields__.keys() == {"run", "problem", "source", "suggestion"}
