"""Kept runs: listed with what cannot be read, renamed, drawn, removed; and the commands that do it."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmp.cli import main
from dmp.errors import RunError
from dmp.mesh import TriangleMesh
from dmp.problem import denoising
from dmp.run_upkeep import changed_settings, kept_runs, remove_run, shape_of
from dmp.runs import Run, default_runs_folder, record
from dmp.settings import settings_for

MakeRun = Callable[..., Run]


@pytest.fixture
def make_run(noisy_sphere: TriangleMesh, sphere: TriangleMesh, tmp_path: Path) -> MakeRun:
    def make(folder: Path | None = None, *, train: bool = True, **overrides: object) -> Run:
        settings = settings_for("denoise", **{"steps": 2, "snapshot_every": 1, "threads": 1, "width_divisor": 16, **overrides})
        problem = denoising(noisy_sphere, settings, sphere)
        run = Run.create(problem, settings, folder=folder or tmp_path / "runs" / "run", name="scan")
        if train:
            assert len(list(record(run.resume(), run))) == 3
        return run

    return make


def dmp(*line: object) -> int:
    with pytest.raises(SystemExit) as left:
        main(list(map(str, line)))
    return int(left.value.code or 0)


def test_only_what_differs_from_the_preset_is_told() -> None:
    assert changed_settings(settings_for("denoise", "paper")) == {}
    assert changed_settings(settings_for("denoise", "paper", steps=7, threads=3, device="cpu", log_every=1)) == {}
    changed = replace(settings_for("denoise"), laplacian_weight=3.0, seed=7)
    assert changed_settings(changed) == {"laplacian_weight": 3.0, "seed": 7}


def test_runs_are_listed_newest_first_and_damaged_ones_are_named(make_run: MakeRun, tmp_path: Path) -> None:
    first, second = (make_run(tmp_path / "runs" / name, train=False) for name in ("a", "b"))
    (tmp_path / "runs" / "c").mkdir()
    (tmp_path / "runs" / "c" / "run.json").write_text("{}")
    (tmp_path / "runs" / "notes.txt").write_text("mine")
    manifest = json.loads((first.folder / "run.json").read_text())
    (first.folder / "run.json").write_text(json.dumps({**manifest, "created": "2031-01-01T00:00:00+00:00"}))
    kept = kept_runs(tmp_path / "runs")
    assert [run.folder for run in kept.runs] == [first.folder, second.folder]
    ((path, reason),) = kept.unreadable
    assert path == tmp_path / "runs" / "c"
    assert "does not describe a run" in reason
    assert kept_runs(tmp_path / "nowhere").runs == ()


def test_a_new_name_is_kept_and_nothing_else_is_touched(make_run: MakeRun) -> None:
    run = make_run()
    before = {path: path.read_bytes() for path in run.folder.rglob("*") if path.is_file() and path.name != "run.json"}
    Run.open(run.folder).rename("  The best\n of all \u202e ")
    opened = Run.open(run.folder)
    assert opened.name == "The best of all"
    assert opened.warnings == []
    assert opened.state == "finished"
    assert {path: path.read_bytes() for path in before} == before


@pytest.mark.parametrize("name", ["", "  \n", "\u200b\u202e"])
def test_a_name_with_nothing_to_see_is_refused(make_run: MakeRun, name: str) -> None:
    run = make_run(train=False)
    with pytest.raises(RunError, match="needs a name"):
        run.rename(name)
    assert Run.open(run.folder).name == run.name


def test_a_run_in_training_is_renamed_by_who_trains_it_alone(make_run: MakeRun) -> None:
    run = make_run(train=False)
    records = record(run.resume(), run)
    next(records)
    with pytest.raises(RunError, match="being trained"):
        Run.open(run.folder).rename("mine")
    run.rename("while it learns")
    assert len(list(records)) == 2
    assert Run.open(run.folder).name == "while it learns"


def test_a_name_that_cannot_be_written_is_not_taken(make_run: MakeRun, monkeypatch: pytest.MonkeyPatch) -> None:
    run = make_run(train=False)
    before = run.name

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("dmp.runs.write_manifest", full)
    with pytest.raises(RunError, match="disk is full"):
        run.rename("too long for this disk")
    assert run.name == before


def test_the_shape_for_a_picture_is_the_mesh_of_the_step(make_run: MakeRun, noisy_sphere: TriangleMesh) -> None:
    run = Run.open(make_run().folder)
    assert np.array_equal(shape_of(run, 2).vertices, run.snapshot(2).vertices)
    assert np.array_equal(shape_of(run, None).vertices, noisy_sphere.vertices)
    with pytest.raises(RunError, match="missing"):
        shape_of(run, 7)


def test_removing_a_run_leaves_what_is_not_its_own(make_run: MakeRun, tmp_path: Path) -> None:
    gone, shared = make_run(tmp_path / "runs" / "a"), make_run(tmp_path / "runs" / "b")
    (shared.folder / "my result.ply").write_text("mine")
    (shared.folder / "snapshots" / "notes.npy").write_text("mine")
    assert remove_run(gone.folder) == []
    assert not gone.folder.exists()
    assert remove_run(shared.folder) == ["my result.ply", "snapshots"]
    assert sorted(path.name for path in shared.folder.rglob("*")) == ["my result.ply", "notes.npy", "snapshots"]
    with pytest.raises(RunError, match="not a run folder"):
        remove_run(shared.folder)


def test_a_run_in_training_or_behind_a_link_is_not_removed(make_run: MakeRun, tmp_path: Path) -> None:
    run = make_run(train=False)
    (tmp_path / "link").symlink_to(run.folder)
    with pytest.raises(RunError, match="is a link"):
        remove_run(tmp_path / "link")
    records = record(run.resume(), run)
    next(records)
    with pytest.raises(RunError, match="being trained"):
        remove_run(run.folder)
    records.close()  # type: ignore[attr-defined]
    assert remove_run(run.folder) == []
    assert (tmp_path / "link").is_symlink()


def test_links_in_a_run_are_removed_and_never_followed(make_run: MakeRun, tmp_path: Path) -> None:
    run = make_run()
    for name in ("snapshots", "elsewhere"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "000001.npy").write_text("mine")
    (tmp_path / "mine.csv").write_text("mine")
    (run.folder / "curve.csv").unlink()
    (run.folder / "curve.csv").symlink_to(tmp_path / "mine.csv")
    (run.folder / "snapshots").rename(tmp_path / "moved")
    (run.folder / "snapshots").symlink_to(tmp_path / "elsewhere")
    assert remove_run(run.folder) == ["snapshots"]
    assert (tmp_path / "mine.csv").read_text() == "mine"
    assert (tmp_path / "elsewhere" / "000001.npy").exists()


def test_runs_are_searched_renamed_and_deleted_by_the_command_line(
    make_run: MakeRun, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    root = default_runs_folder()
    make_run(root / "bunny", train=False)
    make_run(root / "horse", laplacian_weight=3.0)
    assert dmp("runs", "rename", "bunny", "Soft [red] rabbit") == 0
    assert "is called “Soft [red] rabbit” now" in capsys.readouterr().err
    assert dmp("runs", "--search", "LAPLACIAN finished") == 0
    listed = capsys.readouterr().out
    assert "horse" in listed
    assert "--laplacian-weight 3.0" in listed
    assert "bunny" not in listed
    assert dmp("runs", "--search", "rabbit", "--json") == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["name"] == "Soft [red] rabbit"
    assert dmp("runs", "--search", "elephant") == 0
    assert "No run" in capsys.readouterr().err

    monkeypatch.setattr(sys, "stdin", io.StringIO("yes\n"))
    assert dmp("runs", "delete", "bunny") == 2  # nobody there to ask
    assert "--yes" in capsys.readouterr().err
    assert dmp("runs", "delete", "bunny", "nothing", "--yes") == 2
    assert (root / "bunny").exists()
    assert dmp("runs", "delete", "bunny", "horse", "--yes") == 0
    assert list(root.iterdir()) == []


@pytest.mark.parametrize(("answer", "stays"), [("no\n", True), ("\n", True), ("yes\n", False)])
def test_deleting_asks_on_a_terminal(
    make_run: MakeRun, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], answer: str, stays: bool
) -> None:
    run = make_run(train=False)

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    dmp("runs", "delete", run.folder)
    assert run.folder.exists() is stays
    assert "cannot be taken back" in capsys.readouterr().err
