"""The editors of single settings, and what the run panel makes of presets, tasks and convolutions."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtGui import QAction
from qtpy.QtWidgets import QCheckBox, QComboBox, QMainWindow, QToolButton

from dmp.mesh import TriangleMesh
from dmp.settings import SETTING_FIELDS, check, choices, settings_for
from dmp_viewer import tasks
from dmp_viewer.holes import find_holes
from dmp_viewer.model import Source
from dmp_viewer.views.run_panel import RunPanel
from dmp_viewer.views.setting_editors import ChoiceEditor, Editor, label, make_editor


@pytest.fixture
def panel(window: QMainWindow, named_actions: dict[str, QAction]) -> RunPanel:
    panel = RunPanel(named_actions, tasks=tasks.TASKS)
    window.setCentralWidget(panel)
    window.resize(320, 900)
    window.show()
    next(button for button in panel.findChildren(QToolButton) if button.text() == "Advanced").click()
    return panel


def _choose(editor: ChoiceEditor, value: str) -> None:
    """Choose as a person does; what is greyed out cannot be chosen."""
    index = editor.findData(value)
    assert editor.model().flags(editor.model().index(index, 0)) & Qt.ItemFlag.ItemIsEnabled
    editor.setCurrentIndex(index)
    editor.activated.emit(index)


def _choice(panel: RunPanel, name: str) -> ChoiceEditor:
    editor = panel.editor(name)
    assert isinstance(editor, ChoiceEditor)
    return editor


def test_every_setting_has_an_editor_that_returns_what_it_shows(qtbot: QtBot) -> None:
    for name, item in SETTING_FIELDS.items():
        editor = make_editor(name, (("auto", "Automatic"),) if name == "device" else None)
        qtbot.addWidget(editor)
        for value in choices(name) or ((True, False) if isinstance(item.default, bool) else (item.default,)):
            cast(Editor, editor).set_value(value)
            assert cast(Editor, editor).value() == value
            assert type(check(name, cast(Editor, editor).value())) is type(value)
        assert label(name)[0].isupper()


def test_a_switch_changes_its_setting(panel: RunPanel, qtbot: QtBot) -> None:
    switch = panel.editor("skip")
    assert isinstance(switch, QCheckBox)
    with qtbot.waitSignal(panel.settingsEdited):
        switch.click()
    assert panel.settings() == settings_for(skip=True)
    panel.set_settings(settings_for())
    assert not switch.isChecked()


@pytest.mark.parametrize("name", ["convolution", "smoothing", "architecture", "preset"])
def test_the_choices_are_written_for_people(panel: RunPanel, name: str) -> None:
    editor = _choice(panel, name)
    assert [editor.itemData(row) for row in range(editor.count())] == list(choices(name))
    assert all(editor.itemText(row)[0].isupper() for row in range(editor.count()))
    assert len({editor.itemText(row) for row in range(editor.count())}) == editor.count()


def test_only_what_the_convolution_knows_is_shown(panel: RunPanel) -> None:
    for value, shown in {
        "gcn": (False, False),
        "chebyshev": (True, False),
        "gmm": (False, True),
        "gmm-geometric": (False, True),
    }.items():
        _choose(_choice(panel, "convolution"), value)
        assert (panel.editor("chebyshev_order").isVisible(), panel.editor("gmm_kernels").isVisible()) == shown
        assert panel.settings().convolution == value


def test_a_preset_that_a_task_does_not_have_is_greyed_out_and_left(panel: RunPanel) -> None:
    preset = _choice(panel, "preset")

    def is_offered() -> bool:
        flags = preset.model().flags(preset.model().index(preset.findData("paper-2021-04"), 0))
        return bool(flags & Qt.ItemFlag.ItemIsEnabled)

    assert is_offered()
    _choose(preset, "paper-2021-04")
    assert panel.settings() == settings_for("denoise", "paper-2021-04")
    _choose(_choice(panel, "task"), "complete")
    assert panel.problem == ""
    assert panel.settings() == settings_for("complete")
    assert not is_offered()
    _choose(_choice(panel, "task"), "denoise")
    assert is_offered()


def test_a_mesh_that_is_no_sphere_is_shown_with_the_reason(sphere: TriangleMesh) -> None:
    opened = TriangleMesh(sphere.vertices, sphere.faces[:-2])
    source = Source("open", opened, None, None, None, find_holes(opened))
    settings = settings_for(smoothing="spherical")
    shown = tasks.set_up(source, settings)
    assert any("'spherical' needs one closed surface" in note and "is open" in note for note in shown.notes)
    plain = tasks.set_up(source, replace(settings, smoothing="laplacian"))
    assert np.array_equal(shown.problem.base, plain.problem.base)
    filled = tasks.set_up(source, settings_for("complete", "compact", smoothing="spherical"))
    centre = filled.problem.mesh.vertices.mean(axis=0)
    assert np.linalg.norm(filled.problem.base - centre, axis=1).std() < 1e-9


def test_a_combo_box_of_one_value_is_no_editor_of_the_panel(panel: RunPanel) -> None:
    assert all(box.count() > 1 for box in panel.findChildren(QComboBox) if box.objectName().startswith("setting_"))
