"""Stories in the real window: open, train, scrub, keep, save, reopen, continue, close. They look at what is shown."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt

from dmp.meshio import read_mesh
from dmp.runs import Run
from dmp_viewer.controller import Controller
from dmp_viewer.runner import Session
from dmp_viewer.states import RunnerState
from dmp_viewer.views import dialogs
from dmp_viewer.views.mesh_panes import INPUT, PREDICTED
from tests.viewer.conftest import FakeRun, quick_settings
from tests.viewer.driving import MakeViewer, open_files, trigger, wait_until_trained


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
