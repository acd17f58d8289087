"""Has pieces of work done by the workers of a dask cluster: each ends once, with its result or with the reason why not.

Which worker does what, and what becomes of the work of a worker that died, is decided by dask. What is done here is what
dask leaves to its user: handing out no more than there are workers, so that the memory of this process does not grow with
the list; naming each retry; giving up a worker that does not move, whether it has begun or not; asking again after the
scheduler was lost.
"""

from __future__ import annotations

import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from dmp.batch.asking import ask, start_anew
from dmp.batch.attending import Ended, ask_to_stop, attend
from dmp.batch.cluster import GPU, ClusterError
from dmp.errors import DmpError

if TYPE_CHECKING:
    from distributed import Client, Future

_POLL_SECONDS = 0.1
_LOOK_SECONDS = 1.0
# Workers give a sign of life every second or so. One that gives none for so long is handed no work, and what was handed to it
# and has not begun is taken away.
_SILENT_SECONDS = 30.0
# So long a scheduler is waited for that is asked how many workers there are, and a worker that is asked to stop.
_ANSWER_SECONDS, _STOP_ANSWER_SECONDS = 30.0, 2.0
# A worker that was to be started anew and is still there after so long is to be started anew again.
_AGAIN_SECONDS = 60.0
# Work that kills whoever does it is given up; work that came so much further meanwhile is not to blame.
_PROGRESS = 0.02


@dataclass(frozen=True)
class Work:
    """One piece of work.

    Attributes:
        name: unique in its list.
        function: called on a worker as ``function(*arguments, threads=…, stop=…, told=…)``; found there by its name, so
            it stands in a module.
        prepare: called here at the moment it is handed out; returns the arguments.
        memory: bytes that it needs; 0 when that does not matter.
    """

    name: str
    function: Callable[..., Any]
    prepare: Callable[[], tuple]
    memory: int = 0


@dataclass(frozen=True)
class Finished:
    """The end of a piece of work.

    Attributes:
        name: of it.
        result: what the function returned; None when there is a failure or it was interrupted.
        failure: why there is no result, in a sentence.
        interrupted: what it has so far, when it was stopped; None otherwise.
        retries: one sentence for each attempt that came to nothing.
    """

    name: str
    result: Any = None
    failure: str = ""
    interrupted: Ended | None = None
    retries: tuple[str, ...] = ()


@dataclass(frozen=True)
class Means:
    """With what, and how patiently.

    Attributes:
        connect: returns a client of the cluster; called again when the scheduler was lost.
        memory: bytes that the work under way may need together; None when each worker looks after itself.
        gpu: whether each piece of work needs a worker with a GPU of its own.
        stall_seconds: after such a silence an attempt counts as stalled, and its worker is started anew.
        patience_seconds: how long a scheduler or workers that are gone are waited for.
        stop_seconds: how long work that was asked to stop is waited for.
    """

    connect: Callable[[], Client]
    memory: int | None = None
    gpu: bool = False
    stall_seconds: float = 900.0
    patience_seconds: float = 300.0
    stop_seconds: float = 60.0


@dataclass
class _Attempt:
    work: Work
    future: Future
    retries: list[str]
    heard: float
    # How far any attempt came before this one was handed out, and by now.
    before: float = 0.0
    furthest: float = 0.0
    # Which worker has begun it, and how far it is.
    worker: str = ""
    share: float = 0.0
    # When its worker was given up, 0 for never.
    given_up: float = 0.0


@dataclass
class _State:
    waiting: deque[Work]
    under_way: dict[str, _Attempt] = field(default_factory=dict)
    # Retries of work that waits again, and how far it came.
    earlier: dict[str, tuple[list[str], float]] = field(default_factory=dict)

    def give_back(self, attempt: _Attempt) -> None:
        """Let a piece of work wait again, before all others."""
        name = attempt.work.name
        del self.under_way[name]
        self.waiting.appendleft(attempt.work)
        self.earlier[name] = (attempt.retries, attempt.furthest)


class Engine:
    """Has a list of work done by a cluster.

    Args:
        means: with what.
        stop: set it, and no more is begun and what is under way ends after its step.
        told: called with a name and the share that is done, in the thread that asks for the results.
        said: called with a sentence on what is out of the ordinary.
    """

    def __init__(
        self,
        means: Means,
        *,
        stop: threading.Event | None = None,
        told: Callable[[str, float], object] = lambda _name, _share: None,
        said: Callable[[str], object] = lambda _text: None,
    ) -> None:
        self._means = means
        self._stop = stop or threading.Event()
        self._told, self._said = told, said
        self._batch = f"dmp-{uuid.uuid4().hex[:12]}"
        self._events: SimpleQueue[Any] = SimpleQueue()
        self._client: Client | None = None
        self._connection: Any = None
        self._slots, self._hosts = 0, {"": 0}
        self._looked = self._seen_workers = 0.0
        # By the address of a worker: its last sign of life by the scheduler's clock, and by ours when that was new.
        self._signs: dict[str, tuple[float, float]] = {}
        self._stop_began: float | None = None

    def run(self, works: Sequence[Work]) -> Iterator[Finished]:
        """Yield the end of each piece of work, as it comes; of those that were not begun when it was stopped, nothing.

        Raises:
            ClusterError: when the scheduler, or the last worker, is gone for good.
            DmpError: what ``prepare`` of a work raises that it did not mean for the work alone.
        """
        state = _State(deque(works))
        self._open()
        try:
            while state.under_way or (state.waiting and not self._stop.is_set()):
                self._look_after_connection(state)
                if self._stop.is_set():
                    self._press_to_stop(state)
                else:
                    yield from self._hand_out(state)
                time.sleep(_POLL_SECONDS)
                self._listen(state)
                self._give_up_stalled(state)
                yield from self._collect(state)
        finally:
            self._close(state)

    # -- the connection -----------------------------------------------------------------------------------------------

    def _open(self) -> None:
        self._client = client = self._means.connect()
        self._listen_to(client)

    def _listen_to(self, client: Client) -> None:
        self._connection = client.scheduler_comm
        client.subscribe_topic(self._batch, self._events.put)
        client.subscribe_topic("all", self._events.put)
        self._seen_workers = time.monotonic()
        self._looked = 0.0

    def _close(self, state: _State) -> None:
        client, self._client = self._client, None
        if client is None:
            return
        with suppress(Exception):
            if state.under_way and client.status == "running":
                ask(client, ask_to_stop, self._batch, seconds=_STOP_ANSWER_SECONDS)
                client.cancel([attempt.future for attempt in state.under_way.values()])
            client.unsubscribe_topic("all")
            client.unsubscribe_topic(self._batch)
        with suppress(Exception):
            client.close(timeout=5)

    def _look_after_connection(self, state: _State) -> None:
        client = self._client
        assert client is not None
        if client.status == "running" and client.scheduler_comm is not self._connection:
            # dask has connected again by itself, perhaps to another scheduler, which does not know what we listen to.
            with suppress(Exception):
                self._listen_to(client)
                self._said("The connection to the scheduler was lost, and is there again.")
        if client.status in ("connecting", "running"):
            return
        self._said("The scheduler does not answer any more. Waiting for it to come back …")
        with suppress(Exception):
            client.close(timeout=1)
        deadline = time.monotonic() + self._means.patience_seconds
        while True:
            try:
                self._open()
                return
            except ClusterError as error:
                if self._stop.is_set() or time.monotonic() > deadline:
                    self._client = None
                    state.under_way.clear()
                    raise ClusterError(f"{error} What is done is kept: the same command goes on from there.") from error
                time.sleep(1.0)

    def _count_workers(self) -> int:
        """Return how much can be done at once, looked up once a second."""
        client, now = self._client, time.monotonic()
        if client is None or client.status != "running" or now - self._looked < _LOOK_SECONDS:
            return self._slots
        self._looked = now
        with suppress(Exception):
            known = client.sync(client.scheduler.identity, n_workers=-1, callback_timeout=_ANSWER_SECONDS)["workers"]
            workers, silent = known.values(), self._silent(known)
            able = [w for address, w in known.items() if w["status"] == "running" and address not in silent]
            if self._means.gpu:
                self._slots = int(sum(worker["resources"].get(GPU, 0) for worker in able))
            else:
                self._slots = len(able)
            hosts: dict[str, int] = {}
            for worker in workers:
                hosts[worker["host"]] = hosts.get(worker["host"], 0) + 1
            self._hosts = hosts
        if self._slots:
            self._seen_workers = now
        elif now - self._seen_workers > self._means.patience_seconds:
            what = "worker with a GPU (start it with --resources GPU=1)" if self._means.gpu else "worker"
            raise ClusterError(
                f"There is no {what} at the scheduler. What is done is kept: the same command goes on from there."
            )
        return self._slots

    def _silent(self, known: dict[str, dict[str, Any]] | None = None) -> set[str]:
        """Return the workers that gave no sign of life for long; ``known`` brings the signs up to date."""
        now = time.monotonic()
        if known is not None:
            before = self._signs
            self._signs = {
                address: before[address]
                if before.get(address, (None,))[0] == worker["last_seen"]
                else (worker["last_seen"], now)
                for address, worker in known.items()
            }
        # By the scheduler's clock it is seen at once who was silent long before we came, if another one was not.
        newest = max((sign for sign, _ in self._signs.values()), default=0.0)
        return {
            address
            for address, (sign, when) in self._signs.items()
            if now - when > _SILENT_SECONDS or newest - sign > _SILENT_SECONDS
        }

    # -- work -----------------------------------------------------------------------------------------------------------

    def _hand_out(self, state: _State) -> Iterator[Finished]:
        client = self._client
        if client is None or client.status != "running":
            return
        while state.waiting and len(state.under_way) < self._count_workers():
            work = self._next_that_fits(state)
            if work is None:
                return
            retries, furthest = state.earlier.pop(work.name, ([], 0.0))
            try:
                arguments = work.prepare()
            except DmpError as error:
                yield Finished(work.name, failure=str(error), retries=tuple(retries))
                continue
            future = client.submit(
                attend, self._batch, work.name, work.function, arguments, self._hosts,
                key=f"{self._batch}/{work.name}", pure=False, resources={GPU: 1} if self._means.gpu else None,
            )  # fmt: skip
            state.under_way[work.name] = _Attempt(work, future, retries, time.monotonic(), furthest, furthest)

    def _next_that_fits(self, state: _State) -> Work | None:
        """Return the next work for which there is memory beside what is under way; one alone is always tried."""
        if self._means.memory is None or not state.under_way:
            return state.waiting.popleft()
        left = self._means.memory - sum(attempt.work.memory for attempt in state.under_way.values())
        fitting = next((work for work in state.waiting if work.memory <= left), None)
        if fitting is not None:
            state.waiting.remove(fitting)
        return fitting

    def _listen(self, state: _State) -> None:
        while True:
            try:
                _, event = self._events.get_nowait()
            except Empty:
                return
            if event.get("action") == "remove-worker":
                self._note_lost_worker(state, event)
            attempt = state.under_way.get(event.get("name", ""))
            if attempt is not None and "share" in event:
                attempt.heard, attempt.share = time.monotonic(), event["share"]
                attempt.furthest = max(attempt.furthest, attempt.share)
                attempt.worker = event.get("worker", attempt.worker)
                self._told(attempt.work.name, attempt.share)

    def _note_lost_worker(self, state: _State, event: dict[str, Any]) -> None:
        lost = {str(key) for key in event.get("processing-tasks", ())} | {str(k) for k in event.get("lost-computed-tasks", ())}
        for attempt in state.under_way.values():
            if str(attempt.future.key) not in lost:
                continue
            share = f" at {attempt.share:.0%}" if attempt.worker == event.get("worker") and attempt.share else ""
            what = "did not move any more and was started anew" if attempt.given_up else "was lost"
            attempt.retries.append(f"{time.strftime('%H:%M:%S')}: the worker {event.get('worker')} {what}{share}")
            attempt.worker, attempt.given_up, attempt.heard, attempt.share = "", 0.0, time.monotonic(), 0.0
            self._said(f"{attempt.work.name}: the worker {event.get('worker')} {what}{share}; another one goes on.")

    def _give_up_stalled(self, state: _State) -> None:
        client, now = self._client, time.monotonic()
        if client is None or client.status != "running":
            return
        waiting: list[_Attempt] = []
        for attempt in state.under_way.values():
            if attempt.given_up and now - attempt.given_up < _AGAIN_SECONDS:
                continue
            if not attempt.worker:
                waiting.append(attempt)
            elif attempt.given_up or now - attempt.heard > self._means.stall_seconds:
                attempt.given_up = now
                start_anew(client, attempt.worker)
        if silent := self._silent() if waiting else set():
            self._take_from(silent, waiting, client)

    def _take_from(self, silent: set[str], waiting: Sequence[_Attempt], client: Client) -> None:
        """Start workers anew that have work lying before them, and give no sign of life."""
        try:
            given: dict[str, list[Any]] = client.sync(
                client.scheduler.processing, workers=None, callback_timeout=_ANSWER_SECONDS
            )
        except Exception:  # the scheduler went meanwhile; the next look tells
            return
        by_key = {str(attempt.future.key): attempt for attempt in waiting}
        for address in silent:
            stuck = [by_key[str(key)] for key in given.get(address, ()) if str(key) in by_key]
            for attempt in stuck:
                attempt.given_up = time.monotonic()
            if stuck:
                start_anew(client, address)

    def _collect(self, state: _State) -> Iterator[Finished]:
        for attempt in list(state.under_way.values()):
            status = attempt.future.status
            if status == "pending":
                continue
            if status in ("cancelled", "lost"):
                attempt.retries.append(f"{time.strftime('%H:%M:%S')}: the scheduler was lost")
                state.give_back(attempt)
                continue
            finished = self._ended(attempt, state)
            if finished is not None:
                del state.under_way[attempt.work.name]
                attempt.future.release()
                yield finished

    def _ended(self, attempt: _Attempt, state: _State) -> Finished | None:
        """Return the end of an attempt; None when its result was lost on the way and is made again."""
        from distributed.scheduler import KilledWorker

        name = attempt.work.name
        try:
            result = attempt.future.result(timeout=120)
        except TimeoutError:
            return None
        except Exception as error:  # whatever it was, this work has ended, and the others go on
            if attempt.future.status in ("cancelled", "lost"):
                return None
            self._listen(state)
            if isinstance(error, KilledWorker) and attempt.furthest > attempt.before + _PROGRESS:
                # It loses its workers to others' misfortunes, and comes nearer to its end all the same.
                state.give_back(attempt)
                return None
            return Finished(name, failure=_reason(error), retries=tuple(attempt.retries))
        # What the scheduler told before the end of the work lies in the queue by now.
        self._listen(state)
        if isinstance(result, Ended):
            if not self._stop.is_set():
                # Its worker was closed, and nobody here wanted that.
                attempt.retries.append(f"{time.strftime('%H:%M:%S')}: the worker {attempt.worker} was closed")
                state.give_back(attempt)
                return None
            return Finished(name, interrupted=result, retries=tuple(attempt.retries))
        return Finished(name, result, retries=tuple(attempt.retries))

    def _press_to_stop(self, state: _State) -> None:
        """Ask the workers to stop, again and again, because one may have come anew; after a while let go."""
        client, now = self._client, time.monotonic()
        if client is None:
            return
        if self._stop_began is None:
            self._stop_began = now
        elif now - self._looked < _LOOK_SECONDS:
            return
        self._looked = now
        if now - self._stop_began > self._means.stop_seconds:
            state.under_way.clear()
            return
        with suppress(Exception):
            ask(client, ask_to_stop, self._batch, seconds=_STOP_ANSWER_SECONDS)


def _reason(error: BaseException) -> str:
    """Return why a piece of work has no result, in a sentence."""
    from distributed.scheduler import KilledWorker, NoValidWorkerError

    if isinstance(error, KilledWorker):
        died = getattr(error, "allowed_failures", 3) + 1
        last = getattr(getattr(error, "last_worker", None), "address", "")
        return (
            f"{died} workers were lost while they did it, the last one {last}. Perhaps its memory ran out: use a machine with "
            "more, or fewer workers at once."
        )
    if isinstance(error, NoValidWorkerError):
        return "No worker may do it. Start workers with the resources that it needs."
    if isinstance(error, DmpError):
        return str(error)
    if isinstance(error, MemoryError) or "out of memory" in str(error).lower():
        return "There was not enough memory for it. Use a machine with more, or fewer workers at once."
    text = " ".join(str(error).split())[:300].rstrip(".")
    return f"This is a fault of the program or of the worker: {type(error).__name__}: {text}."
