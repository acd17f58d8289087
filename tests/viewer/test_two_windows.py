"""Two windows with one folder of runs: the queue is that of one of them, and nothing that waits is lost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot

from dmp.runs import Run
from dmp_viewer.controller import Controller
from dmp_viewer.queue_file import QueueFile
from dmp_viewer.queue_model import Waiting, saved_queue
from tests.viewer.conftest import quick_settings
from tests.viewer.driving import MakeViewer, open_files, trigger

_ANOTHERS = "The queue belongs to another window"
_HOLD = """
import sys
from pathlib import Path
from dmp_viewer.queue_file import QueueFile
file = QueueFile(Path(sys.argv[1]))
print(file.take(), flush=True)
sys.stdin.read()
"""


@pytest.fixture
def both(make_viewer: MakeViewer, mesh_files: tuple[Path, Path]) -> tuple[Controller, Controller]:
    """Two windows with the same mesh."""
    first, second = make_viewer(), make_viewer()
    for viewer in (first, second):
        open_files(viewer, mesh_files[0])
    return first, second


def _add(viewer: Controller, seed: int) -> None:
    viewer.window.panel.set_settings(quick_settings(steps=6, seed=seed))
    trigger(viewer, "queue_add")
    assert viewer.background.wait(20)
    viewer.presenter.flush()


def _seeds(viewer: Controller) -> list[int]:
    return [Run.open(folder).settings.seed for folder in saved_queue(viewer.runs.folder)]


def test_the_second_window_sees_the_queue_and_leaves_it_alone(both: tuple[Controller, Controller]) -> None:
    first, second = both
    _add(first, 1)
    _add(second, 2)
    assert any(text.startswith(_ANOTHERS) for text in second.window.banners.texts())
    shown = second.window.runs.queue
    assert shown.status == "in another window"
    assert shown.folders() == [item.folder for item in first.queue.queue.items]
    assert not shown.rows.isEnabled()
    actions = second.window.named_actions
    assert not any(actions[name].isEnabled() for name in ("queue_go", "queue_up", "queue_down", "queue_remove"))
    _add(first, 3)
    second.queue.look_at_other_window()
    assert len(shown.folders()) == 2
    assert _seeds(first) == [1, 3]


def test_the_queue_goes_to_the_window_that_stays(both: tuple[Controller, Controller]) -> None:
    first, second = both
    _add(first, 1)
    second.queue.look_at_other_window()
    first.leave()
    second.queue.look_at_other_window()
    assert second.window.banners.texts() == ["1 training waits in the queue of the window that was closed."]
    assert second.window.runs.queue.rows.isEnabled()
    _add(second, 2)
    assert _seeds(second) == [1, 2]


def test_who_adds_first_after_a_start_keeps_what_waited(make_viewer: MakeViewer, mesh_files: tuple[Path, Path]) -> None:
    first = make_viewer()
    open_files(first, mesh_files[0])
    _add(first, 1)
    first.leave()
    # Started with a mesh: nothing is offered, and still nothing is forgotten.
    second = make_viewer()
    open_files(second, mesh_files[0])
    _add(second, 2)
    assert _seeds(second) == [1, 2]


def test_an_empty_queue_is_free_again(both: tuple[Controller, Controller], qtbot: QtBot) -> None:
    first, second = both
    _add(first, 1)
    trigger(first, "queue_go")
    qtbot.waitUntil(lambda: not first.queue.queue.items and not first.runner.state.is_active, timeout=30_000)
    qtbot.waitUntil(lambda: not first.queue.queue.is_on)
    _add(second, 2)
    assert _seeds(second) == [2]
    first.queue.look_at_other_window()
    assert first.window.runs.queue.status == "in another window"


def test_a_window_that_was_killed_holds_nothing(tmp_path: Path) -> None:
    file = QueueFile(tmp_path)
    with subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "True\n"
        assert file.is_anothers
        assert not file.take()
        other.kill()
        other.wait(10)
    assert not file.is_anothers
    assert file.take()
    file.save([Waiting(tmp_path / "a", "a", "")])
    assert QueueFile(tmp_path).is_anothers
    file.release()


def test_where_nothing_can_be_locked_the_queue_still_works(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    assert QueueFile(tmp_path / "file").take()
