"""A folder that cannot be written or is gone, an input that changes: it is told, and nothing is lost."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from dmp.errors import RunError
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh, write_mesh
from dmp.problem import denoising
from dmp.run_files import RunLock
from dmp.run_folder import RunFolder
from dmp.runs import Run, record
from dmp.settings import settings_for
from dmp.snapshot import StepRecord

MakeRun = Callable[..., Run]


@pytest.fixture
def make_run(noisy_sphere: TriangleMesh, tmp_path: Path) -> MakeRun:
    def make(name: str = "run", *, steps: int = 8, **options: object) -> Run:
        settings = settings_for("denoise", steps=steps, snapshot_every=2, log_every=1, threads=1, width_divisor=16)
        return Run.create(denoising(noisy_sphere, settings), settings, folder=tmp_path / name, **options)  # type: ignore[arg-type]

    return make


def train(run: Run, until: int | None = None) -> Iterator[StepRecord]:
    """Train until a step, and hand the open training over."""
    records = record(run.resume(), run)
    for item in records:
        if item.step == until:
            break
    return records


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, int]]:
    """A disk whose ``errno``, when set, is the answer to each writing; half of an appended line gets there all the same."""
    state = {"errno": 0}
    write, append = RunFolder.write, RunFolder.append

    def check(path: object) -> None:
        if state["errno"]:
            raise OSError(state["errno"], os.strerror(state["errno"]), str(path))

    def failing_write(folder: RunFolder, name: str, content: bytes) -> None:
        check(folder / name)
        write(folder, name, content)

    def failing_append(folder: RunFolder, name: str, content: bytes) -> None:
        if state["errno"]:
            append(folder, name, content[: len(content) // 2])
        check(folder / name)
        append(folder, name, content)

    monkeypatch.setattr(RunFolder, "write", failing_write)
    monkeypatch.setattr(RunFolder, "append", failing_append)
    monkeypatch.setattr("dmp.run_files._RETRY_SECONDS", 0.0)
    yield state


def curve_of(run: Run) -> list[dict[str, float]]:
    return [{name: value for name, value in row.items() if name != "seconds"} for row in run.curve()]


def test_a_disk_that_is_full_for_a_while_costs_nothing(make_run: MakeRun, disk: dict[str, int]) -> None:
    whole, run = make_run("whole"), make_run()
    list(train(whole))
    records = train(run, until=2)
    disk["errno"] = errno.ENOSPC
    for item in records:
        if item.step == 6:
            break
    assert len(run.warnings) == 1
    assert "cannot be written: the disk is full" in run.warnings[0]
    assert run.is_in_memory
    # In memory everything is there; on the disk is what was there before, and it can be opened.
    assert run.snapshot_steps() == [0, 2, 4, 6]
    # Single precision of the displacements on the disk is the only difference.
    assert np.allclose(run.snapshot(6).vertices, whole.snapshot(6).vertices, atol=1e-6)
    outside = Run.open(run.folder)
    assert outside.snapshot_steps() == [0, 2]
    assert [row["step"] for row in outside.curve()] == [0, 1, 2]
    disk["errno"] = 0
    list(records)
    assert not run.is_in_memory
    assert len(run.warnings) == 2
    assert "nothing is missing" in run.warnings[1]
    opened = Run.open(run.folder)
    assert opened.state == "finished"
    assert opened.snapshot_steps() == whole.snapshot_steps()
    assert curve_of(opened) == curve_of(whole)
    for step in opened.snapshot_steps():
        assert np.array_equal(opened.snapshot(step).vertices, whole.snapshot(step).vertices)


def test_a_disk_that_stays_full_leaves_everything_in_memory(make_run: MakeRun, disk: dict[str, int], tmp_path: Path) -> None:
    run = make_run()
    records = train(run, until=2)
    disk["errno"] = errno.ENOSPC
    list(records)
    assert run.state == "finished"
    assert run.is_in_memory
    run.keep(6)
    assert run.kept_step == 6
    assert [row["step"] for row in run.curve()] == list(range(9))
    assert run.suggestion() is not None
    write_mesh(tmp_path / "elsewhere.ply", run.mesh_at(8))
    assert np.array_equal(read_mesh(tmp_path / "elsewhere.ply").vertices, run.mesh_at(8).vertices)
    # The same object goes on from memory, and brings all of it to the disk once there is room.
    disk["errno"] = 0
    training = run.resume(steps=10)
    assert training.step == 8
    list(record(training, run))
    opened = Run.open(run.folder)
    assert opened.snapshot_steps() == [0, 2, 4, 6, 8, 10]
    assert opened.kept_step == 6
    assert [row["step"] for row in opened.curve()] == list(range(11))


def test_a_folder_that_vanishes_is_told_and_training_goes_on(make_run: MakeRun, tmp_path: Path) -> None:
    run = make_run()
    records = train(run, until=2)
    shutil.rmtree(run.folder)
    list(records)
    assert run.state == "finished"
    assert run.warnings == [
        f"The run folder {run.folder} cannot be written: it is no longer there. What is missing stays in memory and is written "
        "as soon as that works again. Save the mesh elsewhere before you leave."
    ]
    assert run.snapshot_steps() == [4, 6, 8]
    assert not run.folder.exists()
    assert [row["step"] for row in run.curve()] == list(range(9))
    write_mesh(tmp_path / "elsewhere.ply", run.mesh_at(8))


def test_a_folder_that_comes_back_gets_everything(make_run: MakeRun, tmp_path: Path) -> None:
    run = make_run()
    records = train(run, until=2)
    run.folder.rename(tmp_path / "away")
    for item in records:
        if item.step == 6:
            break
    (tmp_path / "away").rename(run.folder)
    list(records)
    opened = Run.open(run.folder)
    assert opened.state == "finished"
    assert opened.snapshot_steps() == [0, 2, 4, 6, 8]
    assert [row["step"] for row in opened.curve()] == list(range(9))


def test_a_read_only_folder_can_be_gone_on_with_in_memory(
    make_run: MakeRun, disk: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = make_run()
    train(run, until=4).close()  # type: ignore[attr-defined]
    disk["errno"] = errno.EROFS

    def refuse(lock: RunLock) -> bool:
        raise OSError(errno.EROFS, "read-only")

    monkeypatch.setattr(RunLock, "acquire", refuse)
    opened = Run.open(run.folder)
    records = record(opened.resume(), opened)
    assert next(records).step == 5
    assert opened.state == "running"
    with pytest.raises(RunError, match="being trained"):
        opened.resume()
    list(records)
    assert opened.state == "finished"
    assert opened.snapshot_steps() == [0, 2, 4, 6, 8]
    assert len(opened.warnings) == 1
    assert "the disk is read-only" in opened.warnings[0]
    assert Run.open(run.folder).state == "stopped"
    assert Run.open(run.folder).snapshot_steps() == [0, 2, 4]


def test_a_run_whose_folder_cannot_be_made_stays_in_memory_when_it_may(make_run: MakeRun, tmp_path: Path) -> None:
    (tmp_path / "a file").write_text("")
    with pytest.raises(RunError, match="a part of its path is a file"):
        make_run("a file/run")
    run = make_run("a file/run", in_memory=True)
    records = train(run, until=4)
    assert run.state == "running"
    assert run.snapshot_steps() == [0, 2, 4]
    assert len(run.warnings) == 1
    # Once it can be made, it is a run like any other.
    (tmp_path / "a file").unlink()
    list(records)
    opened = Run.open(run.folder)
    assert opened.state == "finished"
    assert opened.snapshot_steps() == [0, 2, 4, 6, 8]
    assert [row["step"] for row in opened.curve()] == list(range(9))
    assert len(run.warnings) == 2


def test_a_folder_that_was_begun_in_vain_is_removed(make_run: MakeRun, disk: dict[str, int], tmp_path: Path) -> None:
    disk["errno"] = errno.ENOSPC
    with pytest.raises(RunError, match="the disk is full"):
        make_run()
    assert not (tmp_path / "run").exists()
    (tmp_path / "run").mkdir()
    with pytest.raises(RunError, match="the disk is full"):
        make_run()
    assert (tmp_path / "run").is_dir()


@pytest.mark.parametrize("change", ["deleted", "replaced"])
def test_an_input_that_is_deleted_or_replaced_is_told_once(make_run: MakeRun, change: str, noisy_sphere: TriangleMesh) -> None:
    whole = make_run("whole")
    list(train(whole))
    scan = whole.folder.parent / "scan.ply"
    write_mesh(scan, noisy_sphere)
    run = make_run(input_path=scan)
    assert run.change_of_input() is None
    records = train(run, until=2)
    if change == "deleted":
        scan.unlink()
    else:
        scan.write_bytes(b"ply, but another one")
    list(records)
    words = "is no longer there" if change == "deleted" else "has changed since the run was started"
    assert run.warnings == [f"{scan} {words}. The run has a copy of its own and is not affected."]
    opened = Run.open(run.folder)
    assert opened.change_of_input() == run.warnings[0]
    assert np.array_equal(opened.snapshot(8).vertices, whole.snapshot(8).vertices)


def test_parts_of_files_that_a_kill_left_behind_are_removed(make_run: MakeRun) -> None:
    run = make_run()
    left = [run.folder / ".0123456789ab.dmp-part", run.folder / "snapshots" / ".ba9876543210.dmp-part"]
    others = [run.folder / ".hidden", run.folder / "notes.dmp-part"]
    for path in left + others:
        path.write_bytes(b"half")
    list(train(run))
    assert not any(path.exists() for path in left)
    assert all(path.exists() for path in others)


def test_an_interruption_within_a_step_keeps_the_last_checkpoint(make_run: MakeRun) -> None:
    whole, run = make_run("whole"), make_run()
    list(train(whole))
    records = train(run, until=5)
    training = records.gi_frame.f_locals["training"]  # type: ignore[attr-defined]

    def interrupted() -> None:
        raise KeyboardInterrupt

    training._update_average = interrupted
    with pytest.raises(KeyboardInterrupt):
        next(records)
    opened = Run.open(run.folder)
    assert opened.state == "stopped"
    assert opened.snapshot_steps() == [0, 2, 4]
    assert opened.resume().step == 4
    list(record(opened.resume(), opened))
    assert curve_of(opened) == curve_of(whole)
    assert np.array_equal(opened.snapshot(8).vertices, whole.snapshot(8).vertices)


def test_going_on_takes_the_number_of_threads_that_the_run_had(make_run: MakeRun, monkeypatch: pytest.MonkeyPatch) -> None:
    run = make_run()
    train(run, until=4).close()  # type: ignore[attr-defined]
    run = Run.open(run.folder)
    object.__setattr__(run.settings, "threads", 0)
    monkeypatch.setattr("dmp.training.available_cores", lambda: 8)
    assert run.recorded_threads == 1
    assert run.resume().threads == 1


def test_an_interrupted_run_can_be_acknowledged(make_run: MakeRun) -> None:
    run = make_run()
    train(run, until=4).close()  # type: ignore[attr-defined]
    run._manifest["state"] = "running"
    run._write_manifest()
    opened = Run.open(run.folder)
    assert opened.state == "interrupted"
    opened.acknowledge()
    assert opened.state == Run.open(run.folder).state == "stopped"
    assert Run.open(run.folder).resume().step == 4
