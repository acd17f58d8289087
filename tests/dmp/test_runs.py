from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dmp.errors import RunError
from dmp.mesh import TriangleMesh
from dmp.problem import denoising
from dmp.run_files import parse_curve
from dmp.runs import Run, default_runs_folder, is_run_folder, list_runs, record
from dmp.settings import settings_for

MakeRun = Callable[..., Run]


@pytest.fixture
def make_run(noisy_sphere: TriangleMesh, sphere: TriangleMesh, tmp_path: Path) -> MakeRun:
    def make(name: str = "run", **overrides: object) -> Run:
        settings = settings_for("denoise", **{"steps": 20, "snapshot_every": 10, "log_every": 5, "threads": 1, **overrides})
        return Run.create(denoising(noisy_sphere, settings, sphere), settings, folder=tmp_path / name)

    return make


def _train(run: Run, until: int | None = None) -> None:
    records = record(run.resume(), run)
    for item in records:
        if item.step == until:
            break
    records.close()  # type: ignore[attr-defined]


def test_a_finished_run_can_be_opened_with_everything_in_it(make_run: MakeRun) -> None:
    run = make_run()
    _train(run)
    opened = Run.open(run.folder)
    assert opened.state == "finished"
    assert opened.snapshot_steps() == [0, 10, 20]
    assert [row["step"] for row in opened.curve()] == [0, 1, 5, 10, 15, 20]
    assert opened.settings == run.settings
    assert np.array_equal(opened.problem().target, run.problem().target)
    truth = opened.problem().ground_truth
    assert truth is not None
    snapshot = opened.snapshot(20)
    assert truth.mad(snapshot.vertices) == pytest.approx(snapshot.metrics["mad"], abs=1e-3)
    mesh = opened.mesh_at(20)
    assert mesh.vertex_attributes["displacement"] == pytest.approx(mesh.vertices - opened.problem().base)


def test_stopping_keeps_the_step_reached_and_going_on_is_bit_exact(make_run: MakeRun) -> None:
    whole, parts = make_run("whole"), make_run("parts")
    _train(whole)
    _train(parts, until=13)
    stopped = Run.open(parts.folder)
    assert stopped.state == "stopped"
    assert stopped.snapshot_steps() == [0, 10, 13]
    _train(stopped)
    again = Run.open(parts.folder)
    assert again.state == "finished"
    drop_seconds = [
        [{k: v for k, v in row.items() if k != "seconds"} for row in run.curve() if row["step"] != 13] for run in (whole, again)
    ]
    assert drop_seconds[0] == drop_seconds[1]
    assert np.array_equal(whole.snapshot(20).vertices, again.snapshot(20).vertices)


def test_a_killed_run_can_be_opened_and_loses_at_most_one_interval(make_run: MakeRun, tmp_path: Path) -> None:
    run = make_run(steps=100_000)
    code = (
        "import sys; from dmp.runs import Run, record\n"
        "run = Run.open(sys.argv[1])\n"
        "for item in record(run.resume(), run): print(item.step, flush=True)"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(run.folder)], stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        reached = 0
        for line in child.stdout:
            reached = int(line)
            if reached >= 25:
                break
        assert Run.open(run.folder).state == "running"
        os.kill(child.pid, signal.SIGKILL)
    opened = Run.open(run.folder)
    assert opened.state == "interrupted"
    assert reached - 10 <= opened.last_step
    training = opened.resume()
    assert training.step == opened.last_step
    assert opened.mesh_at(opened.last_step).n_vertices == run.problem().mesh.n_vertices


def test_a_run_is_not_trained_twice_at_once(make_run: MakeRun) -> None:
    run = make_run()
    records = record(run.resume(), run)
    next(records)
    with pytest.raises(RunError, match="being trained"):
        Run.open(run.folder).resume()
    records.close()  # type: ignore[attr-defined]
    assert Run.open(run.folder).resume().step == 0


def test_the_kept_step_is_remembered_and_must_exist(make_run: MakeRun) -> None:
    run = make_run()
    _train(run)
    assert run.kept_step is None
    run.keep(10)
    assert Run.open(run.folder).kept_step == 10
    with pytest.raises(RunError, match="Step 11"):
        run.keep(11)
    run.keep(None)
    assert Run.open(run.folder).kept_step is None


def test_a_folder_with_something_in_it_is_not_overwritten(make_run: MakeRun, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "thesis.txt").write_text("precious")
    with pytest.raises(RunError, match="not empty"):
        make_run()
    assert (tmp_path / "run" / "thesis.txt").read_text() == "precious"


def test_runs_are_listed_newest_first_and_damaged_ones_left_out(make_run: MakeRun, noisy_sphere: TriangleMesh) -> None:
    settings = settings_for("denoise", steps=1)
    runs = []
    for _ in range(2):
        runs.append(Run.create(denoising(noisy_sphere, settings), settings, input_path="scan.ply"))
        time.sleep(1.1)
    broken = default_runs_folder() / "broken"
    broken.mkdir()
    (broken / "run.json").write_text("{")
    assert is_run_folder(broken)
    assert [run.folder for run in list_runs()] == [run.folder for run in reversed(runs)]


def test_a_cut_last_line_of_the_curve_is_left_out() -> None:
    content = b"step,seconds,data_loss\n5,0.1,1.5\n10,0.2,\n15,0.3,1."
    assert parse_curve(content) == [{"step": 5, "seconds": 0.1, "data_loss": 1.5}, {"step": 10, "seconds": 0.2}]


def test_the_description_tells_versions_and_the_digest_of_the_input(noisy_sphere: TriangleMesh, tmp_path: Path) -> None:
    settings = settings_for("denoise", steps=1)
    source = tmp_path / "scan.ply"
    source.write_bytes(b"as it was")
    digest = hashlib.sha256(b"as it was").hexdigest()
    run = Run.create(denoising(noisy_sphere, settings), settings, folder=tmp_path / "run", input_path=source)
    manifest = json.loads((run.folder / "run.json").read_text())
    assert manifest["input"]["sha256"] == digest
    assert {"dmp", "torch", "numpy"} <= manifest["versions"].keys()
    assert run.input_path == source
