"""What a person does in the window, for the tests that tell a story."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pytestqt.qtbot import QtBot

from dmp_viewer.controller import Controller
from dmp_viewer.model import Source
from tests.viewer.conftest import FakeRun

MakeViewer = Callable[..., Controller]


def trigger(viewer: Controller, name: str) -> None:
    """Do what a click in the menu does; an action that is off does nothing, as for a person."""
    viewer.presenter.flush()
    viewer.window.named_actions[name].trigger()
    viewer.presenter.flush()


def open_files(viewer: Controller, mesh: Path, truth: Path | None = None) -> None:
    viewer.opener.open_path(mesh, truth)
    assert viewer.background.wait(60)
    viewer.presenter.flush()


def show_fake(viewer: Controller, run: FakeRun) -> None:
    """Show a finished run that was never trained."""
    viewer.workspace.open_run(run, run.problem, Source("scan", run.problem.mesh), None)
    viewer.presenter.flush()


def wait_until_trained(viewer: Controller, qtbot: QtBot) -> None:
    qtbot.waitUntil(lambda: not viewer.runner.state.is_active, timeout=60_000)
    viewer.presenter.flush()
