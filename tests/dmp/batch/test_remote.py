"""One training on a worker of another process, watched from here."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dmp.batch import asking, versions
from dmp.batch import remote as remote_module
from dmp.batch.cluster import ClusterError, connect, full_address
from dmp.batch.remote import Link, RemoteTraining, reach, read_link
from dmp.batch.remote_worker import Answer
from dmp.batch.versions import compare, versions_here
from dmp.problem import denoising
from dmp.runs import Run, record
from dmp.settings import Settings, settings_for
from dmp.snapshot import StepRecord
from tests.meshes import sphere_mesh
from tests.remote_server import Cable, served


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[int, Path]]:
    """The port of a server, and its data folder."""
    folder = tmp_path_factory.mktemp("server")
    with served(folder) as port:
        yield port, folder / "data"


@pytest.fixture
def cable(server: tuple[int, Path]) -> Iterator[Cable]:
    made = Cable(server[0])
    yield made
    made.close()


def make_run(folder: Path, settings: Settings) -> Run:
    ball = sphere_mesh(2)
    noisy = ball.with_vertices(ball.vertices + 0.04 * np.random.default_rng(1).standard_normal(ball.vertices.shape))
    return Run.create(denoising(noisy, settings, ball), settings, folder=folder, name="ball")


def remote(folder: Path, settings: Settings, port: int) -> RemoteTraining:
    made = make_run(folder, settings)
    link = Link(f"tcp://127.0.0.1:{port}", "ball")
    client, remarks = reach(link)
    assert remarks == ()
    return RemoteTraining(Run.open(made.folder), link, client)


def settings(**changes: object) -> Settings:
    values = {"steps": 40, "snapshot_every": 10, "log_every": 5, "threads": 1, "width_divisor": 32, **changes}
    return settings_for("denoise", **values)


def assert_same(copy: Run, direct: Run) -> None:
    assert copy.snapshot_steps() == direct.snapshot_steps()
    for step in direct.snapshot_steps():
        assert np.array_equal(copy.snapshot(step).vertices, direct.snapshot(step).vertices)
    assert [{**row, "seconds": 0} for row in copy.curve()] == [{**row, "seconds": 0} for row in direct.curve()]


def test_a_remote_training_arrives_like_one_here(server: tuple[int, Path], tmp_path: Path) -> None:
    training = remote(tmp_path / "copy", settings(), server[0])
    training.begin()
    assert read_link(tmp_path / "copy") == training.link
    arrived = [item for item in training.records() if item.metrics]
    direct = make_run(tmp_path / "direct", settings())
    made = [item for item in record(direct.resume(), direct) if item.metrics]
    assert [item.step for item in arrived] == [item.step for item in made]
    for here, there in zip(made, arrived, strict=True):
        assert here.metrics == there.metrics
        assert (here.snapshot is None) == (there.snapshot is None)
    copy = Run.open(tmp_path / "copy")
    assert_same(copy, direct)
    assert copy.state == "finished"
    assert copy.device == "cpu"
    assert training.device == "cpu"
    # It is nowhere else any more, and can be gone on with here.
    assert read_link(tmp_path / "copy") is None
    for _ in record(copy.resume(60), copy):
        pass
    assert copy.last_step == 60


def test_pause_resume_and_stop_act_over_there(server: tuple[int, Path], tmp_path: Path) -> None:
    training = remote(tmp_path / "copy", settings(steps=100_000, snapshot_every=50), server[0])
    training.begin()
    with closing(training.records()) as records:  # type: ignore[type-var]
        watch_until(records, lambda item: item.step > 20)
        training.hold(True)
        # What was learnt before the wish arrived still comes; then nothing does, for longer than dozens of steps take.
        paused_at, since = 0, time.monotonic()
        deadline = since + 60
        while time.monotonic() < since + 1.0:
            assert time.monotonic() < deadline
            item = next(records)
            if item.step > paused_at:
                paused_at, since = item.step, time.monotonic()
            time.sleep(0.05)
        training.hold(False)
        watch_until(records, lambda item: item.step > paused_at + 20)
    copy, [over_there] = (
        Run.open(tmp_path / "copy"),
        list((server[1] / "dmp-viewer" / "runs").glob(f"*{training.run.run_id[:12]}")),
    )
    assert copy.state == Run.open(over_there).state == "stopped"
    # Stopping keeps the step reached, here as there.
    assert copy.last_step == Run.open(over_there).last_step > paused_at
    assert copy.resume().step == copy.last_step


def test_a_broken_connection_leaves_the_training_alone(server: tuple[int, Path], cable: Cable, tmp_path: Path) -> None:
    training = remote(tmp_path / "copy", settings(steps=1000), cable.port)
    training.begin()
    with closing(training.records()) as records:  # type: ignore[type-var]
        watch_until(records, lambda item: item.step >= 20)
        cable.cut()
        watch_until(records, lambda _: any("is lost" in text for text in training.warnings))
        cable.mend()
        for _ in records:
            pass
    assert any("is there again" in text for text in training.warnings)
    direct = make_run(tmp_path / "direct", settings(steps=1000))
    for _ in record(direct.resume(), direct):
        pass
    assert_same(Run.open(tmp_path / "copy"), direct)


def test_a_run_that_was_left_is_found_again(server: tuple[int, Path], tmp_path: Path) -> None:
    training = remote(tmp_path / "copy", settings(steps=400, snapshot_every=50), server[0])
    training.begin()
    with closing(training.records()) as records:  # type: ignore[type-var]
        watch_until(records, lambda item: item.step >= 50)
        training.leave()
    copy = Run.open(tmp_path / "copy")
    assert copy.last_step >= 50
    link = read_link(copy.folder)
    assert link is not None
    again = RemoteTraining(copy, link, reach(link)[0])
    again.attach()
    steps = [item.step for item in again.records() if item.metrics]
    # Nothing comes twice, and nothing is missing.
    assert steps == sorted(set(steps))
    assert Run.open(copy.folder).snapshot_steps() == list(range(0, 401, 50))
    assert [row["step"] for row in Run.open(copy.folder).curve()] == [0, 1, *range(5, 401, 5)]


def test_a_worker_that_does_not_answer_is_told_of_and_started_anew(
    server: tuple[int, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_module, "_ANSWER_SECONDS", 1.0)
    monkeypatch.setattr(remote_module, "_STALL_SECONDS", 2.0)
    training = remote(tmp_path / "copy", settings(steps=1500), server[0])
    training.begin()
    halted = 0
    with closing(training.records()) as records:  # type: ignore[type-var]
        watch_until(records, lambda item: item.step >= 20)
        [halted] = asking.ask(training._client, os.getpid).values()
        os.kill(halted, signal.SIGSTOP)
        try:
            watch_until(records, lambda _: any("does not answer" in text for text in training.warnings))
            for _ in records:
                pass
        finally:
            with suppress(ProcessLookupError):
                os.kill(halted, signal.SIGKILL)
    assert any("is replaced, and the training goes on" in text for text in training.warnings)
    direct = make_run(tmp_path / "direct", settings(steps=1500))
    for _ in record(direct.resume(), direct):
        pass
    assert_same(Run.open(tmp_path / "copy"), direct)


def test_a_worker_that_answers_but_makes_no_steps_is_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    client: Any = None
    run = Run.open(make_run(tmp_path / "copy", settings()).folder)
    training = RemoteTraining(run, Link("tcp://127.0.0.1:1", "ball"), client)
    monkeypatch.setattr(remote_module, "_STILL_SECONDS", -1.0)
    for found in (
        Answer("training", 1.0, 5),
        Answer("training", 1.0, 6),
        None,
        Answer("paused", 1.0, 6),
        Answer("paused", 1.0, 6),
    ):
        training._look_after_worker(found)
    assert training.warnings == []
    for _ in range(3):
        training._look_after_worker(Answer("training", 1.0, 6))
    [told] = training.warnings
    assert "has made no step" in told
    assert "step 6" in told


def test_nobody_at_the_address_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dmp.batch.cluster._CONNECT_SECONDS", 0.5)
    with pytest.raises(ClusterError, match="cannot be reached"):
        reach(Link("tcp://127.0.0.1:9", "ball"))


def test_the_address_of_a_web_page_is_told() -> None:
    server = socket.create_server(("127.0.0.1", 0))

    def answer() -> None:
        connection, _ = server.accept()
        with connection:
            connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
            connection.recv(1)

    threading.Thread(target=answer, daemon=True).start()
    with server, pytest.raises(ClusterError, match="is no scheduler of dask"):
        connect(f"tcp://127.0.0.1:{server.getsockname()[1]}")


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("server", "tcp://server:8786"),
        (" server:99 ", "tcp://server:99"),
        ("tls://10.0.0.1", "tls://10.0.0.1:8786"),
        ("tcp://[::1]:1", "tcp://[::1]:1"),
    ],
)
def test_addresses(typed: str, meant: str) -> None:
    assert full_address(typed) == meant


@pytest.mark.parametrize("typed", ["", "tcp://", "file:///etc/passwd", "a b", "server:http", "inproc://x"])
def test_what_is_no_address_is_refused(typed: str) -> None:
    with pytest.raises(ClusterError, match="no address"):
        full_address(typed)


def test_versions_that_differ_are_told_before_anything_starts() -> None:
    here = versions_here()
    assert compare(here, {"a": here}) == compare(here, {})
    [obstacle] = compare(here, {"a": {**here, "dmp-viewer": "0.0.1"}}).obstacles
    assert "0.0.1" in obstacle
    assert here["dmp-viewer"] in obstacle
    assert "not installed" in compare(here, {"a": {**here, "dmp-viewer": ""}}).obstacles[0]
    assert "Python 2.7.1" in compare(here, {"a": {**here, "python": "2.7.1"}}).obstacles[0]
    other_torch = compare(here, {"a": {**here, "torch": "1.0"}})
    assert not other_torch.obstacles
    assert "torch 1.0" in other_torch.remarks[0]


def test_another_state_of_the_same_version_is_told() -> None:
    here = versions_here()
    [obstacle] = compare(here, {"a": {**here, "sources": "0123456789abcdef"}}).obstacles
    assert "The worker a" in obstacle
    assert "state 01234567" in obstacle
    assert f"this computer (state {here['sources'][:8]})" in obstacle
    assert here["dmp-viewer"] in obstacle
    # A worker from before this was asked for cannot answer; a program that was packed without sources has none to compare.
    assert "an earlier state" in compare(here, {"a": {**here, "sources": ""}}).obstacles[0]
    assert compare(here, {"a": {**here, "sources": "packed"}}) == compare(here, {})
    # An other version is told as such, once.
    assert len(compare(here, {"a": {**here, "dmp-viewer": "0.0.1", "sources": "1"}}).obstacles) == 1


def test_the_digest_is_of_the_computing_sources_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "dmp"
    (package / "batch").mkdir(parents=True)
    (tmp_path / "dmp_viewer").mkdir()
    (package / "__init__.py").write_bytes(b"a = 1\nb = 2\n")
    (package / "batch" / "versions.py").write_bytes(b"")
    monkeypatch.setattr(versions, "__file__", str(package / "batch" / "versions.py"))
    digest = versions.sources_digest.__wrapped__
    first = digest()
    for path in (package / "notes.md", package / "sample.ply", tmp_path / "dmp_viewer" / "app.py"):
        path.write_text("else")
    (package / "__init__.py").write_bytes(b"a = 1\r\nb = 2\r\n")
    assert digest() == first
    (package / "__init__.py").write_bytes(b"a = 1\nb = 3\n")
    second = digest()
    (package / "__init__.py").rename(package / "other.py")
    assert len({first, second, digest()}) == 3


def watch_until(records: Iterator[StepRecord], is_enough: object) -> StepRecord:
    deadline = time.monotonic() + 60
    for item in records:
        if is_enough(item):  # type: ignore[operator]
            return item
        assert time.monotonic() < deadline
    raise AssertionError("The training ended before.")
