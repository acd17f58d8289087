"""Smooth window or fast training: that the choice changes what it says."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt, QTimer

from dmp.meshio import write_mesh
from dmp.settings import settings_for
from dmp.snapshot import StepRecord
from dmp_viewer.controller import Controller
from dmp_viewer.memory_use import device_memory, memory_text, process_memory, size_text
from dmp_viewer.pace import Courtesy, Pace
from dmp_viewer.runner import Runner, Session
from dmp_viewer.settings import load
from tests.meshes import grid_mesh
from tests.viewer.conftest import FakeRun, quick_settings
from tests.viewer.driving import MakeViewer, open_files, trigger, wait_until_trained

_NEVER: Callable[[], bool] = lambda: False  # noqa: E731


def test_nobody_rests_unless_asked() -> None:
    assert Courtesy().rest(_NEVER) < 0.05


def test_a_rest_ends_a_moment_after_the_last_movement() -> None:
    courtesy = Courtesy()
    courtesy.ask()
    assert 0.2 < courtesy.rest(_NEVER) < 0.6


def test_who_works_for_long_gets_a_step_a_second() -> None:
    courtesy, over = Courtesy(), threading.Event()

    def work() -> None:
        while not over.wait(0.02):
            courtesy.ask()

    hand = threading.Thread(target=work)
    courtesy.ask()
    hand.start()
    try:
        assert 0.9 < courtesy.rest(_NEVER) < 1.5
    finally:
        over.set()
        hand.join()


def test_stopping_ends_a_rest_at_once_and_a_fast_training_takes_none() -> None:
    courtesy = Courtesy()
    courtesy.ask()
    assert courtesy.rest(lambda: True) < 0.05
    courtesy.pace = Pace.FAST
    assert courtesy.rest(_NEVER) < 0.05


@pytest.mark.skipif(sys.platform != "linux", reason="only on Linux does niceness belong to a single thread")
def test_only_the_thread_of_a_smooth_training_is_lowered() -> None:
    def niceness(pace: Pace) -> int:
        courtesy, found = Courtesy(), []
        courtesy.pace = pace

        def measure() -> None:
            courtesy.keep_priority()
            found.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))

        thread = threading.Thread(target=measure)
        thread.start()
        thread.join()
        return found[0]

    before = os.getpriority(os.PRIO_PROCESS, 0)
    assert niceness(Pace.FAST) == before
    assert niceness(Pace.SMOOTH) == max(5, before)
    assert os.getpriority(os.PRIO_PROCESS, 0) == before


def test_news_come_often_or_once_a_second(qtbot: QtBot, fake_run: FakeRun) -> None:
    def records() -> Iterator[StepRecord]:
        for record in fake_run.records():
            time.sleep(0.01)
            yield record

    told: dict[Pace, int] = {}
    for pace in Pace:
        fake_run.rows.clear()
        runner, news = Runner(), []
        runner.set_pace(pace)
        runner.progressed.connect(lambda progress, news=news: news.append(len(progress.records)))
        with qtbot.waitSignal(runner.finished, timeout=10_000):
            runner.start(lambda: Session(fake_run, fake_run.problem, "CPU", records()))
        # Nothing is lost with fewer looks.
        assert sum(news) == 41
        told[pace] = len(news)
    assert told[Pace.SMOOTH] >= 4
    assert told[Pace.FAST] <= 2


def test_the_choice_is_shown_and_remembered(make_viewer: MakeViewer, tmp_path: Path) -> None:
    viewer = make_viewer()
    assert viewer.window._pace.text() == "Smooth window ▾"
    trigger(viewer, "pace_fast")
    assert viewer.runner.pace is Pace.FAST
    assert viewer.window._pace.text() == "Fast training ▾"
    assert viewer.window.close()
    again = make_viewer(load(tmp_path / "window.json"))
    assert again.runner.pace is Pace.FAST
    assert again.window.named_actions["pace_fast"].isChecked()


def test_the_status_bar_tells_speed_time_left_device_and_memory(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path]
) -> None:
    open_files(viewer, mesh_files[0])
    assert viewer.window.progress_text == ""
    viewer.window.panel.set_settings(quick_settings(steps=100_000, snapshot_every=1000))
    trigger(viewer, "start")
    qtbot.waitUntil(lambda: "left" in viewer.window.progress_text, timeout=60_000)
    words = viewer.window.progress_text.split("  ·  ")
    assert words[0].startswith("Training ")
    assert words[0].endswith(" of 100,000")
    assert words[1].endswith(" steps/s")
    assert words[2].endswith(" left")
    assert words[3] == "CPU"
    if sys.platform == "linux":
        assert words[4].endswith("B memory")
    trigger(viewer, "stop")
    wait_until_trained(viewer, qtbot)
    assert viewer.window.progress_text == ""


def test_memory_is_told_as_people_say_it() -> None:
    assert [size_text(n) for n in (850_000_000, 999_400_000, 1_340_000_000)] == ["850 MB", "999 MB", "1.3 GB"]
    assert device_memory("CPU") is None
    used = process_memory()
    if used is not None:
        held = np.ones(25_000_000)  # 200 MB, written to
        assert process_memory() - used > 150_000_000
        assert held[0] == 1
        assert memory_text("CPU").endswith(" memory")


def test_turning_the_view_stays_fluid_because_the_training_rests(
    make_viewer: MakeViewer, qtbot: QtBot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    viewer = make_viewer(width=1000, height=700)
    write_mesh(tmp_path / "sheet.ply", grid_mesh(40, height=0.3))  # 1,600 vertices
    viewer.opener.open_path(tmp_path / "sheet.ply")
    assert viewer.background.wait(60)
    viewer.window.panel.set_settings(settings_for(steps=100_000, snapshot_every=25))
    viewer.start()
    qtbot.waitUntil(lambda: viewer.workspace.current_step >= 3, timeout=60_000)
    view = viewer.window.panes.interactor
    told = []
    for pace in (Pace.FAST, Pace.SMOOTH):
        viewer.runner.set_pace(pace)
        viewer.runner._worker._mailbox.records.clear()  # type: ignore[union-attr]
        turns: list[float] = []
        clock = QTimer()
        clock.setInterval(2)
        clock.timeout.connect(lambda turns=turns: turns.append(time.perf_counter()))
        camera, end, place = viewer.window.panes.camera_state(), time.monotonic() + 2.0, 0
        qtbot.mousePress(view, Qt.MouseButton.LeftButton, pos=QPoint(100, 150))
        qtbot.wait(50)
        first = viewer.workspace.current_step
        clock.start()
        while time.monotonic() < end:
            place += 1
            qtbot.mouseMove(view, QPoint(100 + 2 * (place % 40), 150 + place % 30))
            qtbot.wait(15)
        clock.stop()
        viewer.runner._drain()
        steps = viewer.workspace.current_step - first
        qtbot.mouseRelease(view, Qt.MouseButton.LeftButton, pos=QPoint(120, 150))
        assert viewer.window.panes.camera_state() != camera
        gaps = np.diff(turns) * 1000
        told.append((pace, steps, float(np.percentile(gaps, 95)), float(gaps.max())))
    with capsys.disabled():
        for pace, steps, high, longest in told:
            print(f"\nturning for 2 s, {pace.value}: {steps} steps, gaps {high:.1f} ms p95, {longest:.0f} ms longest", end="")
    # A step that is under way is ended, then there is one a second.
    assert told[1][1] <= 5
    assert told[1][2] < 250
