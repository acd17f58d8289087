"""The end that the system orders: SIGTERM, SIGINT and SIGHUP stop the training, keep its run, and close the window.

Nobody may be there to answer, so nothing is asked. Signal handlers of Python wait for the interpreter, which does nothing
while Qt waits for events; a pair of sockets wakes it.
"""

from __future__ import annotations

import logging
import signal
import socket
import tempfile
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QCoreApplication, QEvent, QObject, QSocketNotifier, QTimer

from dmp.errors import DmpError
from dmp.meshio import write_mesh
from dmp.runs import Run

if TYPE_CHECKING:
    from qtpy.QtWidgets import QApplication, QWidget

    from dmp_viewer.controller import Controller

_LOG = logging.getLogger(__name__)
# What a system grants at the least between asking and killing; a step that takes longer is left behind, and with it what was
# learnt since the last snapshot.
_SECONDS = 4.0
_NAMES = ("SIGTERM", "SIGINT", "SIGHUP")


class Shutdown(QObject):
    """Ends the application when the system says so, as long as this object lives.

    Args:
        controller: of the window.
        application: what is to end, with exit code 0.
    """

    def __init__(self, controller: Controller, application: QApplication) -> None:
        super().__init__(controller)
        self._controller = controller
        self._application = application
        self._has_begun = False
        self._reading, self._writing = socket.socketpair()
        self._reading.setblocking(False)
        self._writing.setblocking(False)
        self._notifier = QSocketNotifier(self._reading.fileno(), QSocketNotifier.Type.Read, self)
        self._notifier.activated.connect(self._on_woken)
        signal.set_wakeup_fd(self._writing.fileno(), warn_on_full_buffer=False)
        self._before: dict[int, Any] = {}
        for name in _NAMES:
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            # Ignored means that whoever started the program wants it so, as nohup does.
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._on_signal)

    def close(self) -> None:
        """Listen no longer; the next signal ends the process as it does without this object."""
        self._notifier.setEnabled(False)
        other = signal.set_wakeup_fd(-1)
        if other != self._writing.fileno():  # somebody listens who came later
            signal.set_wakeup_fd(other, warn_on_full_buffer=False)
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._reading.close()
        self._writing.close()

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        """Take the place of the handler that would end the process."""
        _LOG.info("Ended by %s", signal.Signals(number).name)
        # The socket alone would do, if nobody else had taken the interpreter's only place for one.
        QTimer.singleShot(0, self.end)

    def _on_woken(self) -> None:
        try:
            self._reading.recv(4096)
        except BlockingIOError:
            return
        self.end()

    def end(self) -> None:
        """Stop what is being trained, write what is not yet written, and end the application without a question."""
        if self._has_begun:
            return
        self._has_begun = True
        controller = self._controller
        controller.queue.close()
        controller.runner.stop()
        if not controller.runner.wait(_SECONDS):
            controller.runner.abandon()
        _rescue(controller.workspace.run)
        controller.leave()
        controller.window.close_guard = lambda: True
        controller.window.close()
        self._application.exit(0)


def destroy(window: QWidget) -> None:
    """Let Qt destroy a closed window, while the caller and all its children still hold their Python objects.

    Left to Python's reference count, a window takes its children's Python objects along before the children themselves, and
    one of these that calls what it overrides then ends the process.
    """
    window.deleteLater()
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)


def _rescue(run: object) -> None:
    """Write the last step of a run that could not be written to its folder where it can be, and log where."""
    if not isinstance(run, Run) or not run.is_in_memory:
        return
    try:
        step = run.last_step
        refuge = Path(tempfile.gettempdir()) / f"dmp_{run.run_id[:8]}_step{step}.ply"
        write_mesh(refuge, run.mesh_at(step))
    except DmpError:
        _LOG.exception("What was learnt last could not be saved anywhere")
    else:
        _LOG.warning("Step %d could not be written to the run folder; it was saved as %s", step, refuge)
