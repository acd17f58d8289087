"""Restores many tiny meshes on two workers, one of which is killed by SIGKILL every 20 seconds, and some in worse trouble.

Every job ends with a result that is, bit for bit, the one of a direct run with the same seed, and every worker that was
killed at work is named in the summary. After that come rarer faults in turn: workers that are halted and perhaps go on
later, a mesh that no worker has the memory for, a full disk on the workers, a scheduler that restarts.
"""

from __future__ import annotations

import csv
import os
import signal
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from dmp.batch import conducting
from dmp.batch.asking import ask
from dmp.batch.cluster import local_client
from dmp.batch.conducting import Place, Watcher, run_batch
from dmp.batch.folder import BatchFolder
from dmp.batch.jobs import BatchJob, jobs_from_files
from dmp.batch.summary import write_summary
from dmp.errors import DmpError
from dmp.meshio import read_mesh, write_mesh
from dmp.problem import denoising
from dmp.runs import Run, record
from dmp.settings import settings_for
from tests.meshes import sphere_mesh
from tests.remote_server import served
from tests.soak import Result
from tests.soak.disks import _disk, _fill

FULL_SIZE = 200
KILL_EVERY_SECONDS = 20.0
MOST_KILLS = 10**9
# One of the other faults for so many jobs.
JOBS_FOR_A_FAULT = 10
_NAME = "batch jobs with killed workers, and other faults of clusters"
STEPS, _LONG_STEPS = 6000, 12000
# A mesh of 65,538 vertices needs more than a gigabyte; torch alone has 400 MB.
_LARGE, _LITTLE_MEMORY = 7, 700 * 2**20


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
            present = len(ask(client, os.getpid))
        failures = [f"{counted.failed} jobs failed"] if counted.failed else []
        write_summary(jobs, folder / "out")
        failures += _unnamed(folder / "out", killed)
        wrong = [text for job in jobs if (text := _difference(job, folder))]
        failures += [f"{present} of 2 workers are left"] if present != 2 else []
        n_faults = max(1, size // JOBS_FOR_A_FAULT)
        faulty = [text for number in range(n_faults) if (text := _fault(folder / f"fault{number}", number, seed))]
        note = (f"{len(killed)} workers were killed at work, {len(counted.retries)} retries; {n_faults} other faults",)
        passed = size - len(wrong) + n_faults - len(faulty)
        return Result(_NAME, passed, size + n_faults, (*failures, *wrong, *faulty, *note))


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


def _fault(folder: Path, number: int, seed: int) -> str:
    """Restore three meshes while a fault happens; return what went wrong, empty when nothing did."""
    kind = (_with_halted_workers, _with_little_memory, _with_full_disk, _with_restart)[number % 4]
    generator = np.random.default_rng([seed, 1, number])
    folder.mkdir()
    _write_inputs(folder / "scans", 3, seed + number)
    jobs = jobs_from_files([str(folder / "scans")], _settings(number), None)
    try:
        wrong = kind(folder, jobs, generator)
    except DmpError as error:
        wrong = [str(error)]
    return f"{number}, {kind.__name__[1:].replace('_', ' ')}: {'; '.join(wrong)}" if wrong else ""


def _with_halted_workers(folder: Path, jobs: list[BatchJob], generator: np.random.Generator) -> list[str]:
    """Halt a worker, at work or not, in each of several batches in one cluster; half of them go on after a while."""
    wrong: list[str] = []
    halted: list[int] = []
    with local_client(2) as client:
        for turn in range(3):
            pids = ask(client, os.getpid)
            victim = sorted(pids.values())[int(generator.integers(len(pids)))]
            timers = [threading.Timer(float(generator.uniform(0, 4)), _send, (victim, signal.SIGSTOP))]
            timers += [threading.Timer(float(generator.uniform(5, 40)), _send, (victim, signal.SIGCONT))] * (turn % 2)
            halted.append(victim)
            for timer in timers:
                timer.start()
            out = folder / f"turn{turn}"
            try:
                counted = run_batch(jobs, out / "out", Place(scheduler=client.scheduler.address), stall_seconds=10)
            finally:
                for timer in timers:
                    timer.cancel()
            wrong += [f"in turn {turn} {counted.failed} jobs failed"] if counted.failed else []
            wrong += [text for job in jobs if (text := _difference(job, out))]
    for pid in halted:
        _send(pid, signal.SIGKILL)
    return wrong


def _with_little_memory(folder: Path, jobs: list[BatchJob], _: np.random.Generator) -> list[str]:
    """Restore a mesh that the workers have no memory for, among others."""
    ball = sphere_mesh(_LARGE)
    (folder / "large").mkdir()
    write_mesh(folder / "large" / "large.ply", ball)
    [large] = jobs_from_files([str(folder / "large")], settings_for("denoise", steps=STEPS, threads=1), None)
    with local_client(2, memory_limit=_LITTLE_MEMORY) as client:
        counted = run_batch([*jobs, large], folder / "out", Place(scheduler=client.scheduler.address))
    wrong = [] if counted.failed == 1 else [f"{counted.failed} jobs failed"]
    outcome = BatchFolder(folder / "out").read(large.name)
    if outcome is None or "memory" not in outcome.failure or len(outcome.retries) < 4:
        wrong.append(f"the large one ended as {outcome}")
    return wrong + [text for job in jobs if (text := _difference(job, folder))]


def _with_full_disk(folder: Path, jobs: list[BatchJob], generator: np.random.Generator) -> list[str]:
    """Let the disk be full that workers elsewhere work on; with room again the same call does everything."""
    (folder / "disks").mkdir()
    with _disk(folder / "disks") as disk:
        if disk is None:
            return []
        _fill(disk, int(generator.integers(0, 60_000)))
        with (
            local_client(2, environment={"TMPDIR": str(disk)}) as client,
            mock.patch.object(conducting, "sees_all", lambda *_: False),
        ):
            place = Place(scheduler=client.scheduler.address)
            counted = run_batch(jobs, folder / "out", place)
            outcomes = [BatchFolder(folder / "out").read(job.name) for job in jobs]
            wrong = [f"{counted.done} were done on a full disk"] if counted.done else []
            wrong += [
                f"the reason is '{outcome and outcome.failure}'"
                for outcome in outcomes
                if outcome is None or "the disk is full" not in outcome.failure
            ]
            (disk / "filler").unlink()
            # One at a time: the disk holds a run or two.
            again = [run_batch([job], folder / "out", place).done for job in jobs]
            wrong += ["with room again it failed"] if again != [1] * len(jobs) else []
    return wrong + [text for job in jobs if (text := _difference(job, folder))]


def _with_restart(folder: Path, jobs: list[BatchJob], generator: np.random.Generator) -> list[str]:
    """End the scheduler with its workers when a job is under way, and start another one at the same address."""
    # How far a job is, is told about once a second: these are far from over when it is told.
    jobs = [replace(job, settings=replace(job.settings, steps=_LONG_STEPS)) for job in jobs]
    reached, done, ports = threading.Event(), threading.Event(), list[int]()
    at = float(generator.uniform(0.1, 0.8))
    for name in ("first", "second"):
        (folder / name).mkdir()

    def serve() -> None:
        with served(folder / "first") as port:
            ports.append(port)
            reached.wait(120)
        with served(folder / "second", port=port):
            done.wait(300)

    serving = threading.Thread(target=serve)
    serving.start()
    try:
        while not ports:
            done.wait(0.1)
        watcher = Watcher(told=lambda _name, share: reached.set() if share > at else None)
        counted = run_batch(jobs, folder / "out", Place(scheduler=f"127.0.0.1:{ports[0]}"), watcher=watcher)
    finally:
        reached.set()
        done.set()
        serving.join(60)
    wrong = [f"{counted.failed} jobs failed"] if counted.failed else []
    wrong += [] if any("scheduler" in text for text in counted.retries) else [f"only this is said of it: {counted.retries}"]
    return wrong + [text for job in jobs if (text := _difference(job, folder))]


def _send(pid: int, number: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, number)
