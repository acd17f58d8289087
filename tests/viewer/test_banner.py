"""Messages above the meshes."""

from __future__ import annotations

from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QApplication, QPushButton, QWidget

from dmp_viewer.controller import Controller
from dmp_viewer.theme import DARK, LIGHT
from dmp_viewer.views.banner import BannerArea, Message
from tests.viewer.conftest import FakeRun
from tests.viewer.driving import show_fake, trigger


def test_messages_are_counted_limited_and_dismissed(qtbot: QtBot) -> None:
    area = BannerArea()
    qtbot.addWidget(area)
    area.set_theme(LIGHT)
    for _ in range(3):
        area.show_message(Message("warning", "The disk is full."))
    assert area.texts() == ["The disk is full."]
    for number in range(4):
        area.show_message(Message("info", f"Note {number}."))
    assert area.texts() == ["Note 1.", "Note 2.", "Note 3."]
    area.banners()[0].dismiss()
    area.clear("error")
    assert area.texts() == ["Note 2.", "Note 3."]
    area.clear()
    assert area.texts() == []


def test_details_are_shown_and_copied_on_demand(qtbot: QtBot) -> None:
    area = BannerArea()
    qtbot.addWidget(area)
    area.set_theme(DARK)
    area.show()
    area.show_message(Message("error", "It broke.", details="line 7"))
    banner = area.banners()[0]
    details = next(
        child for child in banner.children() if isinstance(child, QWidget) and "line 7" in getattr(child, "toPlainText", str)()
    )
    assert not details.isVisible()
    qtbot.mouseClick(banner.details_button, Qt.MouseButton.LeftButton)
    assert details.isVisible()
    copy = next(button for button in banner.findChildren(QPushButton) if button.text() == "Copy")
    qtbot.mouseClick(copy, Qt.MouseButton.LeftButton)
    assert QApplication.clipboard().text() == "It broke.\n\nline 7"


def test_an_action_is_done_once(qtbot: QtBot) -> None:
    area, done = BannerArea(), list[int]()
    qtbot.addWidget(area)
    area.set_theme(LIGHT)
    area.show_message(Message("success", "Ready.", action=("Show it", lambda: done.append(1))))
    button = next(button for button in area.findChildren(QPushButton) if button.text() == "Show it")
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)
    assert done == [1]
    assert area.texts() == []


def test_a_message_takes_its_room_from_the_curve(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> None:
    show_fake(viewer, trained_run)
    window, drawn = viewer.window, list[object]()
    window.resize(1200, 900)
    qtbot.wait(100)
    view, curve = window.panes.interactor, window.curve
    sizes, height = view.size(), curve.height()
    place = view.mapTo(window, view.rect().topLeft())
    view.painted.connect(drawn.append)
    window.banners.show_message(Message("success", "Ready."))
    qtbot.waitUntil(lambda: view.mapTo(window, view.rect().topLeft()) != place)
    qtbot.wait(50)
    assert view.size() == sizes
    assert curve.height() < height
    window.banners.clear()
    qtbot.waitUntil(lambda: view.mapTo(window, view.rect().topLeft()) == place)
    qtbot.wait(50)
    assert (view.size(), curve.height()) == (sizes, height)
    # Meshes that keep their size are not drawn anew, which takes a tenth of a second.
    assert drawn == []


def test_without_a_curve_the_meshes_make_room(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> None:
    show_fake(viewer, trained_run)
    trigger(viewer, "show_curve")
    qtbot.wait(50)
    view = viewer.window.panes.interactor
    height = view.height()
    viewer.window.banners.show_message(Message("success", "Ready."))
    qtbot.waitUntil(lambda: view.height() < height)
    viewer.window.banners.clear()
    qtbot.waitUntil(lambda: view.height() == height)


def test_meshes_of_another_size_are_drawn_once(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> None:
    show_fake(viewer, trained_run)
    qtbot.wait(50)
    view, drawn = viewer.window.panes.interactor, list[object]()
    view.painted.connect(drawn.append)
    viewer.window.resize(viewer.window.width() + 100, viewer.window.height())
    qtbot.waitUntil(lambda: bool(drawn))
    qtbot.wait(50)
    assert drawn == [{0, 1, 2}]
