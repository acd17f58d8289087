"""Completion in the real window: holes filled, learnt, compared with hole filling alone, and reopened."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt
from qtpy.QtWidgets import QComboBox, QSpinBox

from dmp.completion import completion
from dmp.mesh import TriangleMesh
from dmp.meshio import write_mesh
from dmp.problem import Problem
from dmp.runs import Run
from dmp.settings import DENOISE_TOO, default_preset, settings_for
from dmp.shapes.alterations import with_holes
from dmp_viewer.controller import Controller
from dmp_viewer.holes import find_holes
from dmp_viewer.model import Source
from dmp_viewer.states import RunnerState
from dmp_viewer.views.mesh_panes import INPUT, PREDICTED, SMOOTHED
from tests.meshes import sphere_mesh
from tests.viewer.conftest import FakeRun, pane_pixels, quick_settings
from tests.viewer.driving import open_files, trigger, wait_until_trained
from tests.viewer.hole_actions import choose_task, click, holes_of, settle, wait_until_filled_anew

MakeViewer = Callable[..., Controller]
QUICK = quick_settings(task="complete", hold_out=0.0)


@pytest.fixture
def holed_files(tmp_path: Path) -> tuple[Path, Path]:
    """A sphere with a hole around its top, and the whole sphere."""
    whole = sphere_mesh(3)
    write_mesh(tmp_path / "holed.ply", with_holes(whole, [(0.0, 0.0, 1.0)], [12]))
    write_mesh(tmp_path / "whole.ply", whole)
    return tmp_path / "holed.ply", tmp_path / "whole.ply"


def completed(problem: Problem, **changes: object) -> FakeRun:
    """A finished run of a completion that was never trained; its inserted vertices move up from the filling."""
    settings = replace(settings_for("complete", "compact", steps=40, snapshot_every=10, log_every=10), **changes)  # type: ignore[arg-type]
    run = FakeRun(problem, settings=settings, state="finished")
    for step in range(0, settings.steps + 1, 10):
        record = run.record(step)
        assert record.snapshot is not None
        vertices = problem.target + 0.02 * step * problem.edge_length * (~problem.known)[:, None]
        metrics = {"data_loss": 1.0 / (1 + step), "inserted_movement": 2.0 / (1 + step)}
        run.snapshots[step] = replace(record.snapshot, vertices=vertices, metrics=metrics)
        run.rows.append({"step": step, "seconds": float(step), **metrics})
    return run


def show(viewer: Controller, run: FakeRun, mesh: TriangleMesh) -> None:
    """Show a run on a mesh with holes."""
    viewer.workspace.open_run(run, run.problem, Source("scan", mesh, holes=find_holes(mesh)), None)
    viewer.window.panel.set_settings(run.settings)
    settle(viewer)


# -- the whole way ----------------------------------------------------------------------------------------------------


def test_holes_are_filled_learnt_and_reopened(make_viewer: MakeViewer, qtbot: QtBot, holed_files: tuple[Path, Path]) -> None:
    viewer = make_viewer()
    window = viewer.window
    open_files(viewer, *holed_files[:1])
    n_open = viewer.workspace.problem.mesh.n_vertices  # type: ignore[union-attr]
    choose_task(viewer, "complete")
    assert viewer.background.wait(30)
    viewer.presenter.flush()
    problem = viewer.workspace.problem
    assert problem is not None
    assert problem.mesh.n_vertices > n_open
    assert len(window.banners.texts()) == 1  # what was filled
    window.panel.set_settings(QUICK)
    trigger(viewer, "start")
    wait_until_trained(viewer, qtbot)
    run = viewer.workspace.run
    assert isinstance(run, Run)
    assert "inserted_movement" in viewer.workspace.curve.names()
    assert run.mesh_at(30).n_vertices == problem.mesh.n_vertices
    assert window.panes.titles[PREDICTED].texts[0] == "Completion @ step 30"

    again = make_viewer()
    open_files(again, run.folder)
    settle(again)
    assert again.workspace.source is not None
    assert again.workspace.source.mesh.n_vertices == n_open
    assert again.window.panel.settings().task == "complete"
    assert [row.is_filled for row in holes_of(again).rows] == [True]
    assert again.window.panes.outlines["chosen"].n_segments == again.window.panes.outlines["seam"].n_segments > 0
    assert again.window.named_actions["filling_only"].isVisible()
    assert "edges off" not in again.window.panes.titles[PREDICTED].texts[1]
    again.opener.open_ground_truth(holed_files[1])
    settle(again)
    settle(again)  # the measuring follows the opening
    assert "filling alone" in again.window.panes.titles[PREDICTED].texts[1]


def test_a_reopened_run_knows_its_holes_without_the_file(
    make_viewer: MakeViewer, qtbot: QtBot, sheet_file: Path, sheet: Controller
) -> None:
    click(sheet, qtbot, 1, box=True)
    wait_until_filled_anew(sheet, qtbot, sheet.workspace.problem)
    trigger(sheet, "start")
    wait_until_trained(sheet, qtbot)
    run = sheet.workspace.run
    assert isinstance(run, Run)
    sheet_file.unlink()
    again = make_viewer()
    open_files(again, run.folder)
    assert [row.is_filled for row in holes_of(again).rows] == [False, False, True, True]
    assert [row.state for row in holes_of(again).rows] == ["outer rim", "left open", "", ""]


# -- the completion beside hole filling alone ---------------------------------------------------------------------------


@pytest.fixture
def holed_sphere() -> TriangleMesh:
    return with_holes(sphere_mesh(3), [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0)], [12, 9])


@pytest.fixture
def filled_sphere(holed_sphere: TriangleMesh) -> Problem:
    return completion(holed_sphere, settings_for("complete", "compact"), sphere_mesh(3))


def test_the_seam_follows_the_prediction(viewer: Controller, holed_sphere: TriangleMesh, filled_sphere: Problem) -> None:
    show(viewer, completed(filled_sphere), holed_sphere)
    seam = viewer.window.panes.outlines["seam"]
    assert seam.n_segments == sum(loop.n_edges for loop in find_holes(holed_sphere).loops)
    with_seam = pane_pixels(viewer, PREDICTED)
    seam.set_visible(False)
    viewer.window.panes.interactor.mark()
    assert 20 < (with_seam != pane_pixels(viewer, PREDICTED)).any(axis=2).sum() < 0.1 * with_seam[..., 0].size


def test_hole_filling_alone_takes_the_place_of_the_completion(
    viewer: Controller, holed_sphere: TriangleMesh, filled_sphere: Problem
) -> None:
    show(viewer, completed(filled_sphere), holed_sphere)
    title = viewer.window.panes.titles[PREDICTED]
    assert title.texts[0] == "Completion @ step 40"
    settle(viewer)
    distance = filled_sphere.ground_truth.measures(filled_sphere.target)["hole_distance"]  # type: ignore[union-attr]
    assert f"(filling alone {distance:.3f})" in title.texts[1]
    before = [pane_pixels(viewer, pane) for pane in (INPUT, SMOOTHED, PREDICTED)]
    trigger(viewer, "filling_only")
    assert viewer.window.named_actions["filling_only"].isChecked()
    assert title.texts[0] == "Hole filling alone"
    assert title.texts[1].startswith(f"{distance:.3f} edges off (completion ")
    after = [pane_pixels(viewer, pane) for pane in (INPUT, SMOOTHED, PREDICTED)]
    assert [(old != new).any() for old, new in zip(before, after, strict=True)] == [False, False, True]
    trigger(viewer, "filling_only")
    assert not (before[PREDICTED] != pane_pixels(viewer, PREDICTED)).any()
    assert not viewer.window.panes.titles[PREDICTED].texts[0].startswith("Hole filling")


def test_the_toggle_is_there_for_completions_only(viewer: Controller, trained_run: FakeRun) -> None:
    viewer.workspace.open_run(trained_run, trained_run.problem, Source("scan", trained_run.problem.mesh), None)
    viewer.presenter.flush()
    action = viewer.window.named_actions["filling_only"]
    assert not action.isVisible()
    assert not action.isEnabled()
    viewer.window.actionTriggered.emit("filling_only")
    viewer.presenter.flush()
    assert viewer.window.panes.titles[PREDICTED].texts[0] == "Predicted @ step 40"


# -- the curve --------------------------------------------------------------------------------------------------------


def test_the_curve_shows_the_movement_and_says_what_it_means(
    viewer: Controller, holed_sphere: TriangleMesh, filled_sphere: Problem, qtbot: QtBot
) -> None:
    show(viewer, completed(filled_sphere), holed_sphere)
    curve = viewer.window.curve
    qtbot.waitUntil(lambda: curve.drawn_names() == ["inserted_movement"])
    viewer.presenter.flush()
    assert "edge lengths per 100 steps" in curve.advice
    assert "move" in curve.advice
    settle(viewer)
    assert "suggested" not in viewer.window.panes.titles[PREDICTED].texts[1]
    levels = {line.label.format for line in curve.plot._levels}
    assert levels == {"at rest below"}  # the distance in the holes is not drawn, so neither is that of the filling


def test_a_run_that_came_to_rest_says_so(
    viewer: Controller, holed_sphere: TriangleMesh, filled_sphere: Problem, qtbot: QtBot
) -> None:
    run = completed(filled_sphere)
    run.settings = replace(run.settings, steps=8000)  # it ended at step 40
    show(viewer, run, holed_sphere)
    assert viewer.window.panel.state_text == "At rest"
    qtbot.waitUntil(lambda: "At rest since step 40" in viewer.window.curve.advice)
    assert viewer.workspace.continue_until is None
    viewer.workspace.set_state(RunnerState.RUNNING)
    viewer.presenter.flush()
    assert viewer.window.panel.state_text == "Training"


def test_holes_made_up_have_their_own_sentence(
    viewer: Controller, holed_sphere: TriangleMesh, filled_sphere: Problem, qtbot: QtBot
) -> None:
    run = completed(filled_sphere, method="made-up-holes", preset="best")
    for row in run.rows:
        row["made_up_error"] = 0.125
    show(viewer, run, holed_sphere)
    qtbot.waitUntil(lambda: "made up where the truth is known" in viewer.window.curve.advice)
    assert "0.125" in viewer.window.curve.advice
    qtbot.waitUntil(lambda: "made_up_error" in viewer.window.curve.drawn_names())


# -- settings ---------------------------------------------------------------------------------------------------------


def test_noise_can_be_removed_as_well(sheet: Controller, qtbot: QtBot) -> None:
    panel = sheet.window.panel
    panel.set_settings(settings_for("complete", "compact"))
    box = panel.hole_section.denoise_too
    assert box.isVisible()
    qtbot.mouseClick(box, Qt.MouseButton.LeftButton, pos=QPoint(8, box.height() // 2))
    assert panel.settings() == settings_for("complete", **DENOISE_TOO)
    assert box.isChecked()
    qtbot.mouseClick(box, Qt.MouseButton.LeftButton, pos=QPoint(8, box.height() // 2))
    assert panel.settings() == settings_for("complete", "compact")
    panel.set_settings(settings_for("complete", **DENOISE_TOO))  # as from a reopened run
    assert box.isChecked()


def test_a_task_opens_with_its_own_preset(viewer: Controller) -> None:
    panel = viewer.window.panel
    panel.set_settings(settings_for("denoise"))
    choose_task(viewer, "complete")
    assert panel.settings() == settings_for("complete")
    assert panel.settings().preset == default_preset("complete")
    choose_task(viewer, "denoise")
    assert panel.settings() == settings_for("denoise")


def test_known_vertices_can_take_the_prediction_where_the_method_allows_it(viewer: Controller) -> None:
    panel = viewer.window.panel
    panel.set_settings(settings_for("complete", "compact"))
    known = panel.editor("known_vertices")
    assert isinstance(known, QComboBox)
    assert [known.itemText(index) for index in range(known.count())] == ["Keep exactly", "Take the prediction"]
    assert known.isEnabled()
    assert not known.isHidden()
    panel.set_settings(settings_for("complete", "best"))
    assert not known.isEnabled()


def test_the_sample_with_holes_opens_with_its_task(viewer: Controller, qtbot: QtBot) -> None:
    viewer.opener.offer_samples(with_pictures=False)
    qtbot.mouseClick(viewer.window.start_page.cards["holed-bumpy-sphere"], Qt.MouseButton.LeftButton)
    settle(viewer)
    settle(viewer)
    assert viewer.window.panel.settings() == settings_for("complete")
    assert viewer.workspace.is_completion
    assert len(holes_of(viewer).rows) == 2
    assert viewer.workspace.hole_measures(None)["hole_distance"] > 0.1


# -- going on ---------------------------------------------------------------------------------------------------------


def test_a_finished_run_goes_on_to_more_steps(viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path]) -> None:
    open_files(viewer, mesh_files[0])
    trigger(viewer, "start")
    wait_until_trained(viewer, qtbot)
    panel = viewer.window.panel
    steps = panel.editor("steps")
    assert isinstance(steps, QSpinBox)
    assert not panel.button("proceed").isVisible()
    steps.setValue(45)
    viewer.presenter.flush()
    assert panel.button("proceed").isVisible()
    assert panel.button("proceed").text() == "Continue to 45 steps"
    seed = panel.editor("seed")
    seed.set_value(7)  # type: ignore[attr-defined]
    seed.edited.emit()  # type: ignore[attr-defined]
    viewer.presenter.flush()
    assert not panel.button("proceed").isVisible()  # that would be another run
    seed.set_value(42)  # type: ignore[attr-defined]
    seed.edited.emit()  # type: ignore[attr-defined]
    viewer.presenter.flush()
    run = viewer.workspace.run
    qtbot.mouseClick(panel.button("proceed"), Qt.MouseButton.LeftButton)
    wait_until_trained(viewer, qtbot)
    assert viewer.workspace.run is run
    assert viewer.workspace.snapshot_steps[-3:] == [35, 40, 45]
    assert isinstance(run, Run)
    assert Run.open(run.folder).settings.steps == 45
    assert not panel.button("proceed").isVisible()


def test_the_curve_of_a_run_is_read_once_for_all_its_snapshots(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    from dmp import run_files

    open_files(viewer, mesh_files[0])
    trigger(viewer, "start")
    wait_until_trained(viewer, qtbot)
    run = viewer.workspace.run
    assert isinstance(run, Run)
    reads = []
    parse = run_files.parse_curve
    monkeypatch.setattr(run_files, "parse_curve", lambda content: reads.append(content) or parse(content))
    again = Run.open(run.folder)
    metrics = [again.snapshot(step).metrics for step in again.snapshot_steps()]
    assert len(reads) == 1
    assert all("data_loss" in each for each in metrics)
    again.curve()[0]["step"] = -1
    assert again.curve()[0]["step"] == 0
    (run.folder / "curve.csv").write_text("step,seconds\n0,0.0\n")
    assert len(again.curve()) == 1
