"""Restores many tiny meshes on two workers, one of which is killed by SIGKILL every 20 seconds.

Every job ends with a result that is, bit for bit, the one of a direct run with the same seed, and every worker that was
killed at work is named in the summary.
"""

from __future__ import annotations

import csv
import os
import signal
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from dmp.batch.cluster import local_client
from dmp.batch.conducting import Place, run_batch
from dmp.batch.folder import BatchFolder
from dmp.batch.jobs import BatchJob, jobs_from_files
from dmp.batch.summary import write_summary
from dmp.meshio import read_mesh, write_mesh
from dmp.problem import denoising
from dmp.runs import Run, record
from dmp.settings import settings_for
from tests.meshes import sphere_mesh
from tests.soak import Result

FULL_SIZE = 200
KILL_EVERY_SECONDS = 20.0
MOST_KILLS = 10**9
_NAME = "batch jobs with killed workers"
STEPS = 300


def run(size: int, seed: int) -> Result:
    """Restore ``size`` meshes while workers are killed."""
    if not hasattr(signal, "SIGKILL"):
        return Result(_NAME, 0, 0, ("this system has no SIGKILL",))
    with tempfile.TemporaryDirectory(prefix="dmp-batch-soak-") as name:
        folder = Path(name)
        _write_inputs(folder / "scans", size, seed)
        # Of several seeds, so that a result in the wrong place would be seen.
        jobs = [
            job
            for number in range(size)
            for job in jobs_from_files([str(folder / "scans" / f"scan{number:03d}.ply")], _settings(number), None)
        ]
        with local_client(2) as client, _killing(client, seed) as killed:
            counted = run_batch(jobs, folder / "out", Place(scheduler=client.scheduler.address))
        failures = [f"{counted.failed} jobs failed"] if counted.failed else []
        write_summary(jobs, folder / "out")
        failures += _unnamed(folder / "out", killed)
        wrong = [text for job in jobs if (text := _difference(job, folder))]
        note = (f"{len(killed)} workers were killed at work, {len(counted.retries)} retries",)
        return Result(_NAME, size - len(wrong), size, (*failures, *wrong, *note) if failures or wrong else note)


def _settings(number: int) -> Any:
    return settings_for("denoise", steps=STEPS, snapshot_every=25, seed=number % 7, threads=1, width_divisor=16)


def _write_inputs(folder: Path, size: int, seed: int) -> None:
    folder.mkdir()
    ball = sphere_mesh(2)
    for number in range(size):
        noise = 0.03 * np.random.default_rng([seed, number]).standard_normal(ball.vertices.shape)
        write_mesh(folder / f"scan{number:03d}.ply", ball.with_vertices(ball.vertices + noise))


@contextmanager
def _killing(client: Any, seed: int) -> Iterator[list[str]]:
    """Kill a worker now and then while the block runs; yield the addresses of those that were at work."""
    generator, killed, done = np.random.default_rng(seed), [], threading.Event()

    def kill_on() -> None:
        while len(killed) < MOST_KILLS and not done.wait(KILL_EVERY_SECONDS):
            with suppress(Exception):
                pids = client.run(os.getpid)
                victim = sorted(pids)[int(generator.integers(len(pids)))]
                is_at_work = bool(client.processing([victim])[victim])
                os.kill(pids[victim], signal.SIGKILL)
                if is_at_work:
                    killed.append(victim)

    thread = threading.Thread(target=kill_on, daemon=True)
    thread.start()
    try:
        yield killed
    finally:
        done.set()
        thread.join(30)


def _unnamed(out: Path, killed: list[str]) -> list[str]:
    told = (out / "summary.md").read_text()
    with (out / "summary.csv").open(newline="") as file:
        counted = sum(int(row["retries"]) for row in csv.DictReader(file))
    wrong = [f"the summary does not name the loss of {address}" for address in killed if address not in told.replace("\\", "")]
    return wrong + ([f"{counted} retries are counted for {len(killed)} kills"] if counted < len(killed) else [])


def _difference(job: BatchJob, folder: Path) -> str:
    """Return what differs from a direct run in this process; empty when nothing does."""
    outcome = BatchFolder(folder / "out").read(job.name)
    if outcome is None or outcome.failure:
        return f"{job.name}: {outcome.failure if outcome else 'it has not ended'}"
    direct = Run.create(denoising(read_mesh(job.mesh), job.settings), job.settings, folder=folder / "direct" / job.name)
    for _ in record(direct.resume(), direct):
        pass
    if direct.suggested_step() != outcome.step:
        return f"{job.name}: step {outcome.step} instead of {direct.suggested_step()}"
    result = read_mesh(folder / "out" / "results" / outcome.result)
    same = np.array_equal(result.vertices, direct.mesh_at(outcome.step).vertices)
    return "" if same else f"{job.name}: other vertices"
