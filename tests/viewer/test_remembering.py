"""What the real window remembers, and that each of its actions answers."""

from __future__ import annotations

from pathlib import Path

import pytest
from qtpy.QtWidgets import QApplication

from dmp_viewer.controller import Controller
from dmp_viewer.settings import Preferences, load
from dmp_viewer.tasks import OpenedRun
from dmp_viewer.views import dialogs
from tests.viewer.conftest import DIALOGS, FakeRun
from tests.viewer.driving import MakeViewer, open_files, show_fake, trigger


def test_layout_and_choices_are_remembered(make_viewer: MakeViewer, trained_run: FakeRun, tmp_path: Path) -> None:
    viewer = make_viewer()
    show_fake(viewer, trained_run)
    for name in ("signed", "edges", "show_curve", "theme_dark"):
        trigger(viewer, name)
    viewer.window.curve.logAxisChanged.emit(False)
    viewer.window.resize(760, 560)
    QApplication.processEvents()
    assert viewer.window.close()
    preferences = load(tmp_path / "window.json")
    assert (preferences.quantity, preferences.edges, preferences.show_curve) == ("signed", True, False)
    assert (preferences.theme, preferences.log_axis) == ("dark", False)
    again = make_viewer(preferences)
    show_fake(again, trained_run)
    assert again.workspace.colors.quantity == "signed"
    assert (again.window.width(), again.window.height()) == (760, 560)
    assert not again.window.curve.isVisible()
    assert again.window.named_actions["theme_dark"].isChecked()
    trigger(again, "theme_light")


def test_a_window_that_was_on_a_screen_that_is_gone_comes_back(make_viewer: MakeViewer) -> None:
    viewer = make_viewer()
    viewer.window.move(40_000, 40_000)
    geometry, splitters = viewer.window.layout_state()
    again = make_viewer(Preferences(theme="light", geometry=geometry, splitters=splitters))
    screens = [screen.availableGeometry() for screen in QApplication.screens()]
    assert any(screen.intersects(again.window.frameGeometry()) for screen in screens)


def test_opened_files_are_recent_files(viewer: Controller, mesh_files: tuple[Path, Path]) -> None:
    open_files(viewer, mesh_files[0])
    assert viewer.preferences.existing_recent() == [mesh_files[0]]


def test_every_action_answers(
    viewer: Controller, trained_run: FakeRun, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """No menu entry is without effect or raises, whatever the state."""
    for module, name in DIALOGS:
        monkeypatch.setattr(module, name, lambda *_, **__: None)
    show_fake(viewer, trained_run)
    for name in viewer.window.named_actions:
        if name not in ("quit", "start"):
            viewer.window.actionTriggered.emit(name)
            viewer.presenter.flush()
    for dialog in viewer.window.findChildren(dialogs.QDialog):
        assert dialog.isVisible()
        dialog.close()
    trigger(viewer, "theme_light")


def test_a_picture_is_saved_where_it_is_wanted(
    viewer: Controller, trained_run: FakeRun, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    show_fake(viewer, trained_run)
    wanted = [tmp_path / "shot.png", tmp_path / "no" / "such" / "shot.png"]
    monkeypatch.setattr(dialogs, "ask_save_picture", lambda *_: wanted.pop(0))
    trigger(viewer, "screenshot")
    assert (tmp_path / "shot.png").stat().st_size > 10_000
    trigger(viewer, "screenshot")
    assert "cannot be written" in viewer.window.banners.texts()[-1]


def test_opened_run_type_is_what_the_library_gives(tmp_path: Path) -> None:
    assert OpenedRun.__dataclass_fields__.keys() == {"run", "problem", "source", "suggestion"}
