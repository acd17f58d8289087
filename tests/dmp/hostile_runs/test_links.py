"""Links, pipes and devices in run folders: none is followed, waited for, or written through."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from dmp.errors import RunError
from dmp.run_folder import RunFolder
from dmp.runs import Run, record
from tests.dmp.hostile_runs.damages import use_everything, use_or_refuse

PARTS = ["run.json", "input.ply", "ground_truth.ply", "base.npy", "curve.csv", "checkpoint.pt", "kept.json",
         "snapshots/000002.npy"]  # fmt: skip


@pytest.fixture
def within_seconds() -> Iterator[None]:
    """Fail, rather than wait for ever, when something opens a pipe."""
    begin = time.monotonic()
    yield
    assert time.monotonic() - begin < 10


@pytest.mark.usefixtures("within_seconds")
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("kind", ["link", "pipe", "device", "folder"])
def test_nothing_but_files_is_opened(part: str, kind: str, folder: Path, tmp_path: Path) -> None:
    path, outside = folder / part, tmp_path / "outside"
    path.replace(outside)
    if kind == "link":
        path.symlink_to(outside)
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    _unchanged_while(lambda: use_or_refuse(folder), outside)
    if part == "kept.json":
        assert Run.open(folder).kept_step is None
    else:
        with pytest.raises(RunError):
            use_everything(folder)


def _unchanged_while(work: Callable[[], None], *paths: Path) -> None:
    before = [(path.read_bytes(), path.stat().st_mtime_ns) for path in paths]
    work()
    assert [(path.read_bytes(), path.stat().st_mtime_ns) for path in paths] == before


@pytest.mark.usefixtures("within_seconds")
@pytest.mark.parametrize("part", ["curve.csv", "checkpoint.pt", "kept.json", "snapshots/000006.npy", "run.lock"])
def test_training_writes_through_no_link(part: str, folder: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    original = folder / part
    victim.write_bytes(original.read_bytes() if original.exists() else b"precious")
    original.unlink(missing_ok=True)
    run = Run.open(folder)
    training = run.resume() if part != "checkpoint.pt" else None
    original.symlink_to(victim)

    def work() -> None:
        if training is not None:
            with suppress(RunError):
                for item in record(training, run):
                    if item.step == 6:
                        run.keep(6)

    _unchanged_while(work, victim)


def test_a_linked_folder_of_snapshots_is_neither_read_nor_written(folder: Path, tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    (folder / "snapshots").replace(outside)
    (folder / "snapshots").symlink_to(outside)
    run = Run.open(folder)
    assert run.snapshot_steps() == []
    with pytest.raises(RunError, match="a link"):
        run.snapshot(2)
    names = sorted(path.name for path in outside.iterdir())
    list(record(run.resume(), run))
    assert sorted(path.name for path in outside.iterdir()) == names
    # Nothing is lost: what could not be written is in memory.
    assert run.snapshot_steps() == [6, 8]
    assert any("is a link, which is not followed" in warning for warning in run.warnings)


def test_a_curve_with_a_second_name_is_replaced_and_not_written_into(folder: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    os.link(folder / "curve.csv", victim)
    run = Run.open(folder)
    _unchanged_while(lambda: list(record(run.resume(), run)).clear(), victim)
    assert len(run.curve()) == 9
    os.link(folder / "curve.csv", tmp_path / "again")
    with pytest.raises(OSError, match="not a file of this run alone") as caught:
        RunFolder(folder).append("curve.csv", b"x")
    assert caught.value.errno == errno.EINVAL


@pytest.mark.usefixtures("within_seconds")
def test_a_lock_that_is_a_pipe_is_not_waited_for(folder: Path) -> None:
    (folder / "run.lock").unlink()
    os.mkfifo(folder / "run.lock")
    run = Run.open(folder)
    assert run.state == "stopped"
    assert len(list(record(run.resume(), run))) == 4
    assert any("no regular file" in warning for warning in run.warnings)
