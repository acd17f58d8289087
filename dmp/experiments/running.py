"""Have a list of jobs done, one after the other or spread over processes.

Whoever runs jobs needs only :func:`dmp.experiments.doing.do_job`; another engine would stand beside these two.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from queue import Empty
from types import FrameType
from typing import Any

from dmp.errors import RunError
from dmp.experiments.doing import Interrupted, do_job
from dmp.experiments.jobs import Job
from dmp.experiments.store import JobRecord, Store

# So often the processes tell how far they are.
_INTERVAL_SECONDS = 0.5


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
    jobs: Sequence[Job], store: Store, *, n_processes: int = 1, threads: int = 0, told: Told = lambda _progress: None
) -> bool:
    """Do all jobs that are not done yet.

    Args:
        jobs: what to do; those done are skipped without a word.
        store: where records are kept.
        n_processes: how many work at once.
        threads: processor threads of each training; 0 divides the cores among the processes.
        told: called in this thread as work goes on.

    Returns:
        False when it was interrupted (SIGINT or SIGTERM); the same call goes on where it stopped.

    Raises:
        RunError: when records cannot be written, or a process died.
    """
    from dmp.devices import available_cores

    waiting = [job for job in jobs if not store.is_done(job)]
    means = _Means(store, min(n_processes, len(waiting)), threads or max(1, available_cores() // max(1, n_processes)))
    run = _in_this_process if means.n_processes <= 1 else _in_processes
    with _interruption() as stop:
        run(waiting, means, stop, told)
        return not stop.is_set()


@dataclass(frozen=True)
class _Means:
    store: Store
    n_processes: int
    threads: int


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


_worker: dict[str, Any] = {}


def _begin_worker(folder: str, threads: int, stop: Any, queue: Any) -> None:
    # The parent alone decides what an interruption means; a terminal sends it to all.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _worker.update(store=Store(Path(folder)), threads=threads, stop=stop, queue=queue)


def _work(number: int, job: Job) -> JobRecord | None:
    if _worker["stop"].is_set():
        return None
    queue = _worker["queue"]
    last = [0.0]
    queue.put((number, 0.0))

    def tell(share: float) -> None:
        if share - last[0] >= 0.01:
            last[0] = share
            queue.put((number, share))

    try:
        return do_job(job, _worker["store"], threads=_worker["threads"], stop=_worker["stop"].is_set, told=tell)
    except Interrupted:
        return None


def _in_processes(jobs: Sequence[Job], means: _Means, stop: threading.Event, told: Told) -> None:
    # Forking a process that has loaded torch can hang its threads.
    context = get_context("spawn")
    shared_stop, queue = context.Event(), context.Queue()
    beginning = (str(means.store.folder), means.threads, shared_stop, queue)
    with ProcessPoolExecutor(means.n_processes, context, initializer=_begin_worker, initargs=beginning) as pool:
        pending: dict[Future[JobRecord | None], Job] = {}
        try:
            # The longest first, so that none is left over at the end.
            for number in sorted(range(len(jobs)), key=lambda index: -jobs[index].work):
                pending[pool.submit(_work, number, jobs[number])] = jobs[number]
            while pending:
                finished, _ = wait(pending, timeout=_INTERVAL_SECONDS, return_when=FIRST_COMPLETED)
                for number, share in _drained(queue):
                    told(Progress(jobs[number], share))
                for future in finished:
                    job = pending.pop(future)
                    record = None if future.cancelled() else future.result()
                    if record is not None:
                        told(Progress(job, 1.0, record))
                if stop.is_set() and not shared_stop.is_set():
                    shared_stop.set()
                    for future in pending:
                        future.cancel()
        except BrokenProcessPool as error:
            raise RunError(
                "A process of the experiment was ended from outside, perhaps because memory ran out. What is done is kept: "
                "start the same command again, with a smaller --jobs."
            ) from error
        finally:
            shared_stop.set()


def _drained(queue: Any) -> Iterator[tuple[int, float]]:
    while True:
        try:
            yield queue.get_nowait()
        except Empty:
            return


@contextmanager
def _interruption() -> Iterator[threading.Event]:
    """Yield an event that the first SIGINT or SIGTERM sets; a second one ends the process in the ordinary way."""
    stop = threading.Event()

    def note(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    try:
        before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:
        # Not the main thread: whoever called us handles signals.
        yield stop
        return
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
