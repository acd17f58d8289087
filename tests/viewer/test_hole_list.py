"""Holes in the real window: listed, chosen, refused, looked at, and drawn."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QSpinBox

from dmp.completion import completion
from dmp.mesh import TriangleMesh
from dmp.meshio import write_mesh
from dmp.shapes.alterations import with_holes
from dmp_viewer.controller import Controller
from dmp_viewer.views.mesh_panes import INPUT, SMOOTHED
from tests.meshes import grid_mesh, sphere_mesh
from tests.viewer.conftest import pane_pixels, quick_settings
from tests.viewer.driving import open_files, trigger, wait_until_trained
from tests.viewer.hole_actions import choose_task, click, holes_of, settle, wait_until_filled_anew

QUICK = quick_settings(task="complete", hold_out=0.0)


# -- the list ---------------------------------------------------------------------------------------------------------


def test_every_boundary_is_listed_with_what_happens_to_it(sheet: Controller) -> None:
    listed = holes_of(sheet)
    assert listed.isVisible()
    rows = listed.rows
    assert [row.n_edges for row in rows] == sorted((row.n_edges for row in rows), reverse=True)
    assert rows[0].n_edges == 4 * 23
    assert [row.is_filled for row in rows] == [False, True, True, True]
    assert [row.state for row in rows] == ["outer rim", "", "", ""]
    assert "outer rim of an open surface" in rows[0].details
    assert "edge lengths" in rows[1].details
    assert "3 of 4 are filled" in listed.summary
    sheet.window.color_bar.unitChosen.emit("file")
    assert "file units" in holes_of(sheet).rows[1].details
    choose_task(sheet, "denoise")
    settle(sheet)
    assert not listed.isVisible()
    assert not sheet.window.panes.outlines["chosen"].is_visible


def test_a_check_box_decides_what_is_filled_and_how_its_rim_is_drawn(sheet: Controller, qtbot: QtBot) -> None:
    panes, before = sheet.window.panes, sheet.workspace.problem
    assert before is not None
    whole, dashes = panes.outlines["chosen"].n_segments, panes.outlines["open"].n_segments
    rows = holes_of(sheet).rows
    assert whole == sum(row.n_edges for row in rows[1:])
    picture = pane_pixels(sheet, INPUT)
    click(sheet, qtbot, 1, box=True)
    assert holes_of(sheet).rows[1].state == "left open"
    assert panes.outlines["chosen"].n_segments == whole - rows[1].n_edges
    assert panes.outlines["open"].n_segments > dashes
    assert (pane_pixels(sheet, INPUT) != picture).any()
    after = wait_until_filled_anew(sheet, qtbot, before)
    assert after.mesh.n_vertices < before.mesh.n_vertices
    holes_of(sheet).table.setFocus()
    holes_of(sheet).table.setCurrentIndex(holes_of(sheet).table.model().index(1, 0))
    qtbot.keyClick(holes_of(sheet).table, Qt.Key.Key_Space)
    again = wait_until_filled_anew(sheet, qtbot, after)
    assert again.mesh.n_vertices == before.mesh.n_vertices
    assert not sheet.window.timeline.is_playing


def test_only_the_chosen_holes_are_trained_on(sheet: Controller, qtbot: QtBot) -> None:
    listed = holes_of(sheet)
    qtbot.mouseClick(listed.none_button, Qt.MouseButton.LeftButton)
    click(sheet, qtbot, 3, box=True)
    trigger(sheet, "start")  # before the holes are filled anew
    wait_until_trained(sheet, qtbot)
    problem = sheet.workspace.problem
    assert problem is not None
    source = sheet.workspace.source
    assert source is not None
    expected = completion(source.mesh, QUICK, loops=source.holes.loops[3:])
    assert problem.mesh.same_connectivity(expected.mesh)
    settle(sheet)
    assert sheet.window.panes.outlines["seam"].n_segments == source.holes.loops[3].n_edges


def test_without_a_chosen_hole_there_is_a_sentence(sheet: Controller, qtbot: QtBot) -> None:
    before = sheet.workspace.problem
    qtbot.mouseClick(holes_of(sheet).none_button, Qt.MouseButton.LeftButton)
    wait_until_filled_anew(sheet, qtbot, before)
    (banner,) = sheet.window.banners.banners()
    assert banner.message.kind == "info"
    assert "Tick at least one" in banner.message.text
    trigger(sheet, "start")
    qtbot.waitUntil(lambda: not sheet.runner.state.is_active, timeout=20_000)
    assert sheet.workspace.run is None
    qtbot.mouseClick(holes_of(sheet).all_button, Qt.MouseButton.LeftButton)
    assert [row.is_filled for row in holes_of(sheet).rows] == [False, True, True, True]


def test_the_largest_hole_is_a_setting(sheet: Controller, qtbot: QtBot) -> None:
    before = sheet.workspace.problem
    limit = holes_of(sheet).rows[2].n_edges
    editor = sheet.window.panel.editor("max_hole_edges")
    assert isinstance(editor, QSpinBox)
    editor.setValue(limit)
    after = wait_until_filled_anew(sheet, qtbot, before)
    assert [row.state for row in holes_of(sheet).rows] == ["too large", "too large", "", ""]
    assert f"up to {limit} edges" in holes_of(sheet).rows[1].details
    assert before is not None
    assert after.mesh.n_vertices < before.mesh.n_vertices
    click(sheet, qtbot, 1, box=True)  # is not to be had
    assert holes_of(sheet).rows[1].state == "too large"


def test_a_boundary_without_sides_is_refused_with_the_reason(viewer: Controller, qtbot: QtBot, tmp_path: Path) -> None:
    whole = sphere_mesh(3)
    top = int(np.argmax(whole.vertices[:, 2]))
    around = whole.faces[(whole.faces == top).any(axis=1)]
    other = np.array([vertex for vertex in around[0] if vertex != top])
    fins = np.array([[other[0], other[1], whole.n_vertices], [other[0], other[1], whole.n_vertices + 1]])
    vertices = np.vstack([whole.vertices, [[0.0, 0.2, 1.4], [0.2, 0.0, 1.4]]])
    fin = TriangleMesh(vertices, np.vstack([whole.faces, fins]))
    fin = with_holes(fin, [(0.0, 0.0, -1.0)], [12])
    write_mesh(tmp_path / "fin.ply", fin)
    viewer.window.panel.set_settings(QUICK)
    open_files(viewer, tmp_path / "fin.ply")
    settle(viewer)
    refused = [row for row in holes_of(viewer).rows if row.state == "cannot be filled"]
    assert refused
    assert all(not row.is_filled and not row.can_be_filled for row in refused)
    assert "more than two faces" in refused[0].details
    assert sum(row.is_filled for row in holes_of(viewer).rows) == 1
    qtbot.mouseClick(holes_of(viewer).all_button, Qt.MouseButton.LeftButton)
    assert sum(row.is_filled for row in holes_of(viewer).rows) == 1


def test_hundreds_of_holes_stay_usable(viewer: Controller, qtbot: QtBot, tmp_path: Path) -> None:
    sheet = grid_mesh(80)
    centres = [(float(x), float(y), 0.0) for x in range(4, 76, 4) for y in range(4, 76, 4)]
    write_mesh(tmp_path / "sieve.ply", with_holes(sheet, centres, [1] * len(centres)))
    viewer.window.panel.set_settings(QUICK)
    open_files(viewer, tmp_path / "sieve.ply")
    settle(viewer)
    listed = holes_of(viewer)
    assert len(listed.rows) == len(centres) + 1 > 300
    assert listed.table.height() < 200
    assert listed.table.verticalScrollBar().maximum() > 0
    started = time.perf_counter()
    qtbot.mouseClick(listed.none_button, Qt.MouseButton.LeftButton)
    viewer.presenter.flush()
    qtbot.mouseClick(listed.all_button, Qt.MouseButton.LeftButton)
    viewer.presenter.flush()
    assert time.perf_counter() - started < 1.5
    listed.table.setCurrentIndex(listed.table.model().index(250, 0))
    assert "Hole 251" in listed.details


def test_a_mesh_without_holes_gets_a_sentence_not_an_error(viewer: Controller, mesh_files: tuple[Path, Path]) -> None:
    open_files(viewer, mesh_files[0])
    assert viewer.window.banners.texts() == []
    choose_task(viewer, "complete")
    assert viewer.background.wait(20)
    (banner,) = viewer.window.banners.banners()
    assert banner.message.kind == "info"
    assert "no holes" in banner.message.text
    assert viewer.workspace.problem is not None
    assert "no holes" in holes_of(viewer).summary
    assert not holes_of(viewer).table.isVisible()


def test_a_mesh_with_holes_brings_a_hint_that_leads_to_filling(viewer: Controller, sheet_file: Path) -> None:
    open_files(viewer, sheet_file)
    (banner,) = viewer.window.banners.banners()
    assert "3 holes found" in banner.message.text
    assert banner.message.kind == "info"
    assert not viewer.window.panes.outlines["chosen"].is_visible
    assert banner.message.action is not None
    banner.message.action[1]()
    settle(viewer)
    assert viewer.window.panel.settings().task == "complete"
    assert viewer.workspace.is_completion
    assert viewer.window.panes.outlines["chosen"].is_visible


# -- what is looked at ------------------------------------------------------------------------------------------------


def test_a_click_in_the_list_turns_all_panes_to_the_hole(sheet: Controller, qtbot: QtBot) -> None:
    before = [pane_pixels(sheet, pane) for pane in (INPUT, SMOOTHED)]
    loop = sheet.workspace.holes.found.loops[2]
    click(sheet, qtbot, 2, box=False)
    panes = sheet.window.panes
    position, focus, _ = panes.camera_state()
    placed = (loop.center - panes._centre) * panes._scale
    assert focus == pytest.approx(placed)
    # From the side that the faces turn to, near enough to see the hole well.
    towards = np.array(position) - np.array(focus)
    assert towards / np.linalg.norm(towards) == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    share = loop.size * panes._scale / (2 * np.linalg.norm(towards) * np.tan(np.radians(15)))
    assert 0.2 < share < 0.6
    after = [pane_pixels(sheet, pane) for pane in (INPUT, SMOOTHED)]
    assert all((old != new).any() for old, new in zip(before, after, strict=True))
    assert panes.outlines["pointed"].n_segments == loop.n_edges
    assert "Hole 3" in holes_of(sheet).details
    cameras = [renderer.GetActiveCamera() for renderer in panes.interactor.renderers]
    assert cameras[0] is cameras[2]
    cameras[0].Azimuth(40)
    click(sheet, qtbot, 2, box=False)
    assert panes.camera_state()[0] == pytest.approx(position)


def test_unlinked_panes_stay_where_they_are(sheet: Controller, qtbot: QtBot) -> None:
    trigger(sheet, "link")
    elsewhere = sheet.window.panes.interactor.renderers[1].GetActiveCamera().GetPosition()
    click(sheet, qtbot, 1, box=False)
    assert sheet.window.panes.interactor.renderers[1].GetActiveCamera().GetPosition() == elsewhere
    assert sheet.window.panes.camera_state()[0] != elsewhere


def test_rims_are_seen_from_either_theme(sheet: Controller) -> None:
    for theme in ("light", "dark"):
        trigger(sheet, f"theme_{theme}")
        trigger(sheet, "plain")
        picture = pane_pixels(sheet, INPUT).astype(int)
        pink = (picture[..., 0] > 180) & (picture[..., 0] - picture[..., 1] > 80)
        assert pink.sum() > 100
    trigger(sheet, "theme_light")


def test_the_input_pane_shows_the_hole_and_the_others_its_filling(viewer: Controller, tmp_path: Path) -> None:
    write_mesh(tmp_path / "sheet.ply", with_holes(grid_mesh(15), [(7.0, 7.0, 0.0)], [21]))
    open_files(viewer, tmp_path / "sheet.ply")
    choose_task(viewer, "complete")
    assert viewer.background.wait(30)
    trigger(viewer, "plain")

    def middle_is_covered(pane: int) -> bool:
        picture = pane_pixels(viewer, pane).astype(int)
        row, column = picture.shape[0] // 2, picture.shape[1] // 2
        return bool(np.abs(picture[row, column] - picture[row, 1]).max() > 6)

    assert [middle_is_covered(pane) for pane in (INPUT, SMOOTHED)] == [False, True]


def test_holes_can_be_looked_at_but_not_chosen_during_a_training(sheet: Controller, qtbot: QtBot) -> None:
    sheet.window.panel.set_settings(quick_settings(task="complete", hold_out=0.0, steps=100_000))
    trigger(sheet, "start")
    qtbot.waitUntil(lambda: sheet.workspace.current_step >= 2, timeout=20_000)
    chosen = sheet.workspace.holes.chosen
    camera = sheet.window.panes.camera_state()
    click(sheet, qtbot, 1, box=True)
    assert sheet.workspace.holes.chosen == chosen
    assert sheet.window.panes.camera_state() != camera
    assert not holes_of(sheet).none_button.isEnabled()
    assert not sheet.window.panel.editor("task").isEnabled()
    assert sheet.window.panel.editor("steps").isEnabled()
    assert not sheet.window.panel.hole_section.denoise_too.isEnabled()
    trigger(sheet, "stop")
    wait_until_trained(sheet, qtbot)
    assert holes_of(sheet).none_button.isEnabled()


def test_a_mesh_opened_meanwhile_is_not_replaced_by_the_one_before(
    sheet: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path]
) -> None:
    sheet.window.panel.set_settings(quick_settings())
    sheet.opener.open_path(mesh_files[0])
    sheet.opener.change_task()  # of the sheet, which is still on show
    settle(sheet)
    assert sheet.workspace.source is not None
    assert sheet.workspace.source.name == "scan"
    assert sheet.workspace.problem is not None
    assert sheet.workspace.problem.mesh.n_vertices == 258
