"""Batches on two worker processes: results are those of direct runs, and every job ends once, whatever happens to workers."""

from __future__ import annotations

import csv
import os
import signal
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dmp.batch import conducting
from dmp.batch.cluster import ClusterError
from dmp.batch.conducting import Place, Watcher, run_batch
from dmp.batch.doing import chosen_step
from dmp.batch.folder import BatchFolder, Outcome
from dmp.batch.jobs import BatchJob, jobs_from_files
from dmp.batch.summary import write_summary
from dmp.meshio import read_mesh
from dmp.problem import denoising
from dmp.runs import Run, record
from dmp.settings import settings_for
from tests.dmp.batch.conftest import make_scans

SHORT = settings_for("denoise", steps=12, snapshot_every=4, log_every=2, threads=1, width_divisor=32)
# Long enough to be hit while it is under way: a second or more.
LONG = settings_for("denoise", steps=1800, snapshot_every=60, log_every=20, threads=1, width_divisor=16)


@pytest.fixture(autouse=True)
def sources_may_be_edited_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker that is started anew during the tests is not refused for that."""
    monkeypatch.setattr(conducting, "check_versions", lambda *_: ())


def place_of(cluster: Any) -> Place:
    return Place(scheduler=cluster.scheduler.address)


def direct_run(job: BatchJob, folder: Path) -> Run:
    """Train as `dmp denoise` does, in this process."""
    truth = None if job.ground_truth is None else read_mesh(job.ground_truth)
    run = Run.create(denoising(read_mesh(job.mesh), job.settings, truth), job.settings, folder=folder)
    for _ in record(run.resume(), run):
        pass
    return run


@pytest.fixture(scope="module")
def long_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The first scan, trained directly with the long settings."""
    folder = tmp_path_factory.mktemp("long")
    [job, *_] = jobs_from_files([str(make_scans(folder / "scans", 1))], LONG, None)
    return direct_run(job, folder / "run")


def assert_same(job: BatchJob, out: Path, direct: Run) -> Outcome:
    """Compare what a batch made of a job with a direct run, bit for bit; return how the job ended."""
    outcome = BatchFolder(out).read(job.name)
    assert outcome is not None
    assert outcome.failure == ""
    run = Run.open(out / "runs" / outcome.run)
    assert run.state == "finished"
    for step in direct.snapshot_steps():
        assert np.array_equal(run.snapshot(step).vertices, direct.snapshot(step).vertices)
    assert outcome.step == direct.suggested_step() == chosen_step(direct, "auto")[0]
    result = read_mesh(out / "results" / outcome.result)
    assert np.array_equal(result.vertices, direct.mesh_at(outcome.step).vertices)
    assert {name: outcome.after[name] for name in outcome.after} == (
        {} if direct.problem().ground_truth is None else direct.problem().ground_truth.measures(result.vertices)
    )
    return outcome


@pytest.mark.parametrize("is_shared", [True, False])
def test_results_are_those_of_direct_runs_and_are_not_made_twice(
    cluster: Any, scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_shared: bool
) -> None:
    if not is_shared:
        monkeypatch.setattr(conducting, "sees_all", lambda *_: False)
    jobs = jobs_from_files([str(scans)], SHORT, scans / "truth")
    shares: list[float] = []
    watcher = Watcher(told=lambda _name, share: shares.append(share))
    counted = run_batch(jobs, tmp_path / "out", place_of(cluster), watcher=watcher)
    assert (counted.done, counted.failed, counted.interrupted, counted.retries) == (3, 0, False, [])
    for job in jobs:
        outcome = assert_same(job, tmp_path / "out", direct_run(job, tmp_path / f"direct-{job.name}"))
        assert set(outcome.after) == set(outcome.before) == {"mad", "vertex_error"}
        assert outcome.threads == 1
    assert shares
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert run_batch(jobs, tmp_path / "out", place_of(cluster)).done == 0
    assert before == {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*") if path.is_file()}


def test_a_failure_is_told_and_holds_nobody_up(cluster: Any, scans: Path, tmp_path: Path) -> None:
    (scans / "scan1.ply").write_bytes(b"no <mesh>")
    jobs = jobs_from_files([str(scans)], SHORT, None)
    counted = run_batch(jobs, tmp_path / "out", place_of(cluster))
    assert (counted.done, counted.failed) == (2, 1)
    page = write_summary(jobs, tmp_path / "out")
    rows = list(csv.DictReader((tmp_path / "out" / "summary.csv").read_text().splitlines()))
    assert [row["state"] for row in rows] == ["done", "failed", "done"]
    assert "no PLY file" in rows[1]["failure"]
    assert (tmp_path / "out" / rows[0]["result"]).is_file()
    told = (tmp_path / "out" / "summary.md").read_text()
    assert "2 of 3 done, 1 failed" in told
    assert "## Failures" in told
    shown = page.read_text()
    assert shown.count("data:image/png;base64,") == 2
    # A self-contained page: nothing is fetched, and nothing of a file is taken for markup.
    assert "http:" not in shown
    assert "https:" not in shown
    assert "no <mesh>" not in shown
    # What failed is tried again once it is mended.
    (scans / "scan1.ply").write_bytes((scans / "scan0.ply").read_bytes())
    jobs = jobs_from_files([str(scans)], SHORT, None)
    assert run_batch(jobs, tmp_path / "out", place_of(cluster)).done == 1


def test_a_killed_worker_costs_a_retry_that_is_named(cluster: Any, scans: Path, tmp_path: Path, long_run: Run) -> None:
    jobs = jobs_from_files([str(scans / "scan0.ply")], LONG, None)
    killed: list[int] = []

    def kill(_name: str, share: float) -> None:
        if 0.2 < share < 0.8 and not killed:
            killed.append(busy_worker(cluster))
            os.kill(killed[0], signal.SIGKILL)

    counted = run_batch(jobs, tmp_path / "out", place_of(cluster), watcher=Watcher(told=kill))
    assert len(killed) == len(counted.retries) == 1
    outcome = assert_same(jobs[0], tmp_path / "out", long_run)
    assert outcome.resumed_from >= 60
    assert "was lost" in outcome.retries[0]
    write_summary(jobs, tmp_path / "out")
    assert "## Retries" in (tmp_path / "out" / "summary.md").read_text()


def test_a_worker_that_does_not_move_is_started_anew_and_the_next_job_is_not_kept_waiting(
    cluster: Any, scans: Path, tmp_path: Path, long_run: Run, halted: list[int]
) -> None:
    jobs = jobs_from_files([str(scans / "scan0.ply")], LONG, None)

    def halt(_name: str, share: float) -> None:
        if share > 0.1 and not halted:
            halted.append(busy_worker(cluster))
            os.kill(halted[0], signal.SIGSTOP)

    run_batch(jobs, tmp_path / "out", place_of(cluster), watcher=Watcher(told=halt), stall_seconds=3)
    outcome = assert_same(jobs[0], tmp_path / "out", long_run)
    assert len(outcome.retries) == 1
    assert "did not move" in outcome.retries[0]
    others = jobs_from_files([str(scans)], SHORT, None)
    counted = run_batch(others, tmp_path / "out", place_of(cluster))
    assert (counted.done, counted.retries) == (3, [])


@pytest.mark.parametrize("is_shared", [True, False])
def test_stopped_and_called_again_it_ends_with_the_same_result(
    cluster: Any, scans: Path, tmp_path: Path, long_run: Run, monkeypatch: pytest.MonkeyPatch, is_shared: bool
) -> None:
    if not is_shared:
        monkeypatch.setattr(conducting, "sees_all", lambda *_: False)
    jobs = jobs_from_files([str(scans / "scan0.ply")], LONG, None)
    stop = threading.Event()
    watcher = Watcher(told=lambda _name, share: stop.set() if share > 0.2 else None)
    counted = run_batch(jobs, tmp_path / "out", place_of(cluster), stop=stop, watcher=watcher)
    assert counted.interrupted
    assert counted.done == counted.failed == 0
    run = Run.open(tmp_path / "out" / "runs" / jobs[0].name)
    assert run.state == "stopped"
    reached = run.last_step
    assert 0 < reached < LONG.steps
    assert write_summary(jobs, tmp_path / "out").read_text().count("Waiting.") == 1
    assert run_batch(jobs, tmp_path / "out", place_of(cluster)).done == 1
    outcome = assert_same(jobs[0], tmp_path / "out", long_run)
    assert outcome.resumed_from == reached


def test_a_scheduler_that_is_not_there_is_told(scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dmp.batch.cluster._CONNECT_SECONDS", 0.5)
    jobs = jobs_from_files([str(scans)], SHORT, None)
    with pytest.raises(ClusterError, match=r"tcp://127.0.0.1:9 cannot be reached"):
        run_batch(jobs, tmp_path / "out", Place(scheduler="127.0.0.1:9"))
    assert not (tmp_path / "out" / "records").exists()


def busy_worker(cluster: Any) -> int:
    """Return the process id of the worker that does something."""
    [address] = [address for address, tasks in cluster.processing().items() if tasks]
    return int(cluster.run(os.getpid, workers=[address])[address])
