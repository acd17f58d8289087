"""The queue without a window: its order, and what is kept of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dmp_viewer.queue_model import Queue, Waiting, save_queue, saved_queue


def _queue(*names: str) -> Queue:
    queue = Queue()
    for name in names:
        assert queue.add(Waiting(Path(name), name, ""))
    return queue


def _order(queue: Queue) -> str:
    return "".join(item.title for item in queue.items)


def test_a_run_waits_once() -> None:
    queue = _queue("a", "b")
    assert not queue.add(Waiting(Path("a"), "again", ""))
    assert _order(queue) == "ab"


@pytest.mark.parametrize(
    ("name", "places", "order"), [("a", 1, "bac"), ("c", -1, "acb"), ("a", -1, "abc"), ("c", 5, "abc"), ("x", 1, "abc")]
)
def test_a_training_is_moved_as_far_as_there_is_room(name: str, places: int, order: str) -> None:
    queue = _queue("a", "b", "c")
    queue.move(Path(name), places)
    assert _order(queue) == order


@given(st.permutations("abcde"))
def test_any_order_can_be_given(order: list[str]) -> None:
    queue = _queue(*"abcde")
    queue.arrange([Path(name) for name in order])
    assert _order(queue) == "".join(order)


def test_what_could_not_be_trained_stays_in_sight_and_is_passed_over() -> None:
    queue = _queue("a", "b")
    queue.set_problem(Path("a"), "no memory")
    assert queue.next is not None
    assert queue.next.title == "b"
    queue.remove(Path("b"))
    assert queue.next is None
    assert _order(queue) == "a"


def test_every_change_is_told_once() -> None:
    told: list[int] = []
    queue = _queue("a", "b")
    queue.changed.connect(lambda: told.append(1))
    queue.remove(Path("x"))
    queue.set_on(False)
    assert told == []
    queue.set_on(True)
    queue.remove(Path("a"), Path("b"))
    assert len(told) == 2


def test_what_waits_is_kept_in_order_and_an_empty_queue_leaves_no_file(tmp_path: Path) -> None:
    elsewhere = tmp_path / "other" / "z"
    items = [Waiting(path, "", "") for path in (tmp_path / "b", elsewhere, tmp_path / "a")]
    save_queue(tmp_path, items)
    assert saved_queue(tmp_path) == [tmp_path / "b", elsewhere, tmp_path / "a"]
    save_queue(tmp_path, [])
    assert saved_queue(tmp_path) == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "content", [b"", b"[]", b'{"waiting": 3}', b'{"waiting": [3, "", "a\\u0000b"]}', b"\xff\xfe", b"[" * 9999]
)
def test_a_damaged_file_is_an_empty_queue(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "queue.json").write_bytes(content)
    assert saved_queue(tmp_path) == []


def test_a_queue_that_cannot_be_written_stops_nobody(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    save_queue(tmp_path / "file", [Waiting(tmp_path / "a", "", "")])
