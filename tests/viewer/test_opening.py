"""Opening meshes, ground truths, runs and samples in the real window, and what is told when that fails."""

from __future__ import annotations

from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QMimeData, QPoint, QPointF, Qt, QUrl
from qtpy.QtGui import QDragEnterEvent, QDropEvent
from qtpy.QtWidgets import QApplication

from dmp.mesh import TriangleMesh
from dmp.meshio import write_mesh
from dmp.problem import Problem
from dmp.runs import Run, is_run_folder
from dmp_viewer.controller import Controller
from dmp_viewer.views import dialogs
from dmp_viewer.views.mesh_panes import INPUT
from tests.viewer.conftest import FakeRun, quick_settings
from tests.viewer.driving import open_files, show_fake, trigger, wait_until_trained


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
    manifest["state"] = "running"  # as a process leaves it that is killed with half of its steps done
    manifest["settings"]["steps"] = 60
    (run.folder / "run.json").write_text(json.dumps(manifest))
    viewer.workspace.problem = None
    viewer.window.banners.clear()
    viewer.opener.offer_interrupted_run()
    assert viewer.background.wait(20)
    banner = viewer.window.banners.banners()[0]
    assert "interrupted at step 30" in banner.message.text
    assert banner.message.action is not None
    banner.message.action[1]()
    assert viewer.background.wait(20)
    wait_until_trained(viewer, qtbot)
    assert viewer.workspace.shown_step == 60


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
