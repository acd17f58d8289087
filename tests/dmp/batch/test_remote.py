"""One training on a worker of another process, watched from here."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from dmp.batch.cluster import ClusterError, full_address
from dmp.batch.remote import Link, RemoteTraining, reach, read_link
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
        time.sleep(1.0)
        paused_at = watch_until(records, lambda _: True).step
        for _ in range(10):
            item = next(records)
            paused_at, before = max(paused_at, item.step), paused_at
            time.sleep(0.05)
        assert paused_at == before
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
    training = remote(tmp_path / "copy", settings(steps=600), cable.port)
    training.begin()
    with closing(training.records()) as records:  # type: ignore[type-var]
        watch_until(records, lambda item: item.step >= 20)
        cable.cut()
        watch_until(records, lambda _: any("is lost" in text for text in training.warnings))
        cable.mend()
        for _ in records:
            pass
    assert any("is there again" in text for text in training.warnings)
    direct = make_run(tmp_path / "direct", settings(steps=600))
    for _ in record(direct.resume(), direct):
        pass
    assert_same(Run.open(tmp_path / "copy"), direct)


def test_a_run_that_was_left_is_found_again(server: tuple[int, Path], tmp_path: Path) -> None:
    training = remote(tmp_path / "copy", settings(steps=1000, snapshot_every=50), server[0])
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
    assert Run.open(copy.folder).snapshot_steps() == list(range(0, 1001, 50))
    assert [row["step"] for row in Run.open(copy.folder).curve()] == [0, 1, *range(5, 1001, 5)]


def test_nobody_at_the_address_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dmp.batch.cluster._CONNECT_SECONDS", 0.5)
    with pytest.raises(ClusterError, match="cannot be reached"):
        reach(Link("tcp://127.0.0.1:9", "ball"))


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


def watch_until(records: Iterator[StepRecord], is_enough: object) -> StepRecord:
    deadline = time.monotonic() + 60
    for item in records:
        if is_enough(item):  # type: ignore[operator]
            return item
        assert time.monotonic() < deadline
    raise AssertionError("The training ended before.")
