"""What is remembered between two starts, and that nothing in the file can keep the window from starting."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dmp_viewer.settings import MOST_RECENT_FILES, Preferences, default_path, load, save


def test_what_is_saved_comes_back(tmp_path: Path) -> None:
    preferences = Preferences(theme="dark", splitters={"rows": [3, 4]}, quantity="signed", smoothing=0.25, edges=True)
    preferences.add_recent(tmp_path / "a;b ü.ply")
    save(preferences, tmp_path / "deep" / "window.json")
    assert load(tmp_path / "deep" / "window.json") == preferences


def test_the_file_lies_in_the_users_configuration(tmp_path: Path) -> None:
    assert tmp_path in default_path().parents


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "7", '{"theme": "pink", "recent": "a", "smoothing": 7}', '{"splitters": {"rows": ["x"]}}']
)
def test_a_damaged_file_gives_the_defaults(tmp_path: Path, text: str) -> None:
    path = tmp_path / "window.json"
    path.write_text(text)
    assert load(path) == Preferences()


def test_one_bad_value_does_not_spoil_the_others(tmp_path: Path) -> None:
    path = tmp_path / "window.json"
    path.write_text(json.dumps({"theme": "dark", "log_axis": "no", "edges": True, "unknown": 1}))
    preferences = load(path)
    assert (preferences.theme, preferences.edges, preferences.log_axis) == ("dark", True, Preferences().log_axis)


def test_recent_files_are_newest_first_without_doubles_and_vanished_ones(tmp_path: Path) -> None:
    preferences = Preferences()
    for number in range(12):
        path = tmp_path / f"{number}.ply"
        path.touch()
        preferences.add_recent(path)
    preferences.add_recent(tmp_path / "5.ply")
    assert len(preferences.recent) == MOST_RECENT_FILES
    (tmp_path / "10.ply").unlink()
    assert [path.name for path in preferences.existing_recent()] == [f"{n}.ply" for n in (5, 11, 9, 8, 7, 6, 4, 3)]


def test_a_folder_that_cannot_be_written_is_no_reason_to_stay(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    save(Preferences(), tmp_path / "file" / "window.json")
