"""The program as it is started by a person or a script, in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtGui import QImage

from dmp.errors import SettingsError
from dmp.mesh import TriangleMesh
from dmp.problem import denoising
from dmp.runs import Run, list_runs
from dmp.settings import settings_for
from dmp_viewer import startup
from dmp_viewer.controller import Controller
from dmp_viewer.picture_job import PictureJob
from dmp_viewer.tasks import continue_session, start_session

pytestmark = pytest.mark.usefixtures("qapp")  # for the display


@pytest.fixture
def small_run(tmp_path: Path, noisy_sphere: TriangleMesh) -> Run:
    """A finished run with snapshots of steps 0, 2 and 4."""
    settings = settings_for(steps=4, snapshot_every=2, threads=1)
    run = Run.create(denoising(noisy_sphere, settings), settings, folder=tmp_path / "run")
    assert len(list(continue_session(run).records)) == 5
    return run


def start(*line: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dmp_viewer", *map(str, line)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_a_picture_of_a_step_is_taken_in_the_real_window(tmp_path: Path, mesh_files: tuple[Path, Path]) -> None:
    noisy, clean = mesh_files
    picture = tmp_path / "out.png"
    result = start(
        noisy, "--ground-truth", clean, "--start", "--steps", 2000, "--snapshot-every", 10, "--seed", 3,
        "--screenshot", picture, "--at-step", 10, "--size", "1280x800", "--theme", "dark",
    )  # fmt: skip
    assert (result.returncode, result.stderr) == (0, "")
    image = QImage(str(picture))
    assert (image.width(), image.height()) == (1280, 800)
    assert len({image.pixelColor(x, y).name() for x in range(0, 1280, 8) for y in range(60, 500, 8)}) > 100
    (run,) = list_runs()
    assert run.state == "stopped"
    assert 10 in run.snapshot_steps()
    assert run.settings.seed == 3


def take_picture(viewer: Controller, qtbot: QtBot, path: Path, picture: Path, at_step: int | None) -> int:
    """Do in this process what ``--screenshot`` does, and return the exit code."""
    job = PictureJob(viewer, picture, at_step)
    viewer.opener.open_path(path)
    with qtbot.waitSignal(job.finished, timeout=20_000) as finished:
        job.begin(expects_mesh=True)
    return int(finished.args[0])


def test_a_picture_of_a_run_is_taken_without_training(
    viewer: Controller, qtbot: QtBot, tmp_path: Path, small_run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    assert take_picture(viewer, qtbot, small_run.folder, tmp_path / "out.png", 2) == 0
    assert (tmp_path / "out.png").stat().st_size > 10_000
    assert viewer.workspace.shown_step == 2
    assert capsys.readouterr().err == ""


def test_a_step_that_a_run_does_not_have_is_told(
    viewer: Controller, qtbot: QtBot, tmp_path: Path, small_run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    assert take_picture(viewer, qtbot, small_run.folder, tmp_path / "out.png", 3) == 2
    told = capsys.readouterr().err
    assert told == "dmp-viewer: There is no snapshot of step 3; this run has snapshots from 0 to 4.\n"
    assert not (tmp_path / "out.png").exists()


def test_a_mesh_that_cannot_be_read_is_told(
    viewer: Controller, qtbot: QtBot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / "bad.obj"
    bad.write_text("v 1 2\n")
    assert take_picture(viewer, qtbot, bad, tmp_path / "out.png", None) == 2
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1
    assert str(bad) in told


def test_an_error_while_the_picture_is_drawn_is_told_and_no_success(
    viewer: Controller,
    qtbot: QtBot,
    tmp_path: Path,
    small_run: Run,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    flush = viewer.presenter.flush

    def flush_with_a_fault() -> None:
        viewer.tell_error(RuntimeError("a pane cannot be drawn"))
        flush()

    monkeypatch.setattr(viewer.presenter, "flush", flush_with_a_fault)
    assert take_picture(viewer, qtbot, small_run.folder, tmp_path / "out.png", 2) == 2
    assert "a pane cannot be drawn" in capsys.readouterr().err
    assert (tmp_path / "out.png").exists()


def test_the_check_tells_what_a_bug_report_needs() -> None:
    result = start("--check")
    assert result.returncode == 0
    for word in ("torch", "Qt", "VTK", "OpenGL", "Training on", "can be shown"):
        assert word in result.stdout


def test_opengl_is_told_by_name() -> None:
    opengl = startup.probe_opengl()
    assert opengl.renderer != "unknown"
    assert tuple(map(int, opengl.version.split("."))) >= (3, 2)
    assert (opengl.multi_samples == 0) is opengl.is_software


def test_settings_that_cannot_work_leave_no_empty_run(noisy_sphere: TriangleMesh, tmp_path: Path) -> None:
    import torch

    from dmp_viewer.model import Source

    settings = settings_for(device=f"cuda:{torch.cuda.device_count()}")
    with pytest.raises(SettingsError, match="cuda"):
        start_session(Source("scan", noisy_sphere), settings, tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


def test_the_window_leaves_a_core_to_itself(noisy_sphere: TriangleMesh, tmp_path: Path) -> None:
    from dmp.devices import cores_beside_a_window
    from dmp_viewer.model import Source

    settings = settings_for(steps=2)
    session = start_session(Source("scan", noisy_sphere), settings, tmp_path / "runs")
    next(session.records)
    training = session.records.gi_frame.f_locals["training"]  # type: ignore[attr-defined]
    assert training.threads == cores_beside_a_window()
    session.records.close()  # type: ignore[attr-defined]
    assert np.isfinite(session.problem.base).all()
