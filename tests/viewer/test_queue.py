"""Trainings that wait for each other, in the real window."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QModelIndex, Qt

from dmp.mesh import TriangleMesh
from dmp.meshio import write_mesh
from dmp.problem import denoising
from dmp.runs import Run, list_runs
from dmp_viewer import queue_control, tasks
from dmp_viewer.controller import Controller
from dmp_viewer.queue_model import saved_queue
from dmp_viewer.runner import Session
from dmp_viewer.states import RunnerState
from dmp_viewer.views import dialogs
from tests.viewer.conftest import quick_settings
from tests.viewer.driving import MakeViewer, open_files, trigger, wait_until_trained


@pytest.fixture
def opened(viewer: Controller, mesh_files: tuple[Path, Path]) -> Controller:
    """A window with a mesh."""
    open_files(viewer, mesh_files[0])
    return viewer


def add(viewer: Controller, **changes: object) -> Path:
    """Let a training of the open mesh wait; returns its folder."""
    viewer.window.panel.set_settings(quick_settings(**{"steps": 6, **changes}))
    trigger(viewer, "queue_add")
    assert viewer.background.wait(20)
    viewer.presenter.flush()
    return viewer.queue.queue.items[-1].folder


def waiting(viewer: Controller) -> list[Path]:
    return [item.folder for item in viewer.queue.queue.items]


def wait_until_empty(viewer: Controller, qtbot: QtBot) -> None:
    qtbot.waitUntil(lambda: not waiting(viewer) and not viewer.runner.state.is_active, timeout=60_000)
    viewer.presenter.flush()


def test_two_settings_are_trained_one_after_another(opened: Controller, qtbot: QtBot) -> None:
    first, second = add(opened, seed=1), add(opened, seed=2)
    assert opened.window.runs.queue.isVisible()
    assert opened.window.runs.queue.status == "2 waiting, held"
    assert opened.runner.state is RunnerState.IDLE
    assert [Run.open(folder).state for folder in (first, second)] == ["stopped", "stopped"]
    shown: list[str] = []
    opened.workspace.run_changed.connect(lambda: shown.append(opened.workspace.run.run_id))
    trigger(opened, "queue_go")
    wait_until_empty(opened, qtbot)
    assert [Run.open(folder).state for folder in (first, second)] == ["finished", "finished"]
    assert shown == [Run.open(folder).run_id for folder in (first, second)]
    assert [Run.open(folder).settings.seed for folder in (first, second)] == [1, 2]
    assert not opened.queue.queue.is_on
    # The last one is on show, on the mesh that was open all the time.
    assert opened.workspace.snapshot_steps == [0, 5, 6]
    assert opened.workspace.source is not None
    assert opened.workspace.source.name == "scan"


def test_what_is_added_during_a_training_comes_after_it(opened: Controller, qtbot: QtBot) -> None:
    opened.window.panel.set_settings(quick_settings(steps=40, snapshot_every=10))
    trigger(opened, "start")
    qtbot.waitUntil(lambda: opened.workspace.run is not None, timeout=20_000)
    begun = opened.workspace.run
    assert begun is not None
    button = opened.window.panel.button("queue_add")
    opened.window.panel.set_settings(quick_settings(steps=6, seed=5))
    opened.presenter.flush()
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)
    assert opened.background.wait(20)
    assert len(waiting(opened)) == 1 or not opened.runner.state.is_active
    wait_until_empty(opened, qtbot)
    assert Run.open(begun.folder).state == "finished"
    assert opened.workspace.run is not None
    assert opened.workspace.run.settings.seed == 5
    assert opened.workspace.run.state == "finished"


def test_what_is_added_just_before_a_training_ends_comes_after_it(
    opened: Controller, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    has_ended, make = threading.Event(), tasks.waiting_run

    def made_late(*given: Any) -> Run:
        assert has_ended.wait(20)
        return make(*given)

    monkeypatch.setattr(tasks, "waiting_run", made_late)
    opened.window.panel.set_settings(quick_settings(steps=40, snapshot_every=10))
    trigger(opened, "start")
    qtbot.waitUntil(lambda: opened.runner.state is RunnerState.RUNNING, timeout=20_000)
    opened.window.panel.set_settings(quick_settings(steps=6, seed=5))
    opened.presenter.flush()
    trigger(opened, "queue_add")
    qtbot.waitUntil(lambda: not opened.runner.state.is_active, timeout=20_000)
    has_ended.set()
    assert opened.background.wait(20)
    wait_until_empty(opened, qtbot)
    assert opened.workspace.run is not None
    assert opened.workspace.run.settings.seed == 5
    assert opened.workspace.run.state == "finished"


def test_the_order_can_be_changed_and_one_taken_out(opened: Controller, qtbot: QtBot) -> None:
    first, second, third = (add(opened, seed=seed) for seed in (1, 2, 3))
    queue = opened.window.runs.queue
    queue.choose(third)
    trigger(opened, "queue_up")
    trigger(opened, "queue_up")
    assert waiting(opened) == queue.folders() == [third, first, second]
    assert queue.chosen() == third
    assert not opened.window.named_actions["queue_up"].isEnabled()
    trigger(opened, "queue_down")
    assert waiting(opened) == [first, third, second]
    assert saved_queue(opened.runs.folder) == waiting(opened)
    # What dragging the last row to the top does.
    assert queue.rows.model().moveRow(QModelIndex(), 2, QModelIndex(), 0)
    qtbot.waitUntil(lambda: waiting(opened) == [second, first, third])
    assert queue.folders() == [second, first, third]
    queue.choose(first)
    queue.rows.setFocus()
    qtbot.keyClick(queue.rows, Qt.Key.Key_Delete)
    assert opened.background.wait(20)
    assert waiting(opened) == [second, third]
    # It had learnt nothing, so nothing of it is left.
    assert not first.exists()


def test_a_run_with_steps_left_waits_and_stays_when_it_is_taken_out(
    opened: Controller, qtbot: QtBot, tmp_path: Path, noisy_sphere: TriangleMesh
) -> None:
    settings = quick_settings(steps=40, snapshot_every=10)
    opened.window.panel.set_settings(settings)
    trigger(opened, "start")
    qtbot.waitUntil(lambda: opened.workspace.current_step >= 4, timeout=20_000)
    trigger(opened, "stop")
    wait_until_trained(opened, qtbot)
    run = opened.workspace.run
    assert isinstance(run, Run)
    opened.window.show_runs()
    assert opened.runs.wait(20)
    opened.window.runs.list.choose(run.folder)
    trigger(opened, "listed_queue")
    assert waiting(opened) == [run.folder]
    trigger(opened, "queue_remove")
    assert opened.background.wait(20)
    assert run.folder.exists()
    trigger(opened, "listed_queue")
    trigger(opened, "queue_go")
    wait_until_empty(opened, qtbot)
    assert Run.open(run.folder).state == "finished"


def test_stopping_holds_the_queue(opened: Controller, qtbot: QtBot) -> None:
    first, second = add(opened, steps=100_000, snapshot_every=1000), add(opened)
    trigger(opened, "queue_go")
    qtbot.waitUntil(lambda: opened.workspace.current_step >= 2, timeout=20_000)
    assert opened.window.runs.queue.status == "1 waiting, next after this one"
    trigger(opened, "stop")
    wait_until_trained(opened, qtbot)
    qtbot.wait(50)
    assert not opened.runner.state.is_active
    assert waiting(opened) == [second]
    assert Run.open(first).state == "stopped"
    (banner,) = opened.window.banners.banners()
    assert banner.message.text == "The training was stopped, so the queue waits."
    assert banner.message.action is not None
    banner.message.action[1]()
    wait_until_empty(opened, qtbot)
    assert Run.open(second).state == "finished"


def test_one_that_cannot_be_trained_is_told_and_passed_over(opened: Controller, qtbot: QtBot) -> None:
    first, second = add(opened, seed=1), add(opened, seed=2)
    (first / "base.npy").write_bytes(b"broken")
    trigger(opened, "queue_go")
    qtbot.waitUntil(lambda: waiting(opened) == [first] and not opened.runner.state.is_active, timeout=60_000)
    assert Run.open(second).state == "finished"
    assert any("base.npy" in text for text in opened.window.banners.texts())
    assert opened.queue.queue.items[0].problem
    assert not opened.queue.queue.is_on


def test_a_waiting_training_of_another_mesh_brings_its_mesh(
    opened: Controller, qtbot: QtBot, tmp_path: Path, cube: TriangleMesh
) -> None:
    add(opened, seed=1)
    write_mesh(tmp_path / "cube.ply", cube)
    open_files(opened, tmp_path / "cube.ply")
    assert opened.workspace.source is not None
    assert opened.workspace.source.name == "cube"
    trigger(opened, "queue_go")
    wait_until_empty(opened, qtbot)
    assert opened.workspace.source.name == "scan"
    assert opened.workspace.problem is not None
    assert opened.workspace.problem.mesh.n_vertices == 258
    assert "scan.ply" in opened.window.panes.titles[0].texts[1]


@pytest.mark.parametrize("agreed", [False, True])
def test_what_waits_is_asked_about_at_the_end_and_offered_at_the_next_start(
    make_viewer: MakeViewer,
    qtbot: QtBot,
    mesh_files: tuple[Path, Path],
    monkeypatch: pytest.MonkeyPatch,
    agreed: bool,
) -> None:
    viewer = make_viewer()
    open_files(viewer, mesh_files[0])
    folders = [add(viewer, seed=1), add(viewer, seed=2)]
    asked: list[str] = []
    monkeypatch.setattr(dialogs, "confirm", lambda _parent, text, *_: bool(asked.append(text)) or agreed)
    assert viewer.window.close() is agreed
    assert asked == ["2 trainings wait in the queue. Close all the same?"]
    assert waiting(viewer) == folders
    viewer.leave()  # after the second answer; the other window was closed by the first one
    again = make_viewer()
    again.queue.offer_kept()
    assert again.background.wait(20)
    (banner,) = again.window.banners.banners()
    assert banner.message.text == "2 trainings wait in the queue since last time."
    assert waiting(again) == folders
    assert banner.message.action is not None
    banner.message.action[1]()
    wait_until_empty(again, qtbot)
    assert [run.state for run in list_runs(again.runs.folder)] == ["finished", "finished"]
    assert saved_queue(again.runs.folder) == []


def test_what_waits_is_trained_where_the_panel_says(opened: Controller, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[Path, str]] = []

    def elsewhere(run: Run, address: str) -> Session:
        asked.append((run.folder, address))
        return tasks.continue_session(run)

    monkeypatch.setattr(queue_control.remote, "continue_session", elsewhere)
    monkeypatch.setattr(type(opened.remote), "address", property(lambda _self: "elsewhere:8786"))
    folder = add(opened)
    trigger(opened, "queue_go")
    wait_until_empty(opened, qtbot)
    assert asked == [(folder, "elsewhere:8786")]
    assert Run.open(folder).state == "finished"


def test_settings_that_cannot_work_leave_no_empty_run(opened: Controller) -> None:
    opened.queue.add_settings(quick_settings(device="cuda:77"))
    assert opened.background.wait(20)
    assert waiting(opened) == []
    assert list_runs(opened.runs.folder) == []
    assert "cuda:77" in opened.window.banners.texts()[0]


def test_listed_settings_wait_for_the_open_mesh(opened: Controller, tmp_path: Path, cube: TriangleMesh, qtbot: QtBot) -> None:
    make: Callable[..., Run] = Run.create
    for seed in (11, 12):
        settings = quick_settings(steps=6, seed=seed)
        make(denoising(cube, settings), settings, folder=opened.runs.folder / str(seed), name=f"cube {seed}")
    opened.window.show_runs()
    assert opened.runs.wait(20)
    opened.window.runs.list.choose(*(row.folder for row in opened.window.runs.all_rows))
    trigger(opened, "listed_queue_settings")
    assert opened.background.wait(20)
    runs = [Run.open(folder) for folder in waiting(opened)]
    assert sorted(run.settings.seed for run in runs) == [11, 12]
    assert {run.mesh_size for run in runs} == {(258, 512)}
