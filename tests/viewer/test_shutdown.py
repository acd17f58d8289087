"""The end that the system orders: it comes without a question, and the run is kept."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot

from dmp.runs import list_runs
from dmp_viewer.controller import Controller
from dmp_viewer.shutdown import Shutdown
from tests.viewer.driving import open_files

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot send these signals to itself")


class Application:
    """Notes with which exit code it was ended."""

    def __init__(self) -> None:
        self.codes: list[int] = []

    def exit(self, code: int) -> None:
        self.codes.append(code)


@pytest.fixture
def application() -> Application:
    return Application()


@pytest.fixture
def ending(viewer: Controller, application: Application) -> Iterator[Shutdown]:
    # Tests that run under nohup, or as a job in the background, inherit that some of them are ignored.
    inherited = {number: signal.signal(number, signal.SIG_DFL) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    listening = Shutdown(viewer, application)  # type: ignore[arg-type]
    yield listening
    listening.close()
    for number, handler in inherited.items():
        if number != signal.SIGTERM:
            signal.signal(number, handler)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.usefixtures("ending")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_training_and_keeps_the_step_that_it_had_reached(
    viewer: Controller,
    application: Application,
    mesh_files: tuple[Path, Path],
    qtbot: QtBot,
    tmp_path: Path,
    number: signal.Signals,
) -> None:
    open_files(viewer, mesh_files[0])
    viewer.start()
    qtbot.waitUntil(lambda: viewer.workspace.run is not None and viewer.workspace.current_step >= 2, timeout=60_000)
    # Any question would fail this test.
    os.kill(os.getpid(), number)
    qtbot.waitUntil(lambda: bool(application.codes), timeout=30_000)
    assert application.codes == [0]
    assert not viewer.window.isVisible()
    assert (tmp_path / "window.json").is_file()
    (run,) = list_runs(tmp_path / "runs")
    assert run.state in ("stopped", "finished")
    assert run.last_step >= 2
    assert run.last_step == max(row["step"] for row in run.curve())


def test_a_second_signal_changes_nothing(ending: Shutdown, application: Application, qtbot: QtBot) -> None:
    os.kill(os.getpid(), signal.SIGINT)
    qtbot.waitUntil(lambda: bool(application.codes), timeout=30_000)
    os.kill(os.getpid(), signal.SIGTERM)
    ending.end()
    qtbot.wait(50)
    assert application.codes == [0]


def test_what_is_to_be_ignored_stays_ignored(viewer: Controller) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    ending = Shutdown(viewer, Application())  # type: ignore[arg-type]
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    ending.close()
    signal.signal(signal.SIGHUP, before)


def test_a_run_that_could_not_be_written_is_saved_elsewhere(
    viewer: Controller,
    ending: Shutdown,
    application: Application,
    mesh_files: tuple[Path, Path],
    qtbot: QtBot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refuge = tmp_path / "refuge"
    refuge.mkdir()
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(refuge))
    (tmp_path / "runs").write_text("no folder", encoding="utf-8")
    open_files(viewer, mesh_files[0])
    viewer.start()
    qtbot.waitUntil(lambda: viewer.workspace.run is not None and viewer.workspace.current_step >= 2, timeout=60_000)
    ending.end()
    assert application.codes == [0]
    assert [path.suffix for path in refuge.iterdir()] == [".ply"]
