"""Marked steps of a run folder: they come back, and nothing in the file can do harm."""

from __future__ import annotations

from pathlib import Path

import pytest

from dmp.bookmarks import read_bookmarks, write_bookmarks
from dmp.errors import RunError


def test_marks_come_back_in_order_without_doubles(tmp_path: Path) -> None:
    write_bookmarks(tmp_path, [300, 0, 25, 300])
    assert read_bookmarks(tmp_path) == [0, 25, 300]
    assert [path.name for path in tmp_path.iterdir()] == ["bookmarks.json"]


def test_without_marks_there_is_no_file(tmp_path: Path) -> None:
    assert read_bookmarks(tmp_path) == []
    write_bookmarks(tmp_path, [5])
    write_bookmarks(tmp_path, [])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "text", ["", "{", "[1, 2]", '{"steps": 3}', '{"steps": ["1", null, true, -4, 1.5]}', '{"steps": {"1": 2}}', "[" * 10_000]
)
def test_a_damaged_file_holds_no_marks(tmp_path: Path, text: str) -> None:
    (tmp_path / "bookmarks.json").write_text(text)
    assert read_bookmarks(tmp_path) == []


def test_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere.json").write_text('{"steps": [7]}')
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "bookmarks.json").symlink_to(tmp_path / "elsewhere.json")
    assert read_bookmarks(folder) == []
    write_bookmarks(folder, [3])
    assert read_bookmarks(folder) == [3]
    assert (tmp_path / "elsewhere.json").read_text() == '{"steps": [7]}'


def test_a_folder_that_is_gone_is_told(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="bookmarks cannot be written"):
        write_bookmarks(tmp_path / "gone", [1])
