"""Going through many snapshots in another thread: everything comes once, and what is given up comes no more."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QObject

from dmp.errors import RunError
from dmp.snapshot import Snapshot
from dmp_viewer.model import Source, Workspace
from dmp_viewer.scanner import SnapshotScanner
from tests.viewer.conftest import FakeRun


@pytest.fixture
def workspace(trained_run: FakeRun) -> Workspace:
    workspace = Workspace()
    workspace.open_run(trained_run, trained_run.problem, Source("scan", trained_run.problem.mesh), None)
    return workspace


@pytest.fixture
def scanner(workspace: Workspace, qtbot: QtBot) -> Iterator[SnapshotScanner]:
    parent = QObject()
    scanner = SnapshotScanner(workspace, parent)
    yield scanner
    scanner.close()


def test_each_step_is_worked_on_once_elsewhere(scanner: SnapshotScanner, trained_run: FakeRun) -> None:
    found: dict[int, tuple[float, bool]] = {}
    here = threading.current_thread()

    def work(positions: np.ndarray) -> tuple[float, bool]:
        return float(positions.sum()), threading.current_thread() is here

    scanner.scan("sum", [40, 10], work, lambda step, result: found.update({step: result}))
    assert scanner.wait(10)
    assert found == {step: (float(trained_run.snapshots[step].vertices.sum()), False) for step in (40, 10)}
    assert list(found) == [40, 10]


def test_a_newer_wish_of_the_same_name_takes_the_place_of_the_older(scanner: SnapshotScanner) -> None:
    found: list[str] = []
    gate = threading.Event()
    scanner.scan("name", [0, 10, 20], lambda _positions: gate.wait(5), lambda *_: found.append("old"))
    scanner.scan("name", [30], lambda _positions: None, lambda *_: found.append("new"))
    scanner.scan("other", [30], lambda _positions: None, lambda *_: found.append("other"))
    gate.set()
    assert scanner.wait(10)
    assert found == ["new", "other"]


def test_another_run_gives_everything_up(scanner: SnapshotScanner, workspace: Workspace, trained_run: FakeRun) -> None:
    found: list[int] = []
    gate = threading.Event()
    scanner.scan("name", [0, 10], lambda _positions: gate.wait(5), lambda step, _result: found.append(step))
    workspace.open_problem(trained_run.problem, Source("scan", trained_run.problem.mesh))
    gate.set()
    assert scanner.wait(10)
    assert found == []


def test_a_snapshot_that_cannot_be_read_is_left_out(
    scanner: SnapshotScanner, workspace: Workspace, trained_run: FakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read(self: FakeRun, step: int) -> Snapshot:
        if step == 10:
            raise RunError("It is damaged.")
        return self.snapshots[step]

    monkeypatch.setattr(FakeRun, "snapshot", read)
    found: list[int] = []
    scanner.scan("name", [0, 10, 20], lambda positions: None, lambda step, _result: found.append(step))
    assert scanner.wait(10)
    assert found == [0, 20]


def test_a_fault_of_the_work_ends_it_and_not_the_scanner(scanner: SnapshotScanner) -> None:
    found: list[int] = []
    scanner.scan("bad", [0, 10], lambda _positions: 1 / 0, lambda step, _result: found.append(step))
    assert scanner.wait(10)
    scanner.scan("good", [20], lambda _positions: None, lambda step, _result: found.append(step))
    assert scanner.wait(10)
    assert found == [20]
