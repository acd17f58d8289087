"""When something goes wrong outside the window, it is told in a sentence, and nothing that was learnt is lost."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QPushButton

from dmp.deep_mesh_prior import DeepMeshPrior
from dmp.meshio import read_mesh
from dmp.run_folder import RunFolder
from dmp.runs import Run, list_runs
from dmp_viewer.controller import Controller
from dmp_viewer.saving import save_picture
from dmp_viewer.states import RunnerState
from dmp_viewer.views import dialogs
from tests.viewer.conftest import quick_settings
from tests.viewer.driving import MakeViewer, open_files, trigger, wait_until_trained


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, int]]:
    """A disk whose ``errno``, when set, is the answer to each writing into a run folder."""
    state = {"errno": 0}
    for name in ("write", "append", "make"):
        original = getattr(RunFolder, name)

        def checked(folder: RunFolder, *arguments: object, original: object = original) -> object:
            if state["errno"]:
                raise OSError(state["errno"], os.strerror(state["errno"]), str(folder.path))
            return original(folder, *arguments)  # type: ignore[operator]

        monkeypatch.setattr(RunFolder, name, checked)
    yield state


def press(viewer: Controller, qtbot: QtBot, text: str) -> None:
    """Click the button of a message."""
    buttons = [button for banner in viewer.window.banners.banners() for button in banner.findChildren(QPushButton)]
    qtbot.mouseClick(next(button for button in buttons if button.text() == text), Qt.MouseButton.LeftButton)
    assert viewer.background.wait(20)
    viewer.presenter.flush()


def told(viewer: Controller, words: str) -> bool:
    return any(words in text for text in viewer.window.banners.texts())


def begin(viewer: Controller, qtbot: QtBot, mesh: Path, *, until: int = 8, **settings: object) -> Run:
    """Open a mesh, start a long training, and wait until it has made some steps."""
    open_files(viewer, mesh)
    viewer.window.panel.set_settings(quick_settings(**{"steps": 100_000, **settings}))
    qtbot.mouseClick(viewer.window.panel.button("start"), Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: viewer.workspace.current_step >= until, timeout=20_000)
    run = viewer.workspace.run
    assert isinstance(run, Run)
    return run


def end(viewer: Controller, qtbot: QtBot) -> None:
    qtbot.mouseClick(viewer.window.panel.button("stop"), Qt.MouseButton.LeftButton)
    wait_until_trained(viewer, qtbot)


# -- disks and folders ------------------------------------------------------------------------------------------------


def test_a_full_disk_is_told_and_saving_elsewhere_works(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path], disk: dict[str, int], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    run = begin(viewer, qtbot, mesh_files[0])
    disk["errno"] = errno.ENOSPC
    reached = viewer.workspace.current_step
    qtbot.waitUntil(lambda: viewer.workspace.current_step > reached + 12, timeout=20_000)
    qtbot.waitUntil(lambda: told(viewer, "the disk is full"))
    assert len(viewer.window.banners.banners()) == 1
    end(viewer, qtbot)
    assert viewer.window.panel.state_text == "Stopped"
    last = viewer.workspace.snapshot_steps[-1]
    assert last > reached
    monkeypatch.setattr(dialogs, "ask_save_mesh", lambda *_: tmp_path / "elsewhere.ply")
    trigger(viewer, "save_shown")
    assert np.array_equal(read_mesh(tmp_path / "elsewhere.ply").vertices, run.mesh_at(last).vertices)
    # A step can be kept, and once there is room everything is written.
    trigger(viewer, "keep")
    assert viewer.workspace.kept_step == last
    disk["errno"] = 0
    trigger(viewer, "proceed")
    qtbot.waitUntil(lambda: viewer.workspace.current_step > last + 6, timeout=20_000)
    qtbot.waitUntil(lambda: told(viewer, "nothing is missing"))
    end(viewer, qtbot)
    opened = Run.open(run.folder)
    assert opened.kept_step == last
    assert opened.snapshot_steps() == viewer.workspace.snapshot_steps


def test_what_is_in_memory_only_is_not_let_go_without_a_question(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path], disk: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    begin(viewer, qtbot, mesh_files[0])
    disk["errno"] = errno.ENOSPC
    # The training may stand at a step just now that is written already.
    reached = viewer.workspace.current_step
    qtbot.waitUntil(lambda: viewer.workspace.current_step > reached + 6, timeout=20_000)
    end(viewer, qtbot)
    questions: list[str] = []
    answers = [False, False, True]
    monkeypatch.setattr(dialogs, "confirm", lambda _parent, text, *_: bool(questions.append(text)) or answers.pop(0))
    run = viewer.workspace.run
    viewer.opener.open_path(mesh_files[1])
    assert viewer.background.wait(20)
    assert viewer.workspace.run is run
    assert not viewer.window.close()
    assert viewer.window.isVisible()
    assert viewer.window.close()
    assert len(questions) == 3
    assert all("could not be written" in text for text in questions)


def test_a_folder_for_runs_that_cannot_be_written_is_no_obstacle(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path], disk: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    disk["errno"] = errno.EROFS
    open_files(viewer, mesh_files[0])
    trigger(viewer, "start")
    wait_until_trained(viewer, qtbot)
    assert viewer.window.panel.state_text == "Finished"
    assert viewer.workspace.snapshot_steps == [0, 5, 10, 15, 20, 25, 30]
    assert told(viewer, "the disk is read-only")
    trigger(viewer, "first_step")
    assert viewer.workspace.shown_step == 0
    monkeypatch.setattr(dialogs, "confirm", lambda *_: True)


def test_a_folder_that_vanishes_while_training_is_told(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = begin(viewer, qtbot, mesh_files[0])
    # At rest and in one go: deleting file by file races with the writing, and either side may win.
    viewer.runner.pause()
    qtbot.wait(150)
    run.folder.rename(run.folder.with_name("elsewhere"))
    viewer.runner.resume()
    qtbot.waitUntil(lambda: told(viewer, "it is no longer there"), timeout=60_000)
    end(viewer, qtbot)
    assert viewer.workspace.shown_step == viewer.workspace.snapshot_steps[-1]
    monkeypatch.setattr(dialogs, "confirm", lambda *_: True)


def test_an_input_that_is_deleted_while_training_is_told(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path]
) -> None:
    run = begin(viewer, qtbot, mesh_files[0])
    mesh_files[0].unlink()
    qtbot.waitUntil(lambda: told(viewer, "scan.ply is no longer there"), timeout=20_000)
    end(viewer, qtbot)
    open_files(viewer, run.folder)
    assert told(viewer, "scan.ply is no longer there. The run has a copy of its own")
    assert viewer.workspace.controls.proceed


# -- numbers ----------------------------------------------------------------------------------------------------------


def test_numbers_that_are_none_end_the_training_and_keep_its_snapshots(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    update = DeepMeshPrior._update

    def spoilt(training: DeepMeshPrior) -> object:
        if training.step == 12:
            training._target[0] = float("nan")
        return update(training)

    monkeypatch.setattr(DeepMeshPrior, "_update", spoilt)
    open_files(viewer, mesh_files[0])
    trigger(viewer, "start")
    wait_until_trained(viewer, qtbot)
    assert viewer.runner.state is RunnerState.FAILED
    assert viewer.window.panel.state_text == "Failed"
    assert told(viewer, "at step 13: the loss is nan. Snapshots of earlier steps are good.")
    assert viewer.workspace.snapshot_steps == [0, 5, 10]
    trigger(viewer, "previous_step")
    assert viewer.workspace.shown_step == 5
    run = viewer.workspace.run
    assert isinstance(run, Run)
    open_files(viewer, run.folder)
    assert told(viewer, "This run failed. The training left the range of numbers at step 13")
    monkeypatch.undo()
    trigger(viewer, "proceed")
    wait_until_trained(viewer, qtbot)
    assert viewer.window.panel.state_text == "Finished"
    assert Run.open(run.folder).reason == ""


# -- kills ------------------------------------------------------------------------------------------------------------


def killed_runs(viewer: Controller, qtbot: QtBot, mesh: Path, folder: Path, count: int) -> list[Path]:
    """Leave runs behind as a killed window does: a copy of the folder in the middle of a training."""
    left = []
    for number in range(count):
        run = begin(viewer, qtbot, mesh, steps=40 + number)
        left.append(folder / f"killed{number}")
        viewer.runner.pause()
        qtbot.wait(150)
        shutil.copytree(run.folder, left[-1])
        viewer.runner.resume()
        wait_until_trained(viewer, qtbot)
        shutil.rmtree(run.folder)
    return left


def test_the_next_start_offers_to_go_on_and_goes_on(
    make_viewer: MakeViewer, qtbot: QtBot, mesh_files: tuple[Path, Path], tmp_path: Path
) -> None:
    first = make_viewer()
    (killed,) = killed_runs(first, qtbot, mesh_files[0], tmp_path / "runs", 1)
    assert Run.open(killed).state == "interrupted"
    reached = Run.open(killed).last_step
    viewer = make_viewer()
    viewer.opener.offer_interrupted_run()
    assert viewer.background.wait(20)
    assert told(viewer, f"The training of scan, {Run.open(killed).created[:10]}")
    assert told(viewer, f"was interrupted at step {reached}. Nothing before it is lost.")
    press(viewer, qtbot, "Continue")
    qtbot.waitUntil(lambda: viewer.workspace.current_step > reached, timeout=20_000)
    wait_until_trained(viewer, qtbot)
    assert viewer.window.panel.state_text == "Finished"
    # As if nothing had happened: the same as the first window, which went on, has.
    assert first.workspace.curve.rows[-1]["data_loss"] == viewer.workspace.curve.rows[-1]["data_loss"]
    assert [row["step"] for row in viewer.workspace.curve.rows] == list(range(41))


def test_a_notice_that_is_discarded_does_not_come_back_and_the_run_stays(
    make_viewer: MakeViewer, qtbot: QtBot, mesh_files: tuple[Path, Path], tmp_path: Path
) -> None:
    killed = killed_runs(make_viewer(), qtbot, mesh_files[0], tmp_path / "runs", 2)
    viewer = make_viewer()
    viewer.opener.offer_interrupted_run()
    assert viewer.background.wait(20)
    assert told(viewer, "One more was interrupted, too.")
    for left in (1, 0):
        press(viewer, qtbot, "Discard notice")
        qtbot.waitUntil(lambda left=left: len(viewer.window.banners.banners()) == left)  # type: ignore[misc]
    again = make_viewer()
    again.opener.offer_interrupted_run()
    assert again.background.wait(20)
    assert again.window.banners.banners() == []
    assert {run.folder for run in list_runs(tmp_path / "runs")} == set(killed)
    assert all(run.state == "stopped" for run in list_runs(tmp_path / "runs"))


# -- pictures ---------------------------------------------------------------------------------------------------------


def test_a_picture_that_cannot_be_written_leaves_the_old_one(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    open_files(viewer, mesh_files[0])
    path = tmp_path / "window.png"
    monkeypatch.setattr(dialogs, "ask_save_picture", lambda *_: path)
    trigger(viewer, "screenshot")
    old = path.read_bytes()
    assert old.startswith(b"\x89PNG")

    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        trigger(viewer, "screenshot")
    assert told(viewer, "the picture cannot be written because the disk is full")
    assert path.read_bytes() == old
    assert [item.name for item in tmp_path.iterdir() if item.name.startswith(".")] == []


def test_pictures_take_the_format_of_their_name(viewer: Controller, tmp_path: Path) -> None:
    picture = viewer.window.grab()
    for name, magic in (
        ("a.png", b"\x89PNG"),
        ("a.JPG", b"\xff\xd8"),
        ("a.bmp", b"BM"),
        ("a", b"\x89PNG"),
        ("a.xyz", b"\x89PNG"),
    ):
        save_picture(picture, tmp_path / name)
        assert (tmp_path / name).read_bytes().startswith(magic)
