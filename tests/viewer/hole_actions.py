"""What a person does with holes in the window, for the tests."""

from __future__ import annotations

from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt
from qtpy.QtWidgets import QComboBox

from dmp.problem import Problem
from dmp_viewer.controller import Controller
from dmp_viewer.views.hole_list import HoleList


def settle(viewer: Controller) -> None:
    assert viewer.background.wait(30)
    viewer.presenter.flush()


def choose_task(viewer: Controller, task: str) -> None:
    """Choose a task in the panel."""
    box = viewer.window.panel.editor("task")
    assert isinstance(box, QComboBox)
    box.setCurrentIndex(box.findData(task))
    box.activated.emit(box.currentIndex())
    assert viewer.window.panel.settings().task == task


def holes_of(viewer: Controller) -> HoleList:
    viewer.presenter.flush()
    return viewer.window.panel.hole_section.holes


def click(viewer: Controller, qtbot: QtBot, row: int, *, box: bool) -> None:
    """Click on the check box of a row, or elsewhere in it."""
    table = holes_of(viewer).table
    place = table.visualRect(table.model().index(row, 0 if box else 2))
    point = QPoint(place.left() + 9, place.center().y()) if box else place.center()
    qtbot.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, pos=point)
    viewer.presenter.flush()


def wait_until_filled_anew(viewer: Controller, qtbot: QtBot, before: Problem | None) -> Problem:
    qtbot.waitUntil(lambda: viewer.workspace.problem is not before, timeout=20_000)
    settle(viewer)
    assert viewer.workspace.problem is not None
    return viewer.workspace.problem
