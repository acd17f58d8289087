"""The window stays alive while the network trains: the gaps between two turns of the event loop."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QTimer

from dmp.meshio import write_mesh
from dmp.settings import settings_for
from dmp_viewer.controller import Controller
from tests.meshes import grid_mesh

# The aim on two cores is a 95th percentile under 50 ms; machines that also do other things get room.
_BOUND_MS = 250


def test_gaps_in_the_event_loop_during_training(
    make_viewer: Callable[..., Controller], qtbot: QtBot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    viewer = make_viewer(width=1280, height=800)
    write_mesh(tmp_path / "sheet.ply", grid_mesh(87, height=0.3))  # 7,569 vertices
    viewer.opener.open_path(tmp_path / "sheet.ply")
    assert viewer.background.wait(60)
    viewer.window.panel.set_settings(settings_for(steps=100_000, snapshot_every=25))
    viewer.start()
    qtbot.waitUntil(lambda: viewer.workspace.current_step >= 3, timeout=60_000)

    turns: list[float] = []
    clock = QTimer()
    clock.setInterval(2)
    clock.timeout.connect(lambda: turns.append(time.perf_counter()))
    clock.start()
    first = viewer.workspace.current_step
    started = time.perf_counter()
    qtbot.wait(6000)
    speed = (viewer.workspace.current_step - first) / (time.perf_counter() - started)
    clock.stop()
    gaps = np.diff(turns) * 1000
    with capsys.disabled():
        middle, high, longest = np.percentile(gaps, [50, 95, 100])
        print(f"\nevent loop during training at {speed:.1f} steps/s, gaps:", end=" ")
        print(f"{middle:.1f} ms median, {high:.1f} ms p95, {longest:.0f} ms longest")
    assert viewer.workspace.current_step > first
    assert np.percentile(gaps, 95) < _BOUND_MS


def test_moving_quickly_over_snapshots_stays_fluid(
    make_viewer: Callable[..., Controller], qtbot: QtBot, capsys: pytest.CaptureFixture[str]
) -> None:
    from dmp.problem import denoising
    from dmp.snapshot import Snapshot
    from dmp_viewer.model import Source
    from tests.viewer.conftest import FakeRun

    mesh = grid_mesh(224, height=0.3)  # 50,176 vertices
    problem = denoising(mesh, settings_for())
    run = FakeRun(problem, settings_for(steps=200, snapshot_every=10))
    for step in range(0, 201, 10):
        share = step / 200
        run.snapshots[step] = Snapshot("fake", step, problem.base + share * (problem.target - problem.base))
        run.rows.append({"step": step, "seconds": 1.0, "data_loss": 1.0 - share / 2})
    viewer = make_viewer(width=1280, height=800)
    viewer.workspace.open_run(run, problem, Source("sheet", mesh), None)
    viewer.presenter.flush()
    qtbot.wait(300)
    spent: list[float] = []
    for step in range(0, 201, 10):
        started = time.perf_counter()
        viewer.workspace.show_step(step)
        viewer.presenter.flush()
        spent.append((time.perf_counter() - started) * 1000)
    with capsys.disabled():
        print(f"\n50,176 vertices: {np.percentile(spent, 95):.1f} ms p95 for another snapshot, apart from drawing")
    assert np.percentile(spent, 95) < _BOUND_MS
