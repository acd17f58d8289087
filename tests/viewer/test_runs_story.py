"""A day in the window: a sample, two trainings, the list of runs, a comparison, the queue, and the evening."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QApplication

from dmp.meshio import read_mesh
from dmp.runs import Run, list_runs
from dmp_viewer.controller import Controller
from dmp_viewer.views import dialogs
from dmp_viewer.views.mesh_panes import INPUT, MIDDLE, PREDICTED
from tests.viewer.conftest import pane_pixels, quick_settings
from tests.viewer.driving import MakeViewer, trigger, wait_until_trained


def settle(viewer: Controller) -> None:
    for _ in range(3):
        QApplication.processEvents()
        assert viewer.background.wait(30)
        assert viewer.runs.wait(30)
    viewer.presenter.flush()
    QApplication.processEvents()


def choose(viewer: Controller, folder: Path) -> None:
    viewer.window.runs.list.choose(folder)
    viewer.presenter.flush()


def shows_a_mesh(picture: np.ndarray) -> bool:
    """Tell whether a pane has something in its middle that its rim has not."""
    rows, columns = picture.shape[:2]
    middle = picture[rows // 3 : -rows // 3, columns // 3 : -columns // 3].astype(int)
    rim = picture[rows // 2, :3].astype(int).mean(axis=0)
    return bool((np.abs(middle - rim).max(axis=-1) > 12).mean() > 0.5)


def test_a_day_with_runs(make_viewer: MakeViewer, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    viewer = make_viewer(width=1400, height=900)
    window, workspace = viewer.window, viewer.workspace
    # A machine that is busy with other things gives a lowered priority next to nothing.
    trigger(viewer, "pace_fast")

    # A sample is opened, with its ground truth, and trained on.
    viewer.opener.offer_samples(with_pictures=False)
    qtbot.mouseClick(window.start_page.cards["bumpy-sphere"], Qt.MouseButton.LeftButton)
    settle(viewer)
    quick = quick_settings(steps=20, snapshot_every=5, log_every=10, width_divisor=32)
    window.panel.set_settings(quick)
    assert shows_a_mesh(pane_pixels(viewer, INPUT))
    qtbot.mouseClick(window.panel.button("start"), Qt.MouseButton.LeftButton)
    wait_until_trained(viewer, qtbot)
    assert workspace.snapshot_steps == [0, 5, 10, 15, 20]
    last = pane_pixels(viewer, PREDICTED)
    assert shows_a_mesh(last)

    # Back in time, another picture; this step is kept and saved.
    trigger(viewer, "previous_step")
    trigger(viewer, "previous_step")
    assert workspace.shown_step == 10
    assert (np.abs(pane_pixels(viewer, PREDICTED).astype(int) - last).max(axis=-1) > 8).mean() > 0.02
    trigger(viewer, "keep")
    monkeypatch.setattr(dialogs, "ask_save_mesh", lambda *_: tmp_path / "kept.ply")
    trigger(viewer, "save")
    kept = workspace.snapshot(10)
    assert kept is not None
    assert np.allclose(read_mesh(tmp_path / "kept.ply").vertices, kept.vertices, atol=1e-5)
    first = workspace.run
    assert isinstance(first, Run)

    # The second one is stopped on its way.
    window.panel.set_settings(quick_settings(steps=3000, snapshot_every=1000, width_divisor=32, seed=7))
    trigger(viewer, "start")
    qtbot.waitUntil(lambda: workspace.run is not first and workspace.current_step >= 3, timeout=60_000)
    trigger(viewer, "stop")
    wait_until_trained(viewer, qtbot)
    second = workspace.run
    assert isinstance(second, Run)
    reached = second.last_step

    # Both are in the list; the first is opened from it, at its kept step.
    trigger(viewer, "show_runs")
    settle(viewer)
    rows = {row.folder: row for row in window.runs.list.rows()}
    assert rows[first.folder].state_text == "Finished, 20 steps  ·  kept 10"
    assert rows[second.folder].state_text == f"Stopped at {reached:,} of 3,000"
    assert "Seed 7" in rows[second.folder].about_text
    choose(viewer, first.folder)
    window.runs.list.setFocus()
    qtbot.keyClick(window.runs.list, Qt.Key.Key_Return)
    settle(viewer)
    assert workspace.run is not None
    assert workspace.run.run_id == first.run_id
    assert workspace.shown_step == workspace.kept_step == 10
    assert shows_a_mesh(pane_pixels(viewer, PREDICTED))

    # The second one is laid beside it: its mesh in the middle pane.
    before = pane_pixels(viewer, MIDDLE)
    choose(viewer, second.folder)
    trigger(viewer, "listed_compare")
    settle(viewer)
    assert workspace.comparison.shown == "run"
    assert (np.abs(pane_pixels(viewer, MIDDLE).astype(int) - before).max(axis=-1) > 8).mean() > 0.02

    # It goes on from where it was, for a few steps.
    trigger(viewer, "listed_proceed")
    settle(viewer)
    qtbot.waitUntil(lambda: workspace.current_step > reached + 2, timeout=60_000)
    assert workspace.run is not None
    assert workspace.run.run_id == second.run_id

    # Meanwhile two more are planned; stopping lets the queue wait until it is told to go on.
    for seed in (1, 2):
        window.panel.set_settings(quick_settings(steps=2000, snapshot_every=500, width_divisor=32, seed=seed))
        qtbot.mouseClick(window.panel.button("queue_add"), Qt.MouseButton.LeftButton)
        settle(viewer)
    assert window.runs.queue.status == "2 waiting, next after this one"
    waiting = window.runs.queue.folders()
    trigger(viewer, "stop")
    wait_until_trained(viewer, qtbot)
    trigger(viewer, "queue_go")
    qtbot.waitUntil(lambda: workspace.run is not None and workspace.run.settings.seed == 1, timeout=60_000)
    qtbot.waitUntil(lambda: workspace.current_step >= 3, timeout=60_000)

    # In the evening the window is closed in the middle of it, after a question.
    asked: list[str] = []
    monkeypatch.setattr(dialogs, "confirm", lambda _parent, text, *_: asked.append(text) or True)
    assert window.close()
    assert asked == ["1 training waits in the queue. Close all the same?"]
    states = {run.folder: run.state for run in list_runs(tmp_path / "runs")}
    assert states == {first.folder: "finished", second.folder: "stopped", waiting[0]: "stopped", waiting[1]: "stopped"}
    assert Run.open(waiting[0]).last_step >= 3
    assert Run.open(waiting[1]).snapshot_steps() == []

    # The next morning all of it is there.
    again = make_viewer(width=1400, height=900)
    again.queue.offer_kept()
    trigger(again, "show_runs")
    settle(again)
    assert again.window.runs.queue.folders() == [waiting[1]]
    assert {row.folder: row.state for row in again.window.runs.list.rows()} == {**states, waiting[1]: "waiting"}
