"""The command line when something goes wrong on the way: one sentence, and what was learnt can be had."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dmp.cli import main
from dmp.deep_mesh_prior import DeepMeshPrior
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh, write_mesh
from dmp.runs import Run, default_runs_folder, list_runs

Call = Callable[..., tuple[int, str]]
QUICK = ("--steps", "12", "--snapshot-every", "4", "--threads", "1", "--width-divisor", "16")


@pytest.fixture
def scan(noisy_sphere: TriangleMesh, tmp_path: Path) -> Path:
    write_mesh(tmp_path / "scan.ply", noisy_sphere)
    return tmp_path / "scan.ply"


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Call:
    """Run a command; return its exit code and what it said."""

    def run(*arguments: object) -> tuple[int, str]:
        with pytest.raises(SystemExit) as end:
            main([str(argument) for argument in arguments])
        code = end.value.code
        assert isinstance(code, int)
        said = capsys.readouterr().err
        assert "Traceback" not in said
        return code, said

    return run


@pytest.fixture
def refuge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The system's folder for temporary files."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture
def no_runs_folder() -> None:
    """Where runs are kept there is a file."""
    default_runs_folder().parent.mkdir(parents=True)
    default_runs_folder().write_text("")


@pytest.fixture
def nan_at_step_9(monkeypatch: pytest.MonkeyPatch) -> None:
    update = DeepMeshPrior._update

    def spoilt(training: DeepMeshPrior) -> object:
        if training.step == 8:
            training._target[0] = float("nan")
        return update(training)

    monkeypatch.setattr(DeepMeshPrior, "_update", spoilt)


@pytest.mark.usefixtures("no_runs_folder")
def test_a_folder_for_runs_that_cannot_be_made_is_told_and_the_mesh_is_saved(call: Call, scan: Path) -> None:
    code, said = call("denoise", scan, "-o", scan.with_name("out.ply"), *QUICK)
    assert code == 0
    assert said.count("cannot be written") == 1
    assert "Warning: The run folder" in said and "a part of its path is a file, not a folder" in said
    assert "Step 12 written to" in said
    assert read_mesh(scan.with_name("out.ply")).n_vertices == 258


def test_a_folder_that_was_named_must_be_writable(call: Call, scan: Path) -> None:
    code, said = call("denoise", scan, "-o", scan.with_name("out.ply"), *QUICK, "--run", scan / "run")
    assert code == 2
    assert said.startswith("dmp: The run folder") and said.count("\n") == 1
    assert not scan.with_name("out.ply").exists()


def _failing_for(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the disk be full for one file."""
    replace = Path.replace

    def full(temporary: Path, target: Path) -> Path:
        if Path(target) == path:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(target))
        return replace(temporary, target)

    monkeypatch.setattr(Path, "replace", full)


def test_a_result_that_cannot_be_written_can_be_exported_later(
    call: Call, scan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output, run = tmp_path / "out.ply", tmp_path / "run"
    with monkeypatch.context() as patch:
        _failing_for(output, patch)
        code, said = call("denoise", scan, "-o", output, *QUICK, "--run", run, "--keep", "last", "--quiet")
    assert code == 2
    assert "because the disk is full. Nothing is lost" in said
    command = said.split("'")[1]
    assert command == f"dmp export {run} --step 12 -o FILE"
    assert call(*command.split()[1:-1], output)[0] == 0
    assert read_mesh(output).n_vertices == 258


@pytest.mark.usefixtures("no_runs_folder")
def test_when_nothing_else_can_be_written_the_mesh_goes_where_it_can(
    call: Call, scan: Path, tmp_path: Path, refuge: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "out.ply"
    _failing_for(output, monkeypatch)
    code, said = call("denoise", scan, "-o", output, *QUICK, "--keep", "last")
    assert code == 2
    (saved,) = refuge.iterdir()
    assert f"The mesh of step 12 was written to {saved} instead." in said
    assert read_mesh(saved).n_vertices == 258


@pytest.mark.usefixtures("nan_at_step_9")
def test_numbers_that_are_none_are_told_with_the_way_to_the_last_good_step(call: Call, scan: Path, tmp_path: Path) -> None:
    output, run = tmp_path / "out.ply", tmp_path / "run"
    code, said = call("denoise", scan, "-o", output, *QUICK, "--run", run, "--quiet")
    assert code == 2
    assert "at step 9: the loss is nan." in said
    command = said.split("'")[1]
    assert command == f"dmp export {run} --step 8 -o FILE"
    # A mesh that is not the result is not put in its place unasked.
    assert not output.exists()
    assert Run.open(run).state == "failed"
    assert "at step 9" in Run.open(run).reason
    assert call(*command.split()[1:-1], output)[0] == 0
    assert np.isfinite(read_mesh(output).vertices).all()


@pytest.mark.usefixtures("nan_at_step_9", "no_runs_folder")
def test_the_last_good_step_of_a_run_in_memory_is_saved_where_it_can_be(call: Call, scan: Path, refuge: Path) -> None:
    code, said = call("denoise", scan, "-o", scan.with_name("out.ply"), *QUICK)
    assert code == 2
    (saved,) = refuge.iterdir()
    assert f"Step 8 was written to {saved}." in said


def test_an_input_that_has_changed_is_told_when_going_on(call: Call, scan: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert call("denoise", scan, "-o", tmp_path / "out.ply", *QUICK, "--run", run)[0] == 0
    scan.write_bytes(b"ply, and something else")
    code, said = call("resume", run, "--steps", 16)
    assert code == 0
    assert f"{scan} has changed since the run was started. The run has a copy of its own and is not affected." in said
    assert Run.open(run).last_step == 16


def test_a_read_only_run_is_gone_on_with_and_its_result_saved(
    call: Call, scan: Path, tmp_path: Path, refuge: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dmp.run_files import RunLock
    from dmp.run_folder import RunFolder

    run = tmp_path / "run"
    assert call("denoise", scan, "-o", tmp_path / "out.ply", *QUICK, "--run", run)[0] == 0

    def refuse(*_: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    for owner, name in ((RunFolder, "write"), (RunFolder, "append"), (RunLock, "acquire")):
        monkeypatch.setattr(owner, name, refuse)
    code, said = call("resume", run, "--steps", 16, "-o", tmp_path / "more.ply", "--keep", "last")
    assert code == 0
    assert said.count("the disk is read-only") == 1
    assert f"Step 16 written to {tmp_path / 'more.ply'}" in said
    code, said = call("resume", run, "--steps", 16, "--keep", "last")
    assert code == 0
    (saved,) = refuge.iterdir()
    assert f"Step 16 written to {saved}." in said


def test_damaged_runs_are_passed_over_in_the_list(call: Call, scan: Path, tmp_path: Path) -> None:
    assert call("denoise", scan, "-o", tmp_path / "out.ply", *QUICK)[0] == 0
    (good,) = list_runs()
    for name, content in (("deep", '{"a":' * 100_000), ("odd", "\ud800".encode("utf-8", "surrogatepass").decode("latin-1"))):
        (default_runs_folder() / name).mkdir()
        (default_runs_folder() / name / "run.json").write_text(content, encoding="latin-1")
    assert [run.folder for run in list_runs()] == [good.folder]
    assert call("runs")[0] == 0
    code, said = call("resume", default_runs_folder() / "deep")
    assert code == 2
    assert "is damaged" in said
