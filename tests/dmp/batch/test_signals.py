"""A closed terminal ends ``dmp batch``, ``dmp serve`` and ``dmp experiment`` in order, in this very process."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from dmp.batch import conducting, serving
from dmp.meshio import write_mesh
from dmp.noise import add_noise
from dmp.runs import Run, list_runs
from tests.dmp.batch.test_command import call
from tests.meshes import sphere_mesh

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="this system has no SIGHUP")


@pytest.fixture(autouse=True)
def nothing_is_ignored() -> Iterator[None]:
    """Undo what nohup does to the process that the tests run in."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@contextmanager
def hangup_when(is_time: Callable[[], bool]) -> Iterator[None]:
    """Send this process a SIGHUP, as soon as it is time and somebody listens."""
    done = threading.Event()

    def send() -> None:
        while not done.wait(0.02):
            if is_time() and callable(signal.getsignal(signal.SIGHUP)):
                os.kill(os.getpid(), signal.SIGHUP)
                return

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def test_a_batch_keeps_what_is_done(
    cluster: Any, scans: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conducting, "check_versions", lambda *_: ())
    table = tmp_path / "table.csv"
    table.write_text("mesh,name,steps\nscans/scan0.ply,short,8\nscans/scan1.ply,long,100000\n")
    out = tmp_path / "out"

    def is_time() -> bool:
        return any(out.glob("records/short*")) and any(out.glob("runs/long*/snapshots/000020.npy"))

    with hangup_when(is_time):
        assert call("batch", table, "--out", out, "--scheduler", cluster.scheduler.address, "--snapshot-every", 20) == 130
    told = capfd.readouterr()
    assert "The same command goes on from here" in told.err
    assert "Traceback" not in told.err
    assert told.out.strip() == str(out / "summary.html")
    assert "1 of 2 done, 1 waiting" in (out / "summary.md").read_text()
    assert len(list((out / "results").iterdir())) == 1
    [folder] = (out / "runs").glob("long*")
    run = Run.open(folder)
    assert run.state == "stopped"
    assert run.resume().step == run.last_step >= 20


def test_a_server_ends(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    states: list[str] = []

    @contextmanager
    def pretended(_service: serving.Service) -> Iterator[tuple[str, list[str]]]:
        states.append("open")
        yield "tcp://127.0.0.1:1", ["processor"]
        states.append("closed")

    monkeypatch.setattr(serving, "serving", pretended)
    with hangup_when(lambda: states == ["open"]):
        assert call("serve", "--port", 0) == 0
    assert states == ["open", "closed"]
    assert "Traceback" not in capfd.readouterr().err


def test_an_experiment_keeps_what_is_done(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    ball = sphere_mesh(2)
    write_mesh(tmp_path / "ground_truth.ply", ball)
    write_mesh(tmp_path / "noisy.ply", add_noise(ball, 0.2, seed=3))
    out = tmp_path / "out"
    arguments = ["smoothing", tmp_path, "--out", out, "--steps", 100_000, "--threads", 1]
    with hangup_when(lambda: any(out.rglob("snapshots/*.npy"))):
        assert call("experiment", *arguments) == 130
    told = capfd.readouterr().err
    assert "jobs done. The same command goes on from here" in told
    assert "Traceback" not in told
    assert {run.state for run in list_runs(out / "runs")} == {"stopped"}
