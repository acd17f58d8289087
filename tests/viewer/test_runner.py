"""The training thread with a training that costs nothing."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
from pytestqt.qtbot import QtBot

from dmp.errors import TrainingError
from dmp.snapshot import StepRecord
from dmp_viewer.background import Background
from dmp_viewer.runner import Outcome, Progress, Runner, Session, SpeedMeter
from dmp_viewer.states import RunnerState
from tests.viewer.conftest import FakeRun


class Stage:
    """A training that makes a step only when the test lets it, and tells whether it was closed."""

    def __init__(self, run: FakeRun, *, fails_at: int | None = None) -> None:
        self.run = run
        self.allowed = threading.Semaphore(0)
        self.closed = threading.Event()
        self.fails_at = fails_at
        self.thread: int | None = None

    def prepare(self) -> Session:
        return Session(self.run, self.run.problem, "CPU", self._records())

    def _records(self) -> Iterator[StepRecord]:
        self.thread = threading.get_ident()
        try:
            for record in self.run.records():
                assert self.allowed.acquire(timeout=20)
                if record.step == self.fails_at:
                    raise TrainingError("The loss is not a number.")
                yield record
        finally:
            self.closed.set()

    def allow(self, steps: int) -> None:
        self.allowed.release(steps)


class Ear:
    """Everything a runner says, in order."""

    def __init__(self, runner: Runner) -> None:
        self.states: list[RunnerState] = []
        self.steps: list[int] = []
        self.snapshots: list[int] = []
        self.errors: list[BaseException] = []
        self.outcomes: list[Outcome] = []
        self.threads: set[int] = set()
        runner.stateChanged.connect(self.states.append)
        runner.progressed.connect(self._on_progressed)
        runner.snapshotTaken.connect(lambda snapshot: self.snapshots.append(snapshot.step))
        runner.failed.connect(self.errors.append)
        runner.finished.connect(self.outcomes.append)

    def _on_progressed(self, progress: Progress) -> None:
        self.threads.add(threading.get_ident())
        self.steps.extend(record.step for record in progress.records)


@pytest.fixture
def runner(qtbot: QtBot) -> Iterator[Runner]:
    runner = Runner()
    yield runner
    runner.stop()
    assert runner.wait(10)


def test_a_training_runs_to_its_end_and_nothing_is_lost(runner: Runner, qtbot: QtBot, fake_run: FakeRun) -> None:
    ear, stage = Ear(runner), Stage(fake_run)
    stage.allow(100)
    runner.start(stage.prepare)
    assert runner.state is RunnerState.PREPARING
    qtbot.waitUntil(lambda: bool(ear.outcomes))
    assert ear.states == [RunnerState.PREPARING, RunnerState.RUNNING, RunnerState.FINISHED]
    assert ear.steps == list(range(41))
    assert ear.snapshots == [0, 10, 20, 30, 40]
    assert ear.outcomes == [Outcome("fake", completed=True)]
    assert ear.threads == {threading.get_ident()}
    assert stage.thread != threading.get_ident()


def test_pause_holds_it_between_two_steps_and_resume_goes_on(runner: Runner, qtbot: QtBot, fake_run: FakeRun) -> None:
    ear, stage = Ear(runner), Stage(fake_run)
    stage.allow(3)
    runner.start(stage.prepare)
    qtbot.waitUntil(lambda: ear.steps == [0, 1, 2])
    runner.pause()
    stage.allow(100)
    qtbot.wait(150)
    assert runner.state is RunnerState.PAUSED
    assert ear.steps == [0, 1, 2, 3]  # the step it was in
    runner.resume()
    qtbot.waitUntil(lambda: bool(ear.outcomes))
    assert ear.steps == list(range(41))
    assert ear.outcomes[0].completed


@pytest.mark.parametrize("paused", [False, True])
def test_stop_is_visible_at_once_and_closes_the_training(runner: Runner, qtbot: QtBot, fake_run: FakeRun, paused: bool) -> None:
    ear, stage = Ear(runner), Stage(fake_run)
    stage.allow(3)
    runner.start(stage.prepare)
    qtbot.waitUntil(lambda: ear.steps == [0, 1, 2])
    if paused:
        runner.pause()
        stage.allow(1)
    runner.stop()
    assert ear.states[-1] is RunnerState.STOPPING
    stage.allow(1)
    qtbot.waitUntil(lambda: bool(ear.outcomes))
    assert stage.closed.is_set()
    assert ear.outcomes == [Outcome("fake", completed=False)]
    assert runner.state is RunnerState.FINISHED


def test_an_error_is_told_and_the_run_can_be_started_again(runner: Runner, qtbot: QtBot, fake_run: FakeRun) -> None:
    ear, stage = Ear(runner), Stage(fake_run, fails_at=2)
    stage.allow(100)
    runner.start(stage.prepare)
    qtbot.waitUntil(lambda: bool(ear.outcomes))
    assert [str(error) for error in ear.errors] == ["The loss is not a number."]
    assert ear.steps == [0, 1]
    assert runner.state is RunnerState.FAILED
    again = Stage(FakeRun(fake_run.problem, run_id="again"))
    again.allow(100)
    runner.start(again.prepare)
    qtbot.waitUntil(lambda: len(ear.outcomes) == 2)
    assert ear.outcomes[1] == Outcome("again", completed=True)


def test_an_error_while_preparing_has_no_run(runner: Runner, qtbot: QtBot) -> None:
    def prepare() -> Session:
        raise TrainingError("There is no room.")

    ear = Ear(runner)
    runner.start(prepare)
    qtbot.waitUntil(lambda: bool(ear.outcomes))
    assert ear.outcomes == [Outcome(None, completed=False)]
    assert ear.states == [RunnerState.PREPARING, RunnerState.FAILED]


def test_only_one_training_at_a_time(runner: Runner, qtbot: QtBot, fake_run: FakeRun) -> None:
    stage = Stage(fake_run)
    runner.start(stage.prepare)
    with pytest.raises(RuntimeError, match="active already"):
        runner.start(stage.prepare)
    stage.allow(100)
    qtbot.waitUntil(lambda: not runner.state.is_active)


def test_waiting_gives_up_on_a_step_that_hangs_and_it_can_be_left_behind(
    runner: Runner, qtbot: QtBot, fake_run: FakeRun
) -> None:
    ear, stage = Ear(runner), Stage(fake_run)
    stage.allow(1)
    runner.start(stage.prepare)
    qtbot.waitUntil(lambda: ear.steps == [0])
    runner.stop()
    assert not runner.wait(0.2)
    runner.abandon()
    assert runner.state is RunnerState.IDLE
    stage.allow(100)
    assert stage.closed.wait(10)
    qtbot.wait(120)
    assert ear.steps == [0]
    assert ear.outcomes == []


def test_progress_comes_in_pieces_not_step_by_step(runner: Runner, qtbot: QtBot, fake_run: FakeRun) -> None:
    pieces: list[int] = []
    runner.progressed.connect(lambda progress: pieces.append(len(progress.records)))
    stage = Stage(fake_run)
    stage.allow(100)
    runner.start(stage.prepare)
    qtbot.waitUntil(lambda: not runner.state.is_active)
    assert sum(pieces) == 41
    assert len(pieces) <= 5


def test_speed_forgets_the_warm_up_and_what_is_long_ago() -> None:
    meter = SpeedMeter(window=10)
    assert meter.add(0, 0.0) == meter.add(1, 30.0) == 0
    meter.add(2, 30.5)
    assert meter.add(4, 31.5) == pytest.approx(2)
    for step in range(5, 205):
        speed = meter.add(step, 31.5 + (step - 4) * 0.1)
    assert speed == pytest.approx(10, rel=0.02)


def test_background_work_reports_in_order_in_the_gui_thread(qtbot: QtBot) -> None:
    background, heard = Background(), list[object]()
    texts: list[str] = []
    background.busyChanged.connect(texts.append)

    def fail() -> None:
        raise ValueError("no")

    background.submit("one", threading.get_ident, heard.append, heard.append)
    background.submit("two", fail, heard.append, lambda error: heard.append(str(error)))
    assert background.is_busy
    assert background.wait(10)
    assert heard[0] != threading.get_ident()
    assert heard[1] == "no"
    assert texts == ["one", "two", ""]
    background.close()


def test_closing_drops_what_would_be_reported(qtbot: QtBot) -> None:
    background, heard = Background(), list[object]()
    background.submit("", lambda: 1, heard.append, heard.append)
    background.close()
    qtbot.wait(50)
    assert heard == []
    assert not background.is_busy
