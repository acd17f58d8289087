"""Keys of one's own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QTableWidget

from dmp_viewer import app, keys
from dmp_viewer.actions import ACTIONS
from dmp_viewer.arguments import parse
from dmp_viewer.settings import Preferences, load, save
from dmp_viewer.views import dialogs
from tests.viewer.conftest import FakeRun
from tests.viewer.driving import MakeViewer, show_fake, trigger


def test_without_wishes_the_keys_are_those_of_the_table() -> None:
    assert keys.bindings({}) == keys.Bindings({spec.name: spec.key for spec in ACTIONS})


def test_a_key_that_is_given_away_is_taken_from_where_it_was() -> None:
    bound = keys.bindings({"edges": "G", "keep": "", "lens": "Ctrl+L; J"})
    assert bound.problems == ()
    assert (bound.keys["edges"], bound.keys["smooth"], bound.keys["keep"]) == ("G", "", "")
    assert bound.keys["lens"] == "Ctrl+L; J"
    assert keys.bindings({"about": "?"}).keys["keys"] == "F1"


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        ({"fly": "F"}, "no action “fly”"),
        ({"flip": "Ctrl+"}, "“Ctrl+” is no key"),
        ({"flip": "Banana"}, "“Banana” is no key"),
        ({"flip": "Ctrl+X, Ctrl+C"}, "is no key"),
        ({"flip": 7}, "“7” is no key"),
        ({"flip": None}, "is no key"),
        ({"lens": "J", "flip": "J"}, "The key J is given to “lens” and to “flip”; it stays with “lens”."),
    ],
)
def test_what_cannot_be_is_told_in_a_sentence_and_left_out(wanted: dict[str, Any], said: str) -> None:
    bound = keys.bindings({"edges": "Ctrl+F7", **wanted})
    (problem,) = bound.problems
    assert said in problem
    assert problem.endswith(".")
    assert bound.keys["flip"] == "A"
    assert bound.keys["edges"] == "Ctrl+F7"


@given(st.dictionaries(st.sampled_from([spec.name for spec in ACTIONS]), st.sampled_from(["", "F", "J", "F5", "Ctrl+S; F6"])))
def test_whatever_is_wished_no_key_does_two_things(wanted: dict[str, str]) -> None:
    bound = keys.bindings(wanted)
    parts = [key for text in bound.keys.values() if text for key in text.split("; ")]
    assert len(parts) == len(set(parts))
    assert bound.keys.keys() == {spec.name for spec in ACTIONS}


def test_the_window_works_with_other_keys_and_shows_them(make_viewer: MakeViewer, trained_run: FakeRun, qtbot: QtBot) -> None:
    viewer = make_viewer(Preferences(theme="light", keys={"orthographic": "J", "flip": "Ctrl+5", "next_middle": ""}))
    show_fake(viewer, trained_run)
    with qtbot.waitActive(viewer.window):
        viewer.window.activateWindow()
    qtbot.keyClick(viewer.window, Qt.Key.Key_5)
    assert not viewer.workspace.look.policy.orthographic
    qtbot.keyClick(viewer.window, Qt.Key.Key_J)
    assert viewer.workspace.look.policy.orthographic
    actions = viewer.window.named_actions
    assert actions["orthographic"].toolTip().endswith("(J)")
    assert actions["flip"].toolTip().endswith("(Ctrl+5)")
    trigger(viewer, "keys")
    (dialog,) = viewer.window.findChildren(dialogs.KeysDialog)
    (table,) = dialog.findChildren(QTableWidget)
    listed = {table.item(row, 1).text(): table.item(row, 2).text() for row in range(table.rowCount())}
    assert listed["Orthographic view"] == "J"
    assert listed["Show the input for a moment"] == "Hold Ctrl+5"
    assert "Normals" not in {what for what, key in listed.items() if key == "Ctrl+5"}
    assert "Next in the middle pane" not in listed
    dialog.close()


def test_own_keys_stay_in_the_file_as_they_were_written(tmp_path: Path) -> None:
    path = tmp_path / "window.json"
    path.write_text(json.dumps({"keys": {"flip": "J", "fly": 3}}))
    preferences = load(path)
    save(preferences, path)
    assert json.loads(path.read_text())["keys"] == {"flip": "J", "fly": 3}


def test_all_actions_are_listed_with_the_keys_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "my.json"
    path.write_text(json.dumps({"keys": {"flip": "J", "fly": "K"}}))
    assert app.run(parse(["--list-bindings", "--config", str(path)])) == 0
    said = capsys.readouterr()
    rows = {line.split()[0]: line.split()[1] for line in said.out.splitlines() if " > " in line}
    assert rows.keys() == {spec.name for spec in ACTIONS}
    assert (rows["flip"], rows["about"], rows["start"]) == ("J", "-", "F5")
    assert said.err == (
        f"dmp-viewer: {path}: There is no action “fly” that could have a key; “dmp-viewer --list-bindings” lists all.\n"
    )


def test_the_list_needs_no_display() -> None:
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "dmp_viewer", "--list-bindings"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0
    assert "orthographic" in done.stdout


def test_preferences_cannot_be_in_a_folder_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app._unusable_paths(parse(["--config", str(tmp_path / "no" / "file.json")])) is not None
    assert app._unusable_paths(parse(["--config", str(tmp_path)])) is not None
    assert app._unusable_paths(parse(["--config", str(tmp_path / "new.json")])) is None
