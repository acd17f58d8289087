"""Have a list of jobs done, one after the other, or by the workers of a dask cluster, here or elsewhere."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmp.errors import RunError
from dmp.experiments.doing import Interrupted, do_job
from dmp.experiments.jobs import Job
from dmp.experiments.store import JobRecord, Store
from dmp.interruption import interruption

if TYPE_CHECKING:
    from dmp.batch.cluster import Certificates
    from dmp.batch.engine import Finished


@dataclass(frozen=True)
class Progress:
    """What happened: a job has begun, has come so far, or is done.

    Attributes:
        job: which one.
        share: of it that is done, 0 to 1.
        record: its record, when it is done.
    """

    job: Job
    share: float
    record: JobRecord | None = None


Told = Callable[[Progress], object]


def run_jobs(
    jobs: Sequence[Job],
    store: Store,
    *,
    n_processes: int = 1,
    threads: int = 0,
    scheduler: str = "",
    tls: Certificates | None = None,
    told: Told = lambda _progress: None,
) -> bool:
    """Do all jobs that are not done yet.

    Args:
        jobs: what to do; those done are skipped without a word.
        store: where records are kept.
        n_processes: how many work at once.
        threads: processor threads of each training; 0 divides the cores among the processes.
        scheduler: address of a cluster that does the work instead; it must see the store and the meshes.
        tls: files for an encrypted connection to it.
        told: called in this thread as work goes on.

    Returns:
        False when it was interrupted (SIGINT, SIGTERM or SIGHUP); the same call goes on where it stopped.

    Raises:
        RunError: when records cannot be written.
        ClusterError: when the scheduler cannot be reached.
    """
    from dmp.devices import available_cores

    waiting = [job for job in jobs if not store.is_done(job)]
    if not scheduler:
        threads = threads or max(1, available_cores() // max(1, n_processes))
    means = _Means(store, min(n_processes, len(waiting)), threads, scheduler, tls)
    run = _in_this_process if not waiting or (means.n_processes <= 1 and not scheduler) else _on_cluster
    with interruption() as stop:
        run(waiting, means, stop, told)
        return not stop.is_set()


@dataclass(frozen=True)
class _Means:
    store: Store
    n_processes: int
    threads: int
    scheduler: str
    tls: Certificates | None


def _in_this_process(jobs: Sequence[Job], means: _Means, stop: threading.Event, told: Told) -> None:
    for job in jobs:
        if stop.is_set():
            return
        told(Progress(job, 0.0))
        last = [0.0]

        def tell(share: float, job: Job = job, last: list[float] = last) -> None:
            if share - last[0] >= 0.005:
                last[0] = share
                told(Progress(job, share))

        try:
            record = do_job(job, means.store, threads=means.threads, stop=stop.is_set, told=tell)
        except Interrupted:
            return
        told(Progress(job, 1.0, record))


def do_on_worker(job: Job, folder: Path, wanted_threads: int, **how: Any) -> JobRecord:
    """Do a job on a worker of a dask cluster; see :func:`dmp.batch.attending.attend` for ``how`` it is called.

    Raises:
        dmp.batch.doing.Interrupted: when it was asked to stop.
    """
    from dmp.batch import doing

    try:
        return do_job(job, Store(folder), threads=wanted_threads or how["threads"], stop=how["stop"], told=how["told"])
    except Interrupted as error:
        raise doing.Interrupted from error


def _on_cluster(jobs: Sequence[Job], means: _Means, stop: threading.Event, told: Told) -> None:
    from dmp.batch.cluster import ClusterError, connect, local_client, wait_for_workers
    from dmp.batch.conducting import sees_all
    from dmp.batch.engine import Engine, Means, Work
    from dmp.batch.versions import check_versions

    # The longest first, so that none is left over at the end.
    ordered = sorted(jobs, key=lambda job: -job.work)
    by_name = {job.name: job for job in ordered}
    folder = means.store.folder.absolute()

    def work(job: Job) -> Work:
        return Work(job.name, do_on_worker, lambda: (_with_full_paths(job), folder, means.threads))

    def tell(name: str, share: float) -> None:
        told(Progress(by_name[name], share))

    if means.scheduler:

        def connected() -> Any:
            return connect(means.scheduler, means.tls)

        client = connected()
        try:
            if not wait_for_workers(client, 30.0):
                raise ClusterError(f"There is no worker at {means.scheduler}. Start one over there: dmp serve.")
            check_versions(client)
            if not sees_all(client, folder, {Path(path).parent for job in ordered for path in _files_of(job)}):
                raise RunError(
                    f"The workers at {means.scheduler} do not see {folder} or the meshes. An experiment needs a folder that "
                    "both ends see under the same path; 'dmp batch' does not."
                )
        finally:
            client.close(timeout=5)
        _collect(Engine(Means(connected), stop=stop, told=tell).run([work(job) for job in ordered]), by_name, means, told)
        return
    with local_client(means.n_processes) as client:
        engine = Engine(Means(lambda: client), stop=stop, told=tell)
        _collect(engine.run([work(job) for job in ordered]), by_name, means, told)


def _collect(ended: Iterator[Finished], by_name: Mapping[str, Job], means: _Means, told: Told) -> None:
    for finished in ended:
        job = by_name[finished.name]
        if finished.interrupted is not None:
            continue
        record = finished.result
        if not isinstance(record, JobRecord):
            # Whoever was to keep a record of it is gone.
            record = JobRecord(failure=finished.failure or "What the worker sent back is not a record.")
            means.store.write(job, record)
        told(Progress(job, 1.0, record))


def _files_of(job: Job) -> list[str]:
    case = job.case
    return [str(Path(path).absolute()) for path in (case.damaged, None if case.is_shape else case.truth) if path is not None]


def _with_full_paths(job: Job) -> Job:
    """Return the same job for a process in another folder."""
    case = job.case
    damaged = None if case.damaged is None else str(Path(case.damaged).absolute())
    truth = case.truth if case.is_shape else str(Path(case.truth).absolute())
    return replace(job, case=replace(case, damaged=damaged, truth=truth))
