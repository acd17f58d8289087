"""Work that would freeze the window (reading files, smoothing), done in a thread of its own, one piece after the other.

The thread knows two queues and nothing else: no Qt object that could be gone when a piece of work ends late. Once closed,
nothing is begun any more, whoever asks for it; otherwise a late signal of a window that closes would start a new thread.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

from qtpy.QtCore import QCoreApplication, QObject, QTimer, Signal

from dmp_viewer.left_behind import LeavableThread

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class _Job:
    work: Callable[[], Any]
    done: Callable[[Any], None]
    failed: Callable[[Exception], None]


class Background(QObject):
    """Runs functions off the GUI thread and reports their results in it.

    Signals:
        busyChanged: a text that says what is being done, empty when nothing is.
    """

    busyChanged = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._pending = 0
        self._thread: LeavableThread | None = None
        self._ended = threading.Event()
        self._timer = QTimer(self)
        self._timer.setInterval(15)
        self._timer.timeout.connect(self._drain)

    @property
    def is_busy(self) -> bool:
        """Whether something is being done or waits to be done."""
        return self._pending > 0

    def submit(
        self, text: str, work: Callable[[], Any], done: Callable[[Any], None], failed: Callable[[Exception], None]
    ) -> None:
        """Call ``work`` in the thread, then ``done`` with its result or ``failed`` with its exception in the GUI thread.

        After :meth:`close` nothing is done and nothing reported.
        """
        if self._ended.is_set():
            return
        if self._thread is None:
            arguments = (self._jobs, self._results, self._ended)
            self._thread = LeavableThread("background", _serve, arguments)
            self._thread.start()
        self._pending += 1
        self._jobs.put(_Job(work, done, failed))
        self._timer.start()
        if text:
            self.busyChanged.emit(text)

    def close(self, seconds: float = 2.0) -> None:
        """Begin and report nothing any more, and wait so long for the end of what is being done.

        Work that takes longer is left behind: it ends by itself or with the process, and nobody hears of it.
        """
        self.stop()
        if self._thread is not None:
            self._thread.join(seconds)
            self._thread = None

    def stop(self) -> None:
        """Begin and report nothing any more, without waiting."""
        self._ended.set()
        self._timer.stop()
        self._pending = 0
        self._jobs.put(None)

    def wait(self, seconds: float) -> bool:
        """Pump events until nothing is pending; tells whether that was reached in time."""
        deadline = time.monotonic() + seconds
        while self.is_busy and time.monotonic() < deadline:
            QCoreApplication.processEvents()
            time.sleep(0.002)
        return not self.is_busy

    def _drain(self) -> None:
        while not self._results.empty():
            report = self._results.get()
            self._pending -= 1
            if not self._pending:
                self._timer.stop()
                self.busyChanged.emit("")
            report()


def close_all(backgrounds: Iterable[Background], seconds: float = 2.0) -> None:
    """Close several, which together get no more time than one."""
    found = list(backgrounds)
    for background in found:
        background.stop()
    deadline = time.monotonic() + seconds
    for background in found:
        background.close(max(0.0, deadline - time.monotonic()))


def _serve(
    jobs: queue.SimpleQueue[_Job | None], results: queue.SimpleQueue[Callable[[], None]], ended: threading.Event
) -> None:
    while (job := jobs.get()) is not None and not ended.is_set():
        results.put(_do(job))
        # What the work holds is not kept alive by a thread that waits.
        del job


def _do(job: _Job) -> Callable[[], None]:
    """Do a piece of work; returns what reports it."""
    try:
        result = job.work()
    except Exception as error:
        _LOG.info("Background work failed: %s", error)
        return partial(job.failed, error)
    return partial(job.done, result)
