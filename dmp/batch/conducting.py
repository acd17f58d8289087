"""From a list of jobs to their records: chooses a cluster, has the jobs done, and keeps how each one ended."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmp.batch.asking import Workers
from dmp.batch.cluster import Certificates, ClusterError, connect, local_client, wait_for_workers
from dmp.batch.doing import Done, Order, deliver, do_job
from dmp.batch.engine import Engine, Finished, Means, Work
from dmp.batch.folder import BatchFolder, Outcome, with_retries
from dmp.batch.jobs import BatchJob
from dmp.batch.memory import bytes_needed, free_bytes, most_vertices
from dmp.batch.parcel import unpack
from dmp.batch.versions import check_versions
from dmp.errors import RunError
from dmp.files import in_words

if TYPE_CHECKING:
    from distributed import Client

_SUFFIX = ".ply"


@dataclass(frozen=True)
class Place:
    """Where a batch is done.

    Attributes:
        scheduler: address of a cluster that is there; empty for one of our own on this computer.
        tls: files for an encrypted connection to it.
        n_workers: worker processes of our own cluster; 0 for as many as cores and memory allow.
        threads: processor threads of each job, when the settings say nothing; only to size our own cluster.
        gpu: whether each job needs a worker that was given a GPU.
    """

    scheduler: str = ""
    tls: Certificates | None = None
    n_workers: int = 0
    threads: int = 0
    gpu: bool = False


@dataclass(frozen=True)
class Watcher:
    """Who is told how a batch goes on, all in the thread that runs it.

    Attributes:
        began: called with the number of workers.
        told: called with the name of a job and the share of it that is done.
        ended: called with the name of a job and how it ended.
        said: called with a sentence on what is out of the ordinary.
    """

    began: Callable[[int], object] = lambda _count: None
    told: Callable[[str, float], object] = lambda _name, _share: None
    ended: Callable[[str, Outcome], object] = lambda _name, _outcome: None
    said: Callable[[str], object] = lambda _text: None


@dataclass
class Counted:
    """What came of a call of :func:`run_batch`."""

    done: int = 0
    failed: int = 0
    interrupted: bool = False
    retries: list[str] = field(default_factory=list)


def run_batch(
    jobs: Sequence[BatchJob],
    folder: Path,
    place: Place,
    *,
    suffix: str = _SUFFIX,
    keep: str = "auto",
    stop: threading.Event | None = None,
    watcher: Watcher | None = None,
    patience_seconds: float = 300.0,
    stall_seconds: float = 900.0,
) -> Counted:
    """Do all jobs that have no result yet, and keep how each one ended.

    Args:
        jobs: what to do.
        folder: where results go.
        place: where it is done.
        suffix: format of the restored meshes.
        keep: which step is saved: ``auto``, ``last`` or ``best``.
        stop: set it to end cleanly; the same call goes on where it stopped.
        watcher: who is told.
        patience_seconds: how long a scheduler that is gone is waited for.
        stall_seconds: after such a silence a worker is started anew.

    Raises:
        ClusterError: when there is no scheduler or worker, or one with another version of this program.
        RunError: when the folder cannot be written.
    """
    watcher, stop = watcher or Watcher(), stop or threading.Event()
    store, counted = BatchFolder(folder.absolute()), Counted()
    todo = [job for job in jobs if not store.is_done(job.name)]
    if not todo:
        return counted
    # The longest first, so that none is left over at the end.
    todo.sort(key=lambda job: -job.work)
    needs = {job.name: bytes_needed(most_vertices(job), job.settings) for job in todo}
    with _cluster(place, todo, needs, stop) as (connected, memory):
        client = connected()
        count = wait_for_workers(client, min(patience_seconds, 30.0))
        if not count:
            raise ClusterError(f"There is no worker at {place.scheduler}. Start one over there: dmp serve.")
        workers = Workers()
        # Those of our own cluster are this very program.
        for text in check_versions(client, workers) if place.scheduler else ():
            watcher.said(text)
        is_shared = sees_all(client, store.folder, {job.mesh.parent for job in todo}, workers)
        if not is_shared:
            watcher.said("The workers do not see these folders, so meshes are sent to them and runs are sent back.")
        watcher.began(count)
        means = Means(connected, memory, place.gpu, stall_seconds, patience_seconds)
        engine = Engine(means, stop=stop, told=watcher.told, said=watcher.said)
        order = Order(suffix, keep, secrets.token_hex(6))
        works = [_work(job, store, order, needs[job.name], is_shared=is_shared) for job in todo]
        by_name = {job.name: job for job in todo}
        for finished in engine.run(works):
            _keep(finished, by_name[finished.name], store, counted, watcher)
    counted.interrupted = stop.is_set()
    return counted


def workers_for(place: Place, jobs: Sequence[BatchJob], needs: dict[str, int], memory: int) -> int:
    """Return how many worker processes to start here: no more than cores, jobs, or what the memory holds of typical ones."""
    from dmp.devices import available_cores

    if place.n_workers:
        return min(place.n_workers, len(jobs))
    typical = sorted(needs[job.name] for job in jobs)[len(jobs) // 2]
    return max(1, min(available_cores() // max(1, place.threads), len(jobs), memory // max(1, typical)))


@contextmanager
def _cluster(
    place: Place, jobs: Sequence[BatchJob], needs: dict[str, int], stop: threading.Event
) -> Iterator[tuple[Callable[[], Client], int | None]]:
    """Yield how to connect to the cluster, and how much memory the work under way may need together."""
    if place.scheduler:
        opened: list[Client] = []

        def connected() -> Client:
            if opened and opened[-1].status == "running":
                return opened[-1]
            opened.append(connect(place.scheduler, place.tls))
            return opened[-1]

        try:
            yield connected, None
        finally:
            for client in opened:
                with suppress(Exception):
                    client.close(timeout=5)
        return
    memory = free_bytes()
    with local_client(workers_for(place, jobs, needs, memory)) as client:
        yield lambda: client, memory


def _work(job: BatchJob, store: BatchFolder, order: Order, memory: int, *, is_shared: bool) -> Work:
    def prepare() -> tuple[Any, ...]:
        if is_shared:
            return (job, store.folder, order)
        return (job, None, order, deliver(job, store.run_folder(job.name)))

    return Work(job.name, do_job, prepare, memory)


def _keep(finished: Finished, job: BatchJob, store: BatchFolder, counted: Counted, watcher: Watcher) -> None:
    """Write down how a job ended, its record last, so that what has a record is complete."""
    name, done = finished.name, finished.result
    counted.retries += [f"{name}: {text}" for text in finished.retries]
    if finished.interrupted is not None:
        if finished.interrupted.parcel:
            unpack(finished.interrupted.parcel, store.run_folder(name))
        return
    settings = job.settings
    outcome = Outcome(finished.failure, mesh=str(job.mesh), task=settings.task, preset=settings.preset, seed=settings.seed)
    if isinstance(done, Done):
        outcome = done.outcome
        if done.run:
            unpack(done.run, store.run_folder(name))
            outcome = replace(outcome, run=name)
        if done.result:
            store.write_file(store.folder / "results" / Path(outcome.result).name, done.result)
        if done.picture:
            store.write_file(store.picture(name), done.picture)
    elif not finished.failure:
        outcome = replace(outcome, failure="What the worker sent back is not a result.")
    outcome = with_retries(outcome, finished.retries)
    store.write(name, outcome)
    counted.failed += bool(outcome.failure)
    counted.done += not outcome.failure
    watcher.ended(name, outcome)


def sees_all(client: Client, folder: Path, others: set[Path], workers: Workers | None = None) -> bool:
    """Tell whether all workers that answer see a folder as this process does: they find there what was just written.

    Args:
        client: of the workers.
        folder: made if it is not there.
        others: folders that must be there as well.
        workers: knows those that do not answer.

    Raises:
        RunError: when the folder cannot be written.
        ClusterError: when the scheduler does not answer.
    """
    token = secrets.token_hex(16)
    mark = folder / f".seen-{token}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        mark.write_text(token)
    except OSError as error:
        raise RunError(f"{folder} cannot be written: {in_words(error)}. Name another folder with --out.") from error
    try:
        answers = (workers or Workers()).ask(client, finds, mark, token, sorted(others))
        return bool(answers) and all(answer is True for answer in answers.values())
    except TimeoutError as error:
        raise ClusterError("The scheduler does not answer any more.") from error
    finally:
        mark.unlink(missing_ok=True)


def finds(mark: Path, token: str, others: Sequence[Path]) -> bool:
    """Tell whether a file is here and holds ``token``, and whether other folders are here too; asked of workers."""
    try:
        return mark.read_text() == token and all(folder.is_dir() for folder in others)
    except OSError:
        return False
