"""Work that would freeze the window (reading files, smoothing), done in a thread of its own, one piece after the other."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from qtpy.QtCore import QCoreApplication, QObject, QTimer, Signal

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
        self._thread: threading.Thread | None = None
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
        """Call ``work`` in the thread, then ``done`` with its result or ``failed`` with its exception in the GUI thread."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._serve, name="background", daemon=True)
            self._thread.start()
        self._pending += 1
        self._jobs.put(_Job(work, done, failed))
        self._timer.start()
        if text:
            self.busyChanged.emit(text)

    def close(self, seconds: float = 2.0) -> None:
        """Finish what is queued, without reporting, and end the thread."""
        self._timer.stop()
        self._pending = 0
        if self._thread is not None:
            self._jobs.put(None)
            self._thread.join(seconds)
            self._thread = None

    def wait(self, seconds: float) -> bool:
        """Pump events until nothing is pending; tells whether that was reached in time."""
        deadline = time.monotonic() + seconds
        while self.is_busy and time.monotonic() < deadline:
            QCoreApplication.processEvents()
            time.sleep(0.002)
        return not self.is_busy

    def _serve(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                result = job.work()
            except Exception as error:
                _LOG.info("Background work failed: %s", error)
                self._results.put(lambda job=job, error=error: job.failed(error))  # type: ignore[misc]
            else:
                self._results.put(lambda job=job, result=result: job.done(result))  # type: ignore[misc]

    def _drain(self) -> None:
        while not self._results.empty():
            report = self._results.get()
            self._pending -= 1
            if not self._pending:
                self._timer.stop()
                self.busyChanged.emit("")
            report()
