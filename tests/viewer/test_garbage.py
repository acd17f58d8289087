"""Where unreachable objects are found: in the GUI thread, between two events, and nowhere else."""

from __future__ import annotations

import gc
import threading
import weakref
from collections.abc import Iterator

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QObject

from dmp_viewer.garbage import GarbageCollection


class Knot:
    """Holds itself, and notes in which thread it was let go."""

    def __init__(self, ends: list[str]) -> None:
        self.itself = self
        self.ends = ends

    def __del__(self) -> None:
        self.ends.append(threading.current_thread().name)


@pytest.fixture
def collection(qtbot: QtBot) -> Iterator[GarbageCollection]:
    was_enabled, parent = gc.isenabled(), QObject()
    yield GarbageCollection(parent)
    if was_enabled:
        gc.enable()
    else:
        gc.disable()


def knots(ends: list[str]) -> None:
    """Make more garbage than Python would leave lying by itself."""
    for _ in range(2 * gc.get_threshold()[0]):
        Knot(ends)


@pytest.mark.usefixtures("collection")
def test_garbage_of_a_thread_is_destroyed_in_the_main_one(qtbot: QtBot) -> None:
    ends: list[str] = []
    seen: list[int] = []

    def work() -> None:
        knots(ends)
        seen.append(len(ends))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [0]
    qtbot.waitUntil(lambda: bool(ends), timeout=10_000)
    assert set(ends) == {threading.main_thread().name}


def test_what_becomes_garbage_late_is_found(collection: GarbageCollection) -> None:
    knot = Knot([])
    gone = weakref.ref(knot)
    for generation in (0, 1):  # until it is in the oldest generation
        gc.collect(generation)
    del knot
    for _ in range(400):
        knots([])
        collection.look()
        if gone() is None:
            break
    assert gone() is None


def test_afterwards_python_looks_by_itself(collection: GarbageCollection) -> None:
    assert not gc.isenabled()
    collection.close()
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0
