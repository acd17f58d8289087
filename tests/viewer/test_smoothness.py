"""The window stays alive while the network trains: the gaps between two turns of the event loop."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QTimer

from dmp.meshio import write_mesh
from dmp.problem import denoising
from dmp.settings import settings_for
from dmp.snapshot import Snapshot, StepRecord
from dmp_viewer.controller import Controller
from dmp_viewer.model import Source
from dmp_viewer.runner import Progress
from tests.meshes import grid_mesh
from tests.viewer.conftest import FakeRun

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
    # On a machine with much else to do six seconds may be too short for one step.
    qtbot.waitUntil(lambda: viewer.workspace.current_step > first, timeout=60_000)
    assert np.percentile(gaps, 95) < _BOUND_MS


@pytest.fixture
def long_run() -> FakeRun:
    """A run of 5000 steps with 101 snapshots of 10,000 vertices, and its ground truth."""
    clean = grid_mesh(100)
    problem = denoising(grid_mesh(100, height=0.3), settings_for(), clean)
    run = FakeRun(problem, settings_for(steps=5000, snapshot_every=50))
    for step in range(0, 5001, 5):
        share = step / 5000
        metrics = {"data_loss": 1.0 - share / 2, "held_out_error": 0.5, "mad": 20.0 - share}
        run.rows.append({"step": step, "seconds": 1.0, **metrics})
        if step % 50 == 0:
            positions = problem.base + share * (problem.target - problem.base)
            run.snapshots[step] = Snapshot("fake", step, positions, metrics)
    return run


@pytest.mark.parametrize("quantity", ["magnitude", "curvature"])
def test_moving_quickly_over_snapshots_stays_fluid(
    make_viewer: Callable[..., Controller], qtbot: QtBot, long_run: FakeRun, quantity: str, capsys: pytest.CaptureFixture[str]
) -> None:
    viewer = make_viewer(width=1280, height=800)
    viewer.workspace.open_run(long_run, long_run.problem, Source("sheet", long_run.problem.mesh), None)
    viewer.workspace.colors.set(quantity=quantity)
    viewer.workspace.look.set(shading="smooth")
    viewer.presenter.flush()
    assert viewer.scanner.wait(30)
    viewer.window.panes.interactor.setUpdatesEnabled(False)
    spent: list[float] = []
    for step in viewer.workspace.snapshot_steps:
        started = time.perf_counter()
        viewer.workspace.show_step(step)
        viewer.presenter.flush()
        spent.append((time.perf_counter() - started) * 1000)
    with capsys.disabled():
        high = np.percentile(spent, 95)
        print(f"\n10,000 vertices, {quantity}: {high:.1f} ms p95 for another snapshot, apart from drawing")
    # The aim is 100 ms for 50,000 vertices on a machine that does nothing else.
    assert np.percentile(spent, 95) < 100


def test_a_long_training_needs_no_more_memory_than_its_snapshots(
    make_viewer: Callable[..., Controller], qtbot: QtBot, long_run: FakeRun, capsys: pytest.CaptureFixture[str]
) -> None:
    viewer = make_viewer(width=1000, height=700)
    fresh = FakeRun(long_run.problem, long_run.settings, state="running")
    viewer.workspace.begin_run(fresh, fresh.problem, "CPU")
    viewer.presenter.flush()
    before = long_run.snapshots[0].vertices
    size = len(long_run.snapshots) * before.nbytes
    tracemalloc.start()
    try:
        for row in long_run.rows:
            step = int(row["step"])
            metrics = {name: value for name, value in row.items() if name not in ("step", "seconds")}
            record = StepRecord(step, step / 10, metrics)
            viewer.runner.progressed.emit(Progress("fake", (record,), 1.0))
            if step in long_run.snapshots:
                # A copy, as the training thread hands it over.
                snapshot = Snapshot("fake", step, long_run.snapshots[step].vertices.copy(), metrics)
                fresh.snapshots[step] = snapshot
                viewer.runner.snapshotTaken.emit(snapshot)
                viewer.presenter.flush()
        assert viewer.scanner.wait(30)
        viewer.presenter.flush()
        grown, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    with capsys.disabled():
        print(f"\n{size / 1e6:.1f} MB of snapshots: memory grew by {grown / 1e6:.1f} MB, at most by {peak / 1e6:.1f} MB")
    # Beside the snapshots: the curve, a few pictures of them, and what the panes show.
    assert grown < 1.15 * size + 4e6


def test_a_long_curve_is_drawn_less_often(
    viewer: Controller, qtbot: QtBot, long_run: FakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel = viewer.window.curve
    drawn: list[float] = []
    draw = panel.set_curve
    monkeypatch.setattr(panel, "set_curve", lambda *both: (drawn.append(time.perf_counter()), draw(*both)))
    row = {name: value for name, value in long_run.rows[-1].items() if name != "step"}

    def grown_by_a_row_now_and_then(n_rows: int) -> float:
        """Return the time between two drawings of a curve of so many rows that goes on growing."""
        run = FakeRun(long_run.problem, long_run.settings, rows=[{"step": step, **row} for step in range(n_rows)])
        drawn.clear()
        viewer.workspace.open_run(run, run.problem, Source("sheet", run.problem.mesh), None)
        qtbot.waitUntil(lambda: bool(drawn))
        step = n_rows
        while len(drawn) < 3:
            step += 1
            viewer.workspace.add_records([StepRecord(step, 1.0, row)])
            qtbot.wait(5)
        return drawn[-1] - drawn[-2]

    long = grown_by_a_row_now_and_then(32_000)
    assert long > 0.75
    assert grown_by_a_row_now_and_then(100) < long
