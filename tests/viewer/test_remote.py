"""The window against a worker in another process: start, watch, scrub, break the connection, reconnect, keep, save."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot

from dmp.batch.remote import read_link
from dmp.meshio import read_mesh
from dmp.runs import Run
from dmp_viewer.controller import Controller
from dmp_viewer.states import RunnerState
from dmp_viewer.views import dialogs
from tests.remote_server import Cable, served
from tests.viewer.conftest import quick_settings
from tests.viewer.driving import MakeViewer, open_files, trigger, wait_until_trained

# On a machine that is busy with other things everything takes its time.
PATIENCE = 120_000
LONG = {"steps": 4000, "snapshot_every": 20, "log_every": 5, "width_divisor": 32}


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dmp.batch.cluster._CONNECT_SECONDS", 60.0)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[int, Path]]:
    folder = tmp_path_factory.mktemp("server")
    with served(folder) as port:
        yield port, folder / "data" / "dmp-viewer" / "runs"


@pytest.fixture
def cable(server: tuple[int, Path]) -> Iterator[Cable]:
    made = Cable(server[0])
    yield made
    made.close()


def run_of(viewer: Controller) -> Run:
    run = viewer.workspace.run
    assert isinstance(run, Run)
    return run


def test_start_watch_scrub_break_reconnect_keep_save(
    make_viewer: MakeViewer,
    qtbot: QtBot,
    server: tuple[int, Path],
    cable: Cable,
    tmp_path: Path,
    mesh_files: tuple[Path, Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    viewer = make_viewer()
    window, workspace = viewer.window, viewer.workspace
    open_files(viewer, *mesh_files)
    window.panel.set_settings(quick_settings(**LONG))
    window.panel.place.set_address(f"127.0.0.1:{cable.port}")
    trigger(viewer, "start")
    qtbot.waitUntil(lambda: len(workspace.snapshot_steps) >= 4, timeout=PATIENCE)
    assert workspace.device == f"tcp://127.0.0.1:{cable.port}"
    assert viewer.preferences.servers == [f"tcp://127.0.0.1:{cable.port}"]
    [over_there] = server[1].iterdir()
    assert Run.open(over_there).state == "running"

    trigger(viewer, "pause")
    assert viewer.runner.state is RunnerState.PAUSED
    qtbot.wait(1200)
    paused_at = max(Run.open(over_there).curve()[-1]["step"], 0)
    qtbot.wait(500)
    assert Run.open(over_there).curve()[-1]["step"] == paused_at
    trigger(viewer, "first_step")
    trigger(viewer, "next_step")
    assert workspace.shown_step == 20
    assert not workspace.follow_latest
    trigger(viewer, "resume")
    qtbot.waitUntil(lambda: workspace.current_step > paused_at, timeout=PATIENCE)

    cable.cut()
    qtbot.waitUntil(lambda: any("is lost" in text for text in window.banners.texts()), timeout=PATIENCE)
    before = workspace.current_step
    # Over there it goes on; here what has arrived can be looked at.
    qtbot.waitUntil(lambda: Run.open(over_there).last_step > before + 40, timeout=PATIENCE)
    trigger(viewer, "next_step")
    assert workspace.shown_step == 40
    cable.mend()
    qtbot.waitUntil(lambda: workspace.current_step > before + 40, timeout=PATIENCE)
    assert any("is there again" in text for text in window.banners.texts())

    trigger(viewer, "keep")
    assert workspace.kept_step == 40
    monkeypatch.setattr(dialogs, "ask_save_mesh", lambda _parent, _title, proposal, _suffixes: proposal)
    trigger(viewer, "save")
    saved, kept = read_mesh(tmp_path / "scan_step40.ply"), run_of(viewer).snapshot(40)
    assert np.allclose(saved.vertices, kept.vertices, atol=1e-6)

    trigger(viewer, "stop")
    wait_until_trained(viewer, qtbot)
    copy = Run.open(run_of(viewer).folder)
    assert copy.state == Run.open(over_there).state == "stopped"
    assert copy.snapshot_steps() == Run.open(over_there).snapshot_steps() == workspace.snapshot_steps
    assert copy.kept_step == 40
    assert read_link(copy.folder) is None
    steps = [row["step"] for row in workspace.curve.rows]
    assert steps == sorted(set(steps))


def test_a_closed_window_finds_its_run_again(
    make_viewer: MakeViewer, qtbot: QtBot, server: tuple[int, Path], mesh_files: tuple[Path, Path]
) -> None:
    viewer = make_viewer()
    open_files(viewer, mesh_files[0])
    viewer.window.panel.set_settings(quick_settings(**{**LONG, "steps": 600}))
    viewer.window.panel.place.set_address(f"127.0.0.1:{server[0]}")
    trigger(viewer, "start")
    qtbot.waitUntil(lambda: len(viewer.workspace.snapshot_steps) >= 2, timeout=PATIENCE)
    folder = run_of(viewer).folder
    assert viewer.window.close()
    assert read_link(folder) is not None

    again = make_viewer()
    open_files(again, folder)
    assert any("This run is trained at" in text for text in again.window.banners.texts())
    assert again.workspace.controls.proceed
    trigger(again, "proceed")
    wait_until_trained(again, qtbot)
    assert again.workspace.snapshot_steps == list(range(0, 601, 20))
    assert again.window.panel.state_text == "Finished"
    assert read_link(folder) is None


def test_nobody_at_the_address_is_told_and_nothing_is_made(
    viewer: Controller, qtbot: QtBot, tmp_path: Path, mesh_files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dmp.batch.cluster._CONNECT_SECONDS", 0.5)
    open_files(viewer, mesh_files[0])
    for typed, told in (("127.0.0.1:9", "cannot be reached"), ("what is this", "is no address")):
        viewer.window.panel.place.set_address(typed)
        trigger(viewer, "start")
        wait_until_trained(viewer, qtbot)
        assert any(told in text for text in viewer.window.banners.texts())
    assert not list((tmp_path / "runs").glob("*")) if (tmp_path / "runs").exists() else True
    # The next one is done here again.
    viewer.window.panel.place.set_address("")
    trigger(viewer, "start")
    wait_until_trained(viewer, qtbot)
    assert viewer.workspace.device == "CPU"
