"""The mesh report in a real window: from the note at opening to the repaired mesh and back."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QCoreApplication, Qt
from qtpy.QtWidgets import QPushButton

from dmp.mesh import TriangleMesh
from dmp.mesh_report import Finding, mesh_report
from dmp.meshio import read_mesh, write_mesh
from dmp_viewer import report_control
from dmp_viewer.controller import Controller
from dmp_viewer.views import dialogs
from dmp_viewer.views.mesh_panes import INPUT
from dmp_viewer.views.mesh_report import MeshReportDialog
from tests import odd_meshes
from tests.viewer.conftest import pane_pixels, quick_settings
from tests.viewer.driving import MakeViewer, open_files, trigger, wait_until_trained


@pytest.fixture
def torn_file(tmp_path: Path) -> Path:
    """A ball that is cut open along its faces, with a crumb beside it and colours."""
    torn = odd_meshes.joined(odd_meshes.coincident_vertices(), odd_meshes.single_triangle())
    number = np.arange(torn.n_vertices) % 256
    write_mesh(tmp_path / "bracket.ply", torn.with_attributes(color=np.column_stack([number] * 3).astype(np.uint8)))
    return tmp_path / "bracket.ply"


def press(viewer: Controller, qtbot: QtBot, text: str) -> None:
    """Click the button of a message."""
    buttons = [button for banner in viewer.window.banners.banners() for button in banner.findChildren(QPushButton)]
    qtbot.mouseClick(next(button for button in buttons if button.text() == text), Qt.MouseButton.LeftButton)
    assert viewer.background.wait(20)
    viewer.presenter.flush()


def report_of(viewer: Controller) -> MeshReportDialog:
    trigger(viewer, "mesh_report")
    dialog = viewer.report.dialog
    assert dialog is not None and dialog.isVisible()
    return dialog


def row(dialog: MeshReportDialog, words: str) -> int:
    return next(index for index, text in enumerate(dialog.texts) if words in text)


def click(viewer: Controller, qtbot: QtBot, button: QPushButton) -> None:
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)
    assert viewer.background.wait(20)
    viewer.presenter.flush()


def test_a_clean_mesh_has_a_report_and_no_note(viewer: Controller, mesh_files: tuple[Path, Path], qtbot: QtBot) -> None:
    assert not viewer.window.named_actions["mesh_report"].isEnabled()
    trigger(viewer, "mesh_report")
    assert viewer.report.dialog is None
    open_files(viewer, mesh_files[0])
    assert viewer.window.banners.texts() == []
    dialog = report_of(viewer)
    assert dialog.heading == "scan.ply  ·  258 vertices, 512 faces"
    assert dialog.texts == []
    assert dialog.empty_text == "There is nothing odd about this mesh."
    assert not dialog.repair_button.isEnabled()
    assert not dialog.back_button.isVisible()
    assert not dialog.save_button.isVisible()


def test_a_mesh_with_faults_says_so_and_the_note_leads_to_the_report(viewer: Controller, torn_file: Path, qtbot: QtBot) -> None:
    open_files(viewer, torn_file)
    note = next(text for text in viewer.window.banners.texts() if "crack" in text)
    assert note.startswith("132 vertices lie exactly where another one lies.")
    press(viewer, qtbot, "Mesh report…")
    dialog = viewer.report.dialog
    assert dialog is not None and dialog.isVisible()
    assert dialog.texts[0].startswith("132 vertices")
    assert any("separate pieces" in text for text in dialog.texts)
    assert dialog.repair_button.isEnabled()


def test_a_finding_is_marked_on_the_input_and_the_mark_goes_with_the_report(
    viewer: Controller, torn_file: Path, qtbot: QtBot
) -> None:
    open_files(viewer, torn_file)
    dialog, marks = report_of(viewer), viewer.report.marks
    viewer.window.panes.reset_view()
    before = pane_pixels(viewer, INPUT)
    click(viewer, qtbot, dialog.show_buttons[0])
    assert dialog.show_buttons[0].text() == "Hide"
    assert (marks.n_dots, marks.n_lines) == (166, 0)
    # On the mesh, whatever way the panes place it.
    finding, problem = viewer.report.findings[0], viewer.workspace.problem
    assert problem is not None
    drawn = viewer.window.panes._panes[INPUT].coordinates[finding.vertices]
    assert np.allclose(marks.places, drawn, atol=1e-6)
    assert (pane_pixels(viewer, INPUT) != before).any()
    edges = row(dialog, "is open")
    click(viewer, qtbot, dialog.show_buttons[edges])
    assert (marks.n_dots, marks.n_lines) == (0, len(viewer.report.findings[edges].edges))
    assert dialog.show_buttons[0].text() == "Show"
    assert not dialog.show_buttons[0].isChecked()
    dialog.close()
    assert (marks.n_dots, marks.n_lines) == (0, 0)


def test_a_repaired_mesh_is_a_new_input_and_the_way_back_is_open(
    viewer: Controller, torn_file: Path, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = torn_file.read_bytes()
    open_files(viewer, torn_file)
    original = viewer.workspace.source
    assert original is not None
    dialog = report_of(viewer)
    # Nothing happens before the button is pressed.
    assert viewer.workspace.source is original
    click(viewer, qtbot, dialog.repair_button)
    repaired = viewer.workspace.source
    assert repaired is not None
    assert (repaired.name, repaired.path) == ("bracket (repaired)", None)
    assert repaired.mesh.n_vertices == 69
    assert "color" in repaired.mesh.vertex_attributes
    assert "bracket (repaired)" in viewer.window.windowTitle()
    assert any("Joined 132 vertices with others" in text for text in viewer.window.banners.texts())
    assert dialog.heading.startswith("bracket (repaired)")
    assert not dialog.repair_button.isEnabled()
    assert torn_file.read_bytes() == before

    monkeypatch.setattr(dialogs, "ask_save_mesh", lambda _parent, _title, proposal, _suffixes: proposal)
    click(viewer, qtbot, dialog.save_button)
    assert read_mesh(tmp_path / "bracket (repaired).ply").same_connectivity(repaired.mesh)
    monkeypatch.setattr(dialogs, "ask_save_mesh", lambda *_: torn_file)
    click(viewer, qtbot, dialog.save_button)
    assert any("is the file that was opened" in text for text in viewer.window.banners.texts())
    assert torn_file.read_bytes() == before

    dialog.choices["largest"].setChecked(True)
    click(viewer, qtbot, dialog.repair_button)
    assert viewer.workspace.source is not None
    assert viewer.workspace.source.name == "bracket (repaired)"
    assert viewer.workspace.source.mesh.n_vertices == 66
    press(viewer, qtbot, "Back to the original")
    assert viewer.workspace.source is repaired
    click(viewer, qtbot, dialog.back_button)
    assert viewer.workspace.source is original
    assert not dialog.back_button.isVisible()


def test_a_repaired_mesh_is_trained_on_under_its_name(viewer: Controller, torn_file: Path, qtbot: QtBot) -> None:
    open_files(viewer, torn_file)
    click(viewer, qtbot, report_of(viewer).repair_button)
    viewer.window.panel.set_settings(quick_settings(steps=5))
    trigger(viewer, "start")
    wait_until_trained(viewer, qtbot)
    run = viewer.workspace.run
    assert run is not None
    assert run.name.startswith("bracket (repaired), ")
    assert run.mesh_at(5).n_vertices == 69


def test_a_truth_that_fits_no_more_is_left_out_and_told(viewer: Controller, torn_file: Path, qtbot: QtBot) -> None:
    torn = read_mesh(torn_file)
    write_mesh(torn_file.with_name("clean.ply"), torn)
    open_files(viewer, torn_file, torn_file.with_name("clean.ply"))
    click(viewer, qtbot, report_of(viewer).repair_button)
    assert viewer.workspace.source is not None
    assert viewer.workspace.source.ground_truth is None
    assert any("ground truth was left out" in text for text in viewer.window.banners.texts())


def test_branching_surfaces_are_taken_apart_when_that_is_ticked(viewer: Controller, tmp_path: Path, qtbot: QtBot) -> None:
    write_mesh(tmp_path / "flap.ply", odd_meshes.non_manifold_edge())
    open_files(viewer, tmp_path / "flap.ply")
    dialog = report_of(viewer)
    assert not dialog.repair_button.isEnabled()
    dialog.choices["split"].setChecked(True)
    assert dialog.repair_button.isEnabled()
    click(viewer, qtbot, dialog.repair_button)
    assert viewer.workspace.mesh is not None
    assert viewer.workspace.mesh.n_vertices == 69
    assert not any("more than two faces" in text for text in dialog.texts)


def test_a_repair_that_leaves_nothing_is_told(
    viewer: Controller, torn_file: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dmp.errors import MeshError

    def refuse(*_: object) -> TriangleMesh:
        raise MeshError("Nothing would be left of this mesh.")

    monkeypatch.setattr("dmp.repair.repair", refuse)
    open_files(viewer, torn_file)
    dialog = report_of(viewer)
    click(viewer, qtbot, dialog.repair_button)
    assert "Nothing would be left of this mesh." in viewer.window.banners.texts()
    assert dialog.repair_button.isEnabled()
    assert dialog.repair_button.text() == "&Repair"


def test_the_report_follows_the_open_mesh_and_the_theme(
    make_viewer: MakeViewer, torn_file: Path, mesh_files: tuple[Path, Path], qtbot: QtBot
) -> None:
    viewer = make_viewer()
    open_files(viewer, torn_file)
    dialog = report_of(viewer)
    click(viewer, qtbot, dialog.show_buttons[0])
    assert viewer.report.marks.n_dots
    trigger(viewer, "theme_dark")
    open_files(viewer, mesh_files[0])
    assert dialog.isVisible()
    assert dialog.heading.startswith("scan.ply")
    assert dialog.texts == []
    assert viewer.report.marks.n_dots == 0
    # Nobody is told again of what lies open before them.
    open_files(viewer, torn_file)
    assert not any("crack" in text for text in viewer.window.banners.texts())
    qtbot.keyClick(dialog, Qt.Key.Key_Escape)
    assert not dialog.isVisible()


def test_nothing_is_said_about_a_mesh_before_it_was_looked_over(
    viewer: Controller, mesh_files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    may_end = threading.Event()

    def slow_report(mesh: TriangleMesh) -> tuple[Finding, ...]:
        assert may_end.wait(20)
        return mesh_report(mesh)

    monkeypatch.setattr(report_control, "mesh_report", slow_report)
    viewer.opener.open_path(mesh_files[0])
    while viewer.workspace.source is None:
        QCoreApplication.processEvents()
    viewer.report.open_report()
    dialog = viewer.report.dialog
    assert dialog is not None
    assert dialog.empty_text == "The mesh is being looked over…"
    may_end.set()
    assert viewer.background.wait(20)
    assert dialog.empty_text == "There is nothing odd about this mesh."

    def failing_report(_mesh: TriangleMesh) -> tuple[Finding, ...]:
        raise MemoryError

    monkeypatch.setattr(report_control, "mesh_report", failing_report)
    open_files(viewer, mesh_files[1])
    assert dialog.empty_text == "This mesh could not be looked over."
