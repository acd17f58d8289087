"""Everything that can leave the window, through its dialog; tests look into the files."""

from __future__ import annotations

import csv
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt

from dmp import rendering
from dmp.cli import main
from dmp.errors import DmpError
from dmp.exports.encoding import find_ffmpeg
from dmp.exports.watching import Watch
from dmp.meshio import read_mesh
from dmp_viewer import export_control
from dmp_viewer.controller import Controller
from dmp_viewer.export_requests import MeshRequest, PictureRequest
from dmp_viewer.export_scenes import PictureWish, Scenery
from dmp_viewer.theme import LIGHT
from dmp_viewer.views import export_dialog
from dmp_viewer.views.export_dialog import ExportDialog
from dmp_viewer.views.export_pages import Page
from dmp_viewer.views.mesh_panes import PREDICTED
from tests.viewer.conftest import FakeRun, pane_pixels, quick_settings
from tests.viewer.driving import open_files, show_fake, trigger, wait_until_trained


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Path]]:
    """Take every file name as it is proposed, and remember the questions."""
    asked: list[tuple[str, Path]] = []

    def answer(_parent: object, title: str, proposal: Path, _suffixes: Sequence[str]) -> Path:
        asked.append((title, proposal))
        return proposal

    monkeypatch.setattr(export_dialog, "ask_target", answer)
    return asked


def dialog_of(viewer: Controller) -> ExportDialog:
    trigger(viewer, "export")
    assert viewer.exports.dialog is not None
    return viewer.exports.dialog


def export(viewer: Controller, qtbot: QtBot, page: Page) -> None:
    dialog = dialog_of(viewer)
    dialog.choose(page)
    assert dialog.reason == ""
    qtbot.mouseClick(dialog.export_button, Qt.MouseButton.LeftButton)
    assert viewer.exports.is_busy
    assert not dialog.export_button.isEnabled()
    qtbot.waitUntil(lambda: not viewer.exports.is_busy, timeout=60_000)


def test_export_everything(
    viewer: Controller,
    qtbot: QtBot,
    tmp_path: Path,
    mesh_files: tuple[Path, Path],
    answers: list[tuple[str, Path]],
) -> None:
    if not rendering.can_render():
        pytest.skip("this machine offers no way to draw")
    window, workspace = viewer.window, viewer.workspace
    assert not window.named_actions["export"].isEnabled()
    open_files(viewer, *mesh_files)
    dialog = dialog_of(viewer)
    for page in (dialog.mesh, dialog.curve, dialog.report):
        dialog.choose(page)
        assert "Start a training" in dialog.reason
        assert not dialog.export_button.isEnabled()
    viewer.window.panel.set_settings(quick_settings(steps=15))
    trigger(viewer, "start")
    wait_until_trained(viewer, qtbot)
    workspace.show_step(5)
    workspace.keep(5)
    workspace.show_step(10)
    qtbot.wait(120)

    dialog = dialog_of(viewer)
    assert [dialog.mesh.step.itemText(index) for index in range(2)] == ["The kept step, 5", "The shown step, 10"]
    workspace.colors.set(quantity="error")
    qtbot.waitUntil(lambda: dialog.mesh.colors.text() == "Colour the vertices by: error: distance")
    dialog.mesh.colors.setChecked(True)
    export(viewer, qtbot, dialog.mesh)
    mesh = read_mesh(tmp_path / "scan_step5.ply")
    kept = workspace.snapshot(5)
    assert kept is not None
    assert np.allclose(mesh.vertices, kept.vertices)
    assert {"displacement", "displacement_length", "error", "color"} == set(mesh.vertex_attributes)

    dialog.picture.size.setCurrentIndex(dialog.picture.size.findData(None))
    dialog.picture.width_box.setValue(600)
    dialog.picture.height_box.setValue(300)
    dialog.picture.ground.setCurrentIndex(dialog.picture.ground.findData("none"))
    export(viewer, qtbot, dialog.picture)
    with Image.open(tmp_path / "scan_step10.png") as picture:
        assert (picture.mode, picture.size) == ("RGBA", (600, 300))
        opacity = np.asarray(picture)[..., 3]
    assert opacity[-1, 0] == opacity[150, 1] == 0
    assert opacity[150, 100] == opacity[150, 300] == opacity[150, 500] == 255

    dialog.animation.size.setCurrentIndex(dialog.animation.size.findData(None))
    dialog.animation.width_box.setValue(240)
    dialog.animation.height_box.setValue(120)
    dialog.animation.fps.setValue(4)
    dialog.animation.seconds.setValue(1.0)
    assert viewer.exports.offer().steps == (0, 5, 10, 15)
    export(viewer, qtbot, dialog.animation)
    with Image.open(tmp_path / "scan_steps.gif") as animation:
        assert (animation.n_frames, animation.size) == (4, (240, 120))

    export(viewer, qtbot, dialog.curve)
    with (tmp_path / "scan_curve.csv").open() as file:
        rows = [{name: float(text) for name, text in row.items() if text} for row in csv.DictReader(file)]
    assert rows == workspace.curve.rows
    dialog.curve.format.setCurrentIndex(dialog.curve.format.findData(".svg"))
    export(viewer, qtbot, dialog.curve)
    assert (tmp_path / "scan_curve.svg").read_text().count("<path") > 10

    export(viewer, qtbot, dialog.report)
    report = (tmp_path / "scan_report.html").read_text()
    mad = workspace.curve.value_at("mad", 5)
    assert f"{mad:.2f}°" in report
    assert "step 5 of 15, kept by a person" in report
    assert [proposal.name for _, proposal in answers] == [
        "scan_step5.ply", "scan_step10.png", "scan_steps.gif", "scan_curve.csv", "scan_curve.svg", "scan_report.html",
    ]  # fmt: skip
    assert window.banners.texts()[-1] == f"The report was saved as {tmp_path / 'scan_report.html'}."


def test_the_window_stays_alive_shows_progress_and_cancels(
    viewer: Controller, qtbot: QtBot, trained_run: FakeRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    show_fake(viewer, trained_run)
    dialog = dialog_of(viewer)
    reached = threading.Event()

    def slow(path: Path, *_: object) -> None:
        watch = next(item for item in _ if isinstance(item, Watch))
        for part in range(1000):
            watch.tell("Drawing…", part, 1000)
            if part == 5:
                reached.set()
            time.sleep(0.02)
        path.write_bytes(b"never")

    monkeypatch.setattr(export_control, "write_drawing", slow)
    viewer.exports.export(PictureRequest(PictureWish()), tmp_path / "p.png")
    qtbot.waitUntil(lambda: reached.is_set() and dialog.progress_text == "Drawing…")
    assert dialog.cancel_button.isVisible()
    # The window itself works on meanwhile, also without the dialog.
    dialog.close()
    viewer.workspace.show_step(10)
    viewer.presenter.flush()
    assert viewer.window.panes.titles[PREDICTED].texts[0] == "Predicted @ step 10"
    dialog = dialog_of(viewer)
    qtbot.mouseClick(dialog.cancel_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: not viewer.exports.is_busy, timeout=3000)
    assert viewer.window.banners.texts() == ["The export was cancelled; nothing was written."]
    assert not (tmp_path / "p.png").exists()
    assert dialog.progress_text == ""


def test_an_error_is_a_sentence_and_the_next_export_works(
    viewer: Controller, qtbot: QtBot, trained_run: FakeRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    show_fake(viewer, trained_run)

    def fails(*_: object) -> None:
        raise DmpError("No picture can be drawn here.")

    monkeypatch.setattr(export_control, "write_drawing", fails)
    viewer.exports.export(PictureRequest(PictureWish()), tmp_path / "p.png")
    qtbot.waitUntil(lambda: not viewer.exports.is_busy)
    assert viewer.window.banners.texts() == ["No picture can be drawn here."]
    viewer.exports.export(MeshRequest(20), tmp_path / "no" / "m.ply")
    qtbot.waitUntil(lambda: not viewer.exports.is_busy)
    assert "the file or its folder does not exist" in viewer.window.banners.texts()[-1]


def test_mp4_says_what_is_missing_and_jpeg_has_a_ground(viewer: Controller, trained_run: FakeRun) -> None:
    show_fake(viewer, trained_run)
    dialog = dialog_of(viewer)
    dialog.set_offer(replace(viewer.exports.offer(), no_mp4="" if find_ffmpeg() is None else "MP4 needs ffmpeg."))
    dialog.choose(dialog.animation)
    dialog.animation.format.setCurrentIndex(1)
    assert (dialog.reason == "") == (find_ffmpeg() is None)
    dialog.choose(dialog.picture)
    dialog.picture.format.setCurrentIndex(dialog.picture.format.findData(".jpg"))
    assert dialog.export_button.isEnabled()
    dialog.picture.ground.setCurrentIndex(dialog.picture.ground.findData("none"))
    assert dialog.reason.startswith("JPEG cannot be transparent")
    assert not dialog.export_button.isEnabled()


@pytest.mark.parametrize("mode", ["off", "swipe", "lens"])
def test_a_picture_shows_what_the_window_shows(viewer: Controller, qtbot: QtBot, trained_run: FakeRun, mode: str) -> None:
    from dmp.exports.composing import Composer
    from dmp.exports.layout import Layout

    if not rendering.can_render():
        pytest.skip("this machine offers no way to draw")
    show_fake(viewer, trained_run)
    viewer.workspace.look.set(shading="smooth")
    viewer.workspace.comparison.set_mode(mode)  # type: ignore[arg-type]
    viewer.window.panes.interactor.renderers[0].GetActiveCamera().Azimuth(30)
    viewer.presenter.flush()
    qtbot.wait(100)
    # Without the handle, which is no part of the meshes.
    viewer.window.panes.handle.hide()
    seen = pane_pixels(viewer, PREDICTED)
    height, width = seen.shape[:2]
    wish = PictureWish("predicted", width + 8, height, has_titles=False, has_scale=False)
    sheet, frame = Scenery(viewer.window, viewer.workspace, wish).picture()
    assert sheet.paper.top == LIGHT.view_top
    assert Layout(sheet, 1).pane_aspect == pytest.approx(viewer.window.panes.pane_aspect, rel=0.03)
    composer = Composer(sheet)
    drawn = np.asarray(composer.compose(frame))[:, 4:-4]
    composer.close()
    difference = np.abs(drawn.astype(int) - seen.astype(int)).max(axis=2)
    assert (difference > 40).mean() < 0.03


def test_a_turntable_of_a_mesh_that_was_never_trained(viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path]) -> None:
    open_files(viewer, mesh_files[0])
    dialog = dialog_of(viewer)
    dialog.choose(dialog.animation)
    assert "no steps to animate yet" in dialog.reason
    dialog.animation.kind.setCurrentIndex(1)
    assert dialog.reason == ""
    scenery = Scenery(viewer.window, viewer.workspace, PictureWish("input", 100, 100))
    _, frames = scenery.animation([0] * 4, lambda _step: pytest.fail("nothing is read"), str, turn=360.0, has_prediction=False)
    eyes = [frame.panes[0].viewpoint.position for frame in frames if frame.panes[0] is not None]
    middle = np.mean(eyes, axis=0)
    # Four corners of a square around the axis that points up.
    assert np.allclose([np.linalg.norm(eye - middle) for eye in eyes], np.linalg.norm(eyes[0] - middle))
    assert np.ptp([eye[1] for eye in eyes]) < 1e-9


def test_the_dialog_and_the_command_line_write_the_same_mesh(
    viewer: Controller, qtbot: QtBot, mesh_files: tuple[Path, Path], tmp_path: Path
) -> None:
    open_files(viewer, *mesh_files)
    viewer.window.panel.set_settings(quick_settings(steps=5))
    trigger(viewer, "start")
    wait_until_trained(viewer, qtbot)
    viewer.exports.export(MeshRequest(5), tmp_path / "window.ply")
    qtbot.waitUntil(lambda: not viewer.exports.is_busy)
    run = viewer.workspace.run
    assert run is not None
    with pytest.raises(SystemExit) as ended:
        main(["export", str(run.folder), "--step", "5", "-o", str(tmp_path / "command.ply")])
    assert ended.value.code == 0
    assert (tmp_path / "window.ply").read_bytes() == (tmp_path / "command.ply").read_bytes()


def test_closing_the_window_ends_an_export(viewer: Controller, qtbot: QtBot, trained_run: FakeRun, tmp_path: Path) -> None:
    if not rendering.can_render():
        pytest.skip("this machine offers no way to draw")
    show_fake(viewer, trained_run)
    viewer.exports.export(PictureRequest(PictureWish(width=4000, height=2000)), tmp_path / "p.png")
    started = time.monotonic()
    assert viewer.window.close()
    assert time.monotonic() - started < 3
    assert not (tmp_path / "p.png").exists()
