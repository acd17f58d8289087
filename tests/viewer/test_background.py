"""Work off the window's thread, and its end with the window."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtWidgets import QApplication

from dmp_viewer.background import Background, close_all
from tests.viewer.driving import MakeViewer, open_files, trigger


@pytest.fixture
def background(qapp: QApplication) -> Background:
    return Background()


def _unexpected(result: object) -> None:
    raise AssertionError(f"reported: {result!r}")


def test_results_and_errors_are_reported_in_order(background: Background) -> None:
    told: list[object] = []
    background.submit("", lambda: 1, told.append, _unexpected)
    background.submit("", lambda: 1 // 0, _unexpected, lambda error: told.append(type(error)))
    assert background.wait(5)
    assert told == [1, ZeroDivisionError]
    background.close()


def test_what_has_not_begun_is_not_begun_once_it_is_closed(background: Background, qtbot: QtBot) -> None:
    begun, go_on, done = threading.Event(), threading.Event(), list[int]()

    def work(number: int) -> None:
        done.append(number)
        begun.set()
        go_on.wait(5)

    for number in range(3):
        background.submit("", lambda number=number: work(number), _unexpected, _unexpected)
    assert begun.wait(5)
    thread = background._thread
    assert thread is not None
    go_on.set()
    background.close()
    assert not thread.is_alive()
    assert done == [0]
    background.submit("", lambda: done.append(7), _unexpected, _unexpected)
    qtbot.wait(50)
    assert done == [0]
    assert not background.is_busy


def test_work_that_hangs_is_left_behind_and_unheard(qtbot: QtBot) -> None:
    several, go_on = [Background() for _ in range(4)], threading.Event()
    for background in several:
        background.submit("", lambda: go_on.wait(20), _unexpected, _unexpected)
    threads = [background._thread for background in several]
    begun = time.monotonic()
    close_all(several, 0.2)
    assert time.monotonic() - begun < 1.0
    for background in several:
        background.deleteLater()
    qtbot.wait(20)
    go_on.set()
    for thread in threads:
        assert thread is not None
        thread.join(5)
        assert not thread.is_alive()
    qtbot.wait(40)  # time to report, if anybody did


@pytest.mark.parametrize("training", [False, True])
def test_no_thread_outlives_a_closed_window(
    make_viewer: MakeViewer, mesh_files: tuple[Path, Path], qtbot: QtBot, training: bool
) -> None:
    before = set(threading.enumerate())
    viewer = make_viewer()
    open_files(viewer, *mesh_files)
    trigger(viewer, "show_runs")
    trigger(viewer, "start")
    qtbot.waitUntil(lambda: len(viewer.workspace.snapshot_steps) > 1, timeout=30_000)
    if not training:
        qtbot.waitUntil(lambda: not viewer.runner.state.is_active, timeout=30_000)
    assert set(threading.enumerate()) > before
    begun = time.monotonic()
    assert viewer.window.close()
    # What comes late must bring nothing to life again.
    viewer.runs.refresh()
    viewer.workspace.run_changed.emit()
    viewer.presenter.refresh_all()
    qtbot.wait(50)
    ours = [thread for thread in threading.enumerate() if thread not in before and thread.name in ("background", "training")]
    assert ours == []
    assert time.monotonic() - begun < 3.0
