"""The training thread behind a small interface, and the only file that knows that it is a thread.

Invariants, each with what happens when it is broken:

- The thread touches no Qt object at all; it fills a mailbox, and the GUI thread empties it by timer. Signals from a foreign
  thread pile up in the event queue and freeze the window by seconds of latency.
- Only frozen records with copied arrays cross. Anything shared would change while it is being drawn.
- Snapshots are never dropped; of progress only what came since the last look is passed on, in one piece.
- Nobody waits for the thread without pumping events, or the window looks dead while a step ends.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from qtpy.QtCore import QCoreApplication, QEventLoop, QObject, QTimer, Signal

from dmp.problem import Problem
from dmp.snapshot import StepRecord
from dmp_viewer.left_behind import LeavableThread
from dmp_viewer.model import RunLike
from dmp_viewer.pace import Courtesy, Pace
from dmp_viewer.states import RunnerState

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Session:
    """A training that is set up and waits to be asked for its steps.

    Attributes:
        run: where it is recorded.
        problem: what it fits.
        device: where it computes, in words.
        records: its steps; closing the iterator ends it cleanly.
    """

    run: RunLike
    problem: Problem
    device: str
    records: Iterator[StepRecord]

    def hold(self, paused: bool) -> None:
        """The training is paused or goes on. One that waits to be asked for its steps need not be told."""


@dataclass(frozen=True)
class Outcome:
    """How a training ended.

    Attributes:
        run_id: which one, or None when it ended before it had a run.
        completed: False when it was stopped before its last step.
    """

    run_id: str | None
    completed: bool


@dataclass(frozen=True, eq=False)
class Progress:
    """The steps made since the last look, in order, without their snapshots' meshes being needed."""

    run_id: str
    records: tuple[StepRecord, ...]
    steps_per_second: float


@dataclass
class _Mailbox:
    """What the thread has to say, guarded by a lock."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    session: Session | None = None
    records: list[StepRecord] = field(default_factory=list)
    outcome: Outcome | None = None
    error: BaseException | None = None


class _Worker(LeavableThread):
    """Asks a session for its steps. Stop and pause act between two steps."""

    def __init__(self, prepare: Callable[[], Session], mailbox: _Mailbox, courtesy: Courtesy) -> None:
        # Leavable, so that a step that hangs in a driver cannot keep the process alive once the user has left.
        super().__init__("training")
        self._prepare = prepare
        self._mailbox = mailbox
        self._courtesy = courtesy
        self.stop_requested = threading.Event()
        self.may_run = threading.Event()
        self.may_run.set()

    def run(self) -> None:
        self._courtesy.keep_priority()
        run_id: str | None = None
        try:
            session = self._prepare()
            run_id = session.run.run_id
            with self._mailbox.lock:
                self._mailbox.session = session
            completed = self._ask_for_steps(session)
        except Exception as error:  # whatever it is, the user must hear of it
            _LOG.exception("The training failed")
            with self._mailbox.lock:
                self._mailbox.error = error
                self._mailbox.outcome = Outcome(run_id, completed=False)
        else:
            with self._mailbox.lock:
                self._mailbox.outcome = Outcome(run_id, completed)

    def _ask_for_steps(self, session: Session) -> bool:
        records = session.records
        try:
            while not self.stop_requested.is_set():
                record = next(records, None)
                if record is None:
                    return True
                with self._mailbox.lock:
                    self._mailbox.records.append(record)
                self.may_run.wait()
                self._courtesy.rest(self.stop_requested.is_set)
                self._courtesy.keep_priority()
            return False
        finally:
            close = getattr(records, "close", None)
            if close is not None:
                close()


class Runner(QObject):
    """Starts, pauses, resumes and stops one training at a time.

    Signals (all in the GUI thread):
        stateChanged: a :class:`RunnerState`.
        prepared: the :class:`Session`, before its first step.
        progressed: a :class:`Progress`, as often as the pace says.
        snapshotTaken: a :class:`dmp.snapshot.Snapshot`, every one of them.
        failed: the exception that ended the training.
        finished: an :class:`Outcome`; always the last, also after ``failed``.
    """

    stateChanged = Signal(object)
    prepared = Signal(object)
    progressed = Signal(object)
    snapshotTaken = Signal(object)
    failed = Signal(object)
    finished = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._state = RunnerState.IDLE
        self._worker: _Worker | None = None
        self._mailbox = _Mailbox()
        self._run_id: str | None = None
        self._session: Session | None = None
        self._speed = SpeedMeter()
        self._timer = QTimer(self)
        self._courtesy = Courtesy()
        self._look_often()
        self._timer.timeout.connect(self._drain)

    @property
    def state(self) -> RunnerState:
        """What the training is doing."""
        return self._state

    @property
    def pace(self) -> Pace:
        """Who comes first, the window or the training."""
        return self._courtesy.pace

    def set_pace(self, pace: Pace) -> None:
        """Let the window or the training come first, from now on."""
        self._courtesy.pace = pace
        self._look_often()

    def give_way(self) -> None:
        """Somebody works in the window: a training that is to let the window go first rests for a moment."""
        self._courtesy.ask()

    def _look_often(self) -> None:
        """Look for news as often as the pace says; while something is waited for, often."""
        pace = self._courtesy.pace if self._state is RunnerState.RUNNING else Pace.SMOOTH
        self._timer.setInterval(pace.drain_interval_ms)

    def start(self, prepare: Callable[[], Session]) -> None:
        """Begin a training; ``prepare`` sets it up and is called in the thread, because smoothing and reading take time.

        Raises:
            RuntimeError: when one is active already.
        """
        if self._state.is_active:
            raise RuntimeError("A training is active already.")
        self._mailbox = _Mailbox()
        self._run_id = None
        self._session = None
        self._speed = SpeedMeter()
        self._worker = _Worker(prepare, self._mailbox, self._courtesy)
        self._set_state(RunnerState.PREPARING)
        self._worker.start()
        self._timer.start()

    def pause(self) -> None:
        """Hold the training after the step it is in."""
        if self._state is RunnerState.RUNNING and self._worker is not None:
            self._worker.may_run.clear()
            self._hold(True)
            self._set_state(RunnerState.PAUSED)

    def resume(self) -> None:
        """Go on after a pause."""
        if self._state is RunnerState.PAUSED and self._worker is not None:
            self._speed = SpeedMeter()
            self._set_state(RunnerState.RUNNING)
            self._hold(False)
            self._worker.may_run.set()

    def stop(self) -> None:
        """End the training after the step it is in. Visible at once, true within a step."""
        if self._state.is_active and self._worker is not None:
            self._set_state(RunnerState.STOPPING)
            self._worker.stop_requested.set()
            self._worker.may_run.set()

    def wait(self, seconds: float) -> bool:
        """Wait for the training to end while the window stays alive; tells whether it has ended."""
        worker = self._worker  # the events that are pumped may take the end in, and forget it
        deadline = time.monotonic() + seconds
        while worker is not None and worker.is_alive() and time.monotonic() < deadline:
            QCoreApplication.processEvents(QEventLoop.ProcessEventsFlag.AllEvents, 20)
            worker.join(0.005)
        ended = worker is None or not worker.is_alive()
        if ended:
            self._drain()
        return ended

    def abandon(self) -> None:
        """Forget a training that does not answer; nothing it may still say is heard."""
        if self._worker is not None:
            self._worker.stop_requested.set()
            self._worker.may_run.set()
            self._worker = None
            self._mailbox = _Mailbox()
            self._timer.stop()
            self._set_state(RunnerState.IDLE)

    def _hold(self, paused: bool) -> None:
        if self._session is not None:
            self._session.hold(paused)

    def _set_state(self, state: RunnerState) -> None:
        if state is not self._state:
            self._state = state
            self._look_often()
            self.stateChanged.emit(state)

    def _drain(self) -> None:
        box = self._mailbox
        with box.lock:
            session, box.session = box.session, None
            records, box.records = box.records, []
            outcome, box.outcome = box.outcome, None
            error, box.error = box.error, None
        if session is not None:
            self._run_id, self._session = session.run.run_id, session
            self.prepared.emit(session)
            if self._state is RunnerState.PREPARING:
                self._set_state(RunnerState.RUNNING)
        if records and self._run_id is not None:
            speed = self._speed.add(records[-1].step, records[-1].seconds)
            self.progressed.emit(Progress(self._run_id, tuple(records), speed))
            for record in records:
                if record.snapshot is not None:
                    self.snapshotTaken.emit(record.snapshot)
        if outcome is not None:
            self._timer.stop()
            self._worker = None
            self._set_state(RunnerState.FAILED if error is not None else RunnerState.FINISHED)
            if error is not None:
                self.failed.emit(error)
            self.finished.emit(outcome)


class SpeedMeter:
    """Steps per second of training time, averaged over the last seconds; the first step, which warms up, is left out."""

    def __init__(self, window: float = 8.0) -> None:
        self._window = window
        self._points: list[tuple[int, float]] = []

    def add(self, step: int, seconds: float) -> float:
        """Note that ``step`` was reached after ``seconds`` of training; returns the speed, 0 while it is unknown."""
        if step <= 1:
            return 0.0
        self._points.append((step, seconds))
        while len(self._points) > 2 and self._points[1][1] < seconds - self._window:
            self._points.pop(0)
        (first_step, first_seconds), (last_step, last_seconds) = self._points[0], self._points[-1]
        elapsed = last_seconds - first_seconds
        return (last_step - first_step) / elapsed if elapsed > 0 else 0.0
