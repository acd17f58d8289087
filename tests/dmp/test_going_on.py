"""Going on with a killed training gives, bit for bit, what it would have become: both methods, both tasks."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from dmp.completion import problem_for
from dmp.errors import RunError
from dmp.mesh import TriangleMesh
from dmp.runs import Run, record
from dmp.settings import Settings, settings_for
from dmp.shapes.alterations import with_holes
from tests.meshes import grid_mesh

CASES = [("denoise", "compact"), ("denoise", "best"), ("complete", "compact"), ("complete", "best")]


def _run(task: str, preset: str, mesh: TriangleMesh, folder: Path) -> Run:
    quick = {"bilateral_layers": 2} if (task, preset) == ("denoise", "best") else {}
    settings: Settings = settings_for(task, preset, steps=10, snapshot_every=3, log_every=2, threads=1, **quick)
    if task == "complete":
        mesh = with_holes(grid_mesh(16, height=0.05), [(7.0, 7.0, 0.0)], [9])
    return Run.create(problem_for(mesh, settings), settings, folder=folder)


def _everything(run: Run) -> tuple[list[dict[str, float]], dict[int, bytes]]:
    rows = [{name: value for name, value in row.items() if name != "seconds"} for row in run.curve()]
    return rows, {step: run.snapshot(step).vertices.tobytes() for step in run.snapshot_steps()}


@pytest.mark.parametrize(("task", "preset"), CASES)
def test_what_a_kill_leaves_at_any_step_goes_on_bit_for_bit(
    task: str, preset: str, noisy_sphere: TriangleMesh, tmp_path: Path
) -> None:
    run = _run(task, preset, noisy_sphere, tmp_path / "run")
    # A copy of the folder between two steps is what a kill leaves there; the lock goes with the process.
    copies = {}
    for item in record(run.resume(), run):
        copies[item.step] = tmp_path / f"killed at {item.step}"
        shutil.copytree(run.folder, copies[item.step])
    whole = _everything(Run.open(run.folder))
    assert [row["step"] for row in whole[0]] == [0, 1, 2, 3, 4, 6, 8, 9, 10]
    for step in (0, 1, 5, 9):
        killed = Run.open(copies[step])
        assert killed.state == "interrupted"
        assert step - killed.last_step < 3
        training = killed.resume()
        assert training.step == killed.last_step
        list(record(training, killed))
        assert _everything(Run.open(copies[step])) == whole


def test_a_kill_between_the_last_snapshot_and_its_checkpoint_is_gone_on_from_the_one_before(
    noisy_sphere: TriangleMesh, tmp_path: Path
) -> None:
    run = _run("denoise", "compact", noisy_sphere, tmp_path / "run")
    for item in record(run.resume(), run):
        if item.step == 9:
            shutil.copy(run.folder / "checkpoint.pt", tmp_path / "checkpoint.pt")
        if item.step == 10:
            shutil.copytree(run.folder, tmp_path / "killed")
    shutil.copy(tmp_path / "checkpoint.pt", tmp_path / "killed" / "checkpoint.pt")
    killed = Run.open(tmp_path / "killed")
    assert killed.state == "finished"
    assert [item.step for item in record(killed.resume(), killed)] == [10]
    assert _everything(Run.open(killed.folder)) == _everything(run)


def test_a_kill_after_the_last_snapshot_costs_nothing(noisy_sphere: TriangleMesh, tmp_path: Path) -> None:
    run = _run("denoise", "compact", noisy_sphere, tmp_path / "run")
    for item in record(run.resume(), run):
        if item.step == 10:
            shutil.copytree(run.folder, tmp_path / "killed")
    killed = Run.open(tmp_path / "killed")
    assert killed.state == "finished"
    assert _everything(killed) == _everything(run)
    # Going on with it does what is left: it ends.
    assert list(record(killed.resume(), killed)) == []
    with pytest.raises(RunError, match="has reached step 10 already"):
        Run.open(killed.folder).resume()


@pytest.mark.parametrize(("task", "preset"), CASES)
def test_many_short_sittings_are_one_long_one(task: str, preset: str, noisy_sphere: TriangleMesh, tmp_path: Path) -> None:
    whole, run = (_run(task, preset, noisy_sphere, tmp_path / name) for name in ("whole", "run"))
    list(record(whole.resume(), whole))
    sittings = 0
    while run.state != "finished":
        run = Run.open(run.folder)
        records = record(run.resume(), run)
        for _ in range(2):
            if next(records, None) is None:
                break
        records.close()  # type: ignore[attr-defined]
        sittings += 1
    assert sittings > 3
    rows, snapshots = _everything(Run.open(run.folder))
    whole_rows, whole_snapshots = _everything(whole)
    known = {row["step"] for row in whole_rows}
    # Each stop adds a row and a snapshot of the step reached.
    assert [row for row in rows if row["step"] in known] == whole_rows
    assert all(snapshots[step] == content for step, content in whole_snapshots.items())
    assert np.array_equal(Run.open(run.folder).mesh_at(10).vertices, whole.mesh_at(10).vertices)
