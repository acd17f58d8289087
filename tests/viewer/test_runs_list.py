"""The list of runs in the real window."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt
from qtpy.QtGui import QDesktopServices
from qtpy.QtWidgets import QApplication, QLineEdit

from dmp.mesh import TriangleMesh
from dmp.problem import denoising
from dmp.runs import Run
from dmp.settings import Settings
from dmp_viewer import runs_control, runs_trash
from dmp_viewer.controller import Controller
from dmp_viewer.runs_pictures import cache_folder
from dmp_viewer.tasks import continue_session
from dmp_viewer.views import dialogs
from dmp_viewer.views.runs_list import RunsList
from tests.viewer.conftest import quick_settings
from tests.viewer.driving import open_files, trigger, wait_until_trained

MakeRun = Callable[..., Run]


@pytest.fixture
def make_run(tmp_path: Path, noisy_sphere: TriangleMesh) -> MakeRun:
    """Return a maker of runs where the window looks for them; by default trained for 2 of 2 steps."""

    def make(name: str, *, until: int = 2, **changes: object) -> Run:
        settings: Settings = quick_settings(**{"steps": 2, "snapshot_every": 1, **changes})
        run = Run.create(denoising(noisy_sphere, settings), settings, folder=tmp_path / "runs" / name, name=name)
        if until:
            records = continue_session(run).records
            for item in records:
                if item.step == until and until < settings.steps:
                    break
            records.close()  # type: ignore[attr-defined]
        return run

    return make


def show_list(viewer: Controller) -> RunsList:
    """Bring the list into sight and wait until it is read and drawn."""
    if not viewer.window.runs.isVisible():
        trigger(viewer, "show_runs")
    settle(viewer)
    return viewer.window.runs.list


def settle(viewer: Controller) -> None:
    # What comes in one turn may ask for more in the next: a row that is drawn wants its picture.
    for _ in range(3):
        QApplication.processEvents()
        assert viewer.runs.wait(20)
        assert viewer.background.wait(20)
    viewer.presenter.flush()
    QApplication.processEvents()


def titles(viewer: Controller) -> list[str]:
    return [row.title for row in viewer.window.runs.list.rows()]


def possible(viewer: Controller) -> set[str]:
    actions = viewer.window.named_actions
    return {name.removeprefix("listed_") for name in actions if name.startswith("listed_") and actions[name].isEnabled()}


def test_an_empty_list_says_what_will_be_there(viewer: Controller) -> None:
    show_list(viewer)
    assert "No runs yet" in viewer.window.runs._nothing.text()
    assert viewer.window.runs._nothing.isVisible()
    assert possible(viewer) == set()
    trigger(viewer, "show_runs")
    assert not viewer.window.runs.isVisible()


def test_runs_are_searched_and_what_was_chosen_stays_chosen(viewer: Controller, make_run: MakeRun) -> None:
    for name in ("bunny", "horse"):
        make_run(name, until=0)
    shown, dock = show_list(viewer), viewer.window.runs
    assert sorted(titles(viewer)) == ["bunny", "horse"]
    shown.choose(viewer.runs.folder / "horse")
    dock.search.setText("BUN begun")
    assert titles(viewer) == ["bunny"]
    assert dock._count.text() == "1 of 2"
    dock.search.setText("elephant")
    assert dock._nothing.isVisible()
    assert "all of these words" in dock._nothing.text()
    dock.search.clear()
    assert sorted(titles(viewer)) == ["bunny", "horse"]


def test_what_can_be_done_depends_on_what_is_chosen(viewer: Controller, make_run: MakeRun) -> None:
    done, begun = make_run("done"), make_run("begun", until=1, steps=9)
    broken = viewer.runs.folder / "broken"
    broken.mkdir()
    (broken / "run.json").write_text("{}")
    shown = show_list(viewer)
    shown.choose(done.folder)
    assert possible(viewer) == {"open", "settings", "rename", "reveal", "trash"}
    shown.choose(begun.folder)
    assert possible(viewer) == {"open", "proceed", "settings", "queue", "rename", "reveal", "trash"}
    shown.choose(done.folder, begun.folder)
    assert possible(viewer) == {"queue", "trash"}
    shown.choose(broken)
    assert possible(viewer) == {"reveal", "trash"}
    open_files(viewer, done.folder)
    settle(viewer)
    shown.choose(done.folder)
    assert "open" not in possible(viewer)
    shown.choose(begun.folder)
    assert {"compare", "queue_settings"} <= possible(viewer)


def test_a_picture_is_drawn_once_and_kept(viewer: Controller, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch) -> None:
    run = make_run("ball")
    shown = show_list(viewer)

    def pixels() -> np.ndarray:
        image = shown.viewport().grab().toImage()
        bright = [[image.pixelColor(x, y).lightness() for x in range(10, 90)] for y in range(10, 66)]
        return np.array(bright)

    # A ball: filled in the middle, the ground of the frame in its corners.
    found = pixels()
    assert abs(int(found[28, 40]) - int(found[3, 4])) > 25
    (file,) = cache_folder().glob("*.png")
    assert file.name == f"{run.run_id}_2_y.png"

    def unexpected(*_: object) -> None:
        raise AssertionError("The picture is there already.")

    monkeypatch.setattr("dmp_viewer.runs_pictures.thumbnail", unexpected)
    viewer.runs.pictures._pictures.clear()
    shown.viewport().update()
    QApplication.processEvents()
    settle(viewer)
    assert np.array_equal(pixels(), found)


def test_enter_opens_and_f2_renames(viewer: Controller, qtbot: QtBot, make_run: MakeRun) -> None:
    run = make_run("scan")
    shown = show_list(viewer)
    shown.setFocus()
    shown.choose(run.folder)
    qtbot.keyClick(shown, Qt.Key.Key_F2)
    editor = shown.findChild(QLineEdit)
    assert editor is not None
    assert editor.text() == "scan"
    qtbot.keyClicks(editor, "My scan")
    qtbot.keyClick(editor, Qt.Key.Key_Return)
    settle(viewer)
    assert titles(viewer) == ["My scan"]
    assert Run.open(run.folder).name == "My scan"
    assert viewer.workspace.run is None
    shown.setFocus()
    qtbot.keyClick(shown, Qt.Key.Key_Return)
    settle(viewer)
    assert viewer.workspace.run is not None
    assert viewer.workspace.run.run_id == run.run_id
    assert "on show" in _row_text(viewer)


def _row_text(viewer: Controller) -> str:
    painter = viewer.window.runs.list._painter
    return "on show" if painter.shown == viewer.window.runs.list.rows()[0].folder else ""


def test_a_run_in_training_is_renamed_without_being_disturbed(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path]
) -> None:
    open_files(viewer, mesh_files[0])
    show_list(viewer)
    viewer.window.panel.set_settings(quick_settings(steps=5000, snapshot_every=10))
    trigger(viewer, "start")
    qtbot.waitUntil(lambda: viewer.workspace.current_step >= 12, timeout=20_000)
    qtbot.waitUntil(lambda: any(row.state == "running" for row in viewer.window.runs.all_rows), timeout=10_000)
    (row,) = viewer.window.runs.all_rows
    viewer.window.runs.list.renamed.emit(row.folder, "while it learns")
    settle(viewer)
    trigger(viewer, "stop")
    wait_until_trained(viewer, qtbot)
    settle(viewer)
    assert Run.open(row.folder).name == "while it learns"
    (row,) = viewer.window.runs.all_rows
    assert row.title == "while it learns"
    assert row.state == "stopped"
    assert viewer.window.banners.texts() == []


def test_a_run_goes_to_the_trash_and_comes_back(viewer: Controller, qtbot: QtBot, make_run: MakeRun) -> None:
    Path(os.environ["XDG_DATA_HOME"]).mkdir()
    run, other = make_run("scan"), make_run("other", until=0)
    open_files(viewer, run.folder)
    shown = show_list(viewer)
    shown.setFocus()
    shown.choose(run.folder)
    before = sorted(path.relative_to(run.folder) for path in run.folder.rglob("*"))
    qtbot.keyClick(shown, Qt.Key.Key_Delete)
    settle(viewer)
    assert not run.folder.exists()
    assert titles(viewer) == ["other"]
    # Its mesh stays open, the run does not.
    assert viewer.workspace.run is None
    assert viewer.workspace.problem is not None
    (banner,) = viewer.window.banners.banners()
    assert banner.message.text == "“scan” was moved to the trash."
    assert banner.message.action is not None
    banner.message.action[1]()
    settle(viewer)
    assert sorted(titles(viewer)) == ["other", "scan"]
    assert sorted(path.relative_to(run.folder) for path in run.folder.rglob("*")) == before
    assert other.folder.exists()


@pytest.mark.parametrize("agreed", [False, True])
def test_where_there_is_no_trash_nothing_goes_without_a_yes(
    viewer: Controller, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch, agreed: bool
) -> None:
    run = make_run("scan", until=0)
    (run.folder / "mine.txt").write_text("mine")
    monkeypatch.setattr(runs_trash.QFile, "moveToTrash", lambda _file: False)
    asked: list[str] = []
    monkeypatch.setattr(dialogs, "confirm", lambda _parent, text, *_: bool(asked.append(text)) or agreed)
    show_list(viewer).choose(run.folder)
    trigger(viewer, "listed_trash")
    settle(viewer)
    assert asked == ["There is no trash for the disk that “scan” is on. Delete for good?"]
    assert (run.folder / "run.json").exists() is not agreed
    assert (run.folder / "mine.txt").exists()
    assert titles(viewer) == ([] if agreed else ["scan"])


def test_settings_are_copied_to_the_next_training(viewer: Controller, make_run: MakeRun, mesh_files: tuple[Path, Path]) -> None:
    run = make_run("scan", until=0, laplacian_weight=3.0, seed=9)
    open_files(viewer, mesh_files[0])
    show_list(viewer).choose(run.folder)
    trigger(viewer, "listed_settings")
    assert viewer.window.panel.settings() == run.settings
    assert viewer.workspace.run is None
    (banner,) = viewer.window.banners.banners()
    assert banner.message.action is not None
    assert banner.message.action[0] == "Start"


def test_a_run_is_compared_and_its_folder_shown(viewer: Controller, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = make_run("first"), make_run("second", seed=7)
    open_files(viewer, first.folder)
    show_list(viewer).choose(second.folder)
    trigger(viewer, "listed_compare")
    settle(viewer)
    assert viewer.workspace.comparison.other is not None
    assert viewer.workspace.comparison.other.run_id == second.run_id
    opened: list[str] = []
    monkeypatch.setattr(QDesktopServices, "openUrl", lambda url: bool(opened.append(url.toLocalFile())))
    monkeypatch.setattr(runs_control, "QDesktopServices", QDesktopServices)
    trigger(viewer, "listed_reveal")
    assert opened == [str(second.folder)]
    assert str(second.folder) in viewer.window.banners.texts()[-1]


def test_continue_goes_on_with_the_chosen_run(viewer: Controller, qtbot: QtBot, make_run: MakeRun) -> None:
    run = make_run("scan", until=1, steps=6)
    show_list(viewer).choose(run.folder)
    trigger(viewer, "listed_proceed")
    settle(viewer)
    wait_until_trained(viewer, qtbot)
    settle(viewer)
    assert Run.open(run.folder).state == "finished"
    (row,) = viewer.window.runs.all_rows
    assert row.state_text == "Finished, 6 steps"


def test_the_menu_of_a_run_opens_where_the_mouse_is(viewer: Controller, make_run: MakeRun) -> None:
    run = make_run("scan", until=0)
    shown = show_list(viewer)
    shown.choose(run.folder)
    shown.customContextMenuRequested.emit(QPoint(20, 20))
    assert viewer.window.runs.menu.isVisible()
    assert {action.objectName() for action in viewer.window.runs.menu.actions() if not action.isSeparator()} == {
        name for name in viewer.window.named_actions if name.startswith("listed_")
    }
    viewer.window.runs.menu.close()
