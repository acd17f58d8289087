"""What runs on a worker around each piece of work: one at a time, told how far it is, and ended when nobody wants it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

# Trainings of one process share torch's thread count, so two at once would change each other's last digits.
_ONE_AT_A_TIME = threading.Lock()
_STOPPED: set[str] = set()
_TOLD_EVERY_SECONDS = 1.0
_LOOKED_EVERY_SECONDS = 0.25


@dataclass(frozen=True, eq=False)
class Ended:
    """The end of a piece of work that was asked to stop early.

    Attributes:
        parcel: what it has so far, when that does not lie where the one who asked can see it.
    """

    parcel: bytes = b""


class Attendance:
    """The worker's side of one attempt: how to tell how far it is, and whether it is still wanted.

    Args:
        batch: who asked for it; the topic of what is told.
        name: of the piece of work.
    """

    def __init__(self, batch: str, name: str) -> None:
        from distributed import get_worker
        from distributed.worker import thread_state

        self._batch, self._name = batch, name
        self._worker, self._key = get_worker(), thread_state.key
        self._looked = self._told = 0.0
        self._wanted = True

    def tell(self, share: float) -> None:
        """Tell the share that is done, at most once a second."""
        now = time.monotonic()
        if now - self._told >= _TOLD_EVERY_SECONDS:
            self._told = now
            self._worker.log_event(self._batch, {"name": self._name, "share": float(share)})

    def tell_who(self) -> None:
        """Tell which worker begins."""
        self._worker.log_event(self._batch, {"name": self._name, "share": 0.0, "worker": self._worker.address})

    def should_stop(self) -> bool:
        """Tell whether to stop: asked to, given up by the scheduler, or on a worker that is closing."""
        now = time.monotonic()
        if now - self._looked >= _LOOKED_EVERY_SECONDS:
            self._looked = now
            self._wanted = self._is_wanted()
        return not self._wanted or self._batch in _STOPPED

    def _is_wanted(self) -> bool:
        # After a lost connection the scheduler may have given the work to another worker, while this thread goes on.
        task = self._worker.state.tasks.get(self._key)
        is_alive = self._worker.status.name in ("running", "paused", "init", "closing_gracefully")
        return is_alive and task is not None and task.state in ("executing", "long-running", "resumed")


@contextmanager
def one_at_a_time(should_stop: Callable[[], bool]) -> Iterator[bool]:
    """Wait until this process does nothing else; yield False when ``should_stop`` said so meanwhile."""
    while not _ONE_AT_A_TIME.acquire(timeout=0.2):
        if should_stop():
            yield False
            return
    try:
        yield True
    finally:
        _ONE_AT_A_TIME.release()


def threads_here(workers_by_host: Mapping[str, int]) -> int:
    """Return the threads of a training on this worker: its share of the cores of the machine."""
    from distributed import get_worker
    from distributed.comm.addressing import get_address_host

    from dmp.devices import available_cores

    host = get_address_host(get_worker().address)
    return max(1, available_cores() // max(1, workers_by_host.get(host, 1)))


def attend(batch: str, name: str, function: Callable[..., Any], arguments: tuple, workers_by_host: Mapping[str, int]) -> Any:
    """Call ``function(*arguments, threads=…, stop=…, told=…)`` on a worker.

    Args:
        batch: who asked for it.
        name: of the piece of work.
        function: what to do; it may raise :class:`dmp.batch.doing.Interrupted`.
        arguments: of it.
        workers_by_host: how many workers share the cores of a machine.

    Returns:
        What the function returned, or :class:`Ended`.
    """
    from dmp.batch.doing import Interrupted

    attendance = Attendance(batch, name)
    with one_at_a_time(attendance.should_stop) as is_our_turn:
        if not is_our_turn:
            return Ended()
        attendance.tell_who()
        try:
            threads = threads_here(workers_by_host)
            return function(*arguments, threads=threads, stop=attendance.should_stop, told=attendance.tell)
        except Interrupted as error:
            return Ended(error.parcel)


def ask_to_stop(batch: str) -> None:
    """Let this process end what it does for ``batch`` after the step it is in, and begin nothing more for it."""
    _STOPPED.add(batch)
