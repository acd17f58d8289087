"""What people are used to: sides by number keys, a layout that is remembered and reset, and a window that needs no mouse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QMimeData, QPoint, QPointF, QRect, QSize, Qt, QUrl
from qtpy.QtGui import QAccessible, QDragEnterEvent, QDropEvent, QImage
from qtpy.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLineEdit,
    QWidget,
)

from dmp_viewer import actions, keys
from dmp_viewer.controller import Controller
from dmp_viewer.settings import load
from dmp_viewer.views import dialogs
from dmp_viewer.views.sides import SIDES
from tests.viewer.conftest import FakeRun, pane_pixels
from tests.viewer.driving import MakeViewer, show_fake, trigger

_CONTROLS = (QAbstractButton, QComboBox, QAbstractSlider, QAbstractSpinBox, QLineEdit, QAbstractItemView)


def _in_sight(viewer: Controller) -> list[QWidget]:
    """Return the controls that a person can see, without those that belong to another one."""
    found = []
    for widget in viewer.window.findChildren(QWidget):
        parent = widget.parentWidget()
        is_part = isinstance(parent, (QComboBox, QAbstractSpinBox, QLineEdit)) or widget.objectName().startswith("qt_")
        if isinstance(widget, _CONTROLS) and widget.isVisible() and not is_part:
            found.append(widget)
    return found


@pytest.fixture
def full(viewer: Controller, trained_run: FakeRun, qtbot: QtBot) -> Controller:
    """A window with a run on show and all of its parts in sight."""
    show_fake(viewer, trained_run)
    trigger(viewer, "show_runs")
    assert viewer.runs.wait(20)
    viewer.window.resize(1500, 950)
    with qtbot.waitActive(viewer.window):
        viewer.window.activateWindow()
    QApplication.processEvents()
    return viewer


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize(("key", "side"), [(Qt.Key.Key_1, "front"), (Qt.Key.Key_3, "side"), (Qt.Key.Key_7, "top")])
def test_number_keys_look_from_a_side(full: Controller, qtbot: QtBot, up: str, key: Qt.Key, side: str) -> None:
    full.workspace.look.set(up=up)
    full.presenter.flush()
    full.window.runs.search.clearFocus()
    oblique = full.window.panes.camera_state()
    qtbot.keyClick(full.window, key)
    position, focus, above = map(np.array, full.window.panes.camera_state())
    towards = (position - focus) / np.linalg.norm(position - focus)
    assert towards == pytest.approx(SIDES[up][side][0], abs=1e-6)
    assert above == pytest.approx(SIDES[up][side][1], abs=1e-6)
    # The whole mesh is in view: something in the middle, the ground at all rims.
    picture = pane_pixels(full, 0).astype(int)
    rows, columns = picture.shape[:2]
    assert np.abs(picture[rows // 2, columns // 2] - picture[rows // 2, 2]).max() > 20
    for line in (picture[:3], picture[-3:]):
        assert np.ptp(line.mean(axis=-1), axis=1).max() < 12
    qtbot.keyClick(full.window, Qt.Key.Key_9)
    assert np.allclose(np.concatenate(full.window.panes.camera_state()), np.concatenate(oblique))


def test_the_sides_are_square_to_each_other() -> None:
    for sides in SIDES.values():
        eyes = np.array([sides[side][0] for side in ("front", "side", "top")])
        assert np.array_equal(eyes @ eyes.T, np.eye(3))
        assert all(np.dot(eye, above) == 0 for eye, above in sides.values())
        # From the front, the right side is at the right.
        eye, above = (np.array(direction) for direction in sides["front"])
        assert np.cross(above, eye) == pytest.approx(sides["side"][0])


def test_the_layout_is_remembered_and_reset(make_viewer: MakeViewer, trained_run: FakeRun, tmp_path: Path) -> None:
    viewer = make_viewer(width=1300, height=800)
    show_fake(viewer, trained_run)
    first = viewer.window._splitters["rows"].sizes()
    trigger(viewer, "show_runs")
    viewer.window.addDockWidget(Qt.DockWidgetArea.RightDockWidgetArea, viewer.window.runs)
    for name in ("show_panel", "show_thumbnails"):
        trigger(viewer, name)
    viewer.window._splitters["rows"].setSizes([300, 400])
    QApplication.processEvents()
    assert viewer.window.close()

    again = make_viewer(load(tmp_path / "window.json"), width=1300, height=800)
    show_fake(again, trained_run)
    window = again.window
    assert window.runs.isVisible()
    assert window.named_actions["show_runs"].isChecked()
    assert window.dockWidgetArea(window.runs) == Qt.DockWidgetArea.RightDockWidgetArea
    assert not window.panel.isVisible()

    trigger(again, "reset_layout")
    QApplication.processEvents()
    assert not window.runs.isVisible()
    assert window.dockWidgetArea(window.runs) == Qt.DockWidgetArea.LeftDockWidgetArea
    assert window.panel.isVisible()
    assert window.curve.isVisible()
    assert window.timeline.strip.isVisible()
    assert abs(window._splitters["rows"].sizes()[1] - first[1]) < 60
    for name, on in (("show_runs", False), ("show_panel", True), ("show_curve", True), ("show_thumbnails", True)):
        assert window.named_actions[name].isChecked() is on


def test_a_damaged_memory_of_the_layout_does_no_harm(make_viewer: MakeViewer, tmp_path: Path) -> None:
    (tmp_path / "window.json").write_text('{"docks": "bm90IGEgbGF5b3V0", "geometry": "AAAA", "pace": 3}')
    viewer = make_viewer(load(tmp_path / "window.json"))
    assert viewer.window.isVisible()
    assert not viewer.window.runs.isVisible()


def test_the_list_of_runs_is_a_window_of_its_own_when_wanted(full: Controller, qtbot: QtBot) -> None:
    dock = full.window.runs
    qtbot.mouseClick(dock._float, Qt.MouseButton.LeftButton)
    assert dock.isFloating()
    qtbot.mouseClick(dock._float, Qt.MouseButton.LeftButton)
    assert not dock.isFloating()
    qtbot.mouseClick(dock._close, Qt.MouseButton.LeftButton)
    assert not full.window.named_actions["show_runs"].isChecked()


def test_everything_has_a_name_for_those_who_cannot_see_it(full: Controller) -> None:
    nameless = []
    for widget in _in_sight(full):
        interface = QAccessible.queryAccessibleInterface(widget)
        if interface is None or not interface.text(QAccessible.Text.Name).strip():
            nameless.append((type(widget).__name__, widget.objectName(), widget.toolTip()[:40]))
    assert nameless == []


def test_everything_can_be_reached_by_tab(full: Controller) -> None:
    unreachable = [
        (type(widget).__name__, widget.objectName(), widget.accessibleName())
        for widget in _in_sight(full)
        if widget.isEnabled() and not widget.focusPolicy() & Qt.FocusPolicy.TabFocus
    ]
    assert unreachable == []
    # Walking on with Tab comes to each of them before it comes back.
    wanted = {widget for widget in _in_sight(full) if widget.isEnabled()}
    seen, widget = set(), full.window.nextInFocusChain()
    while widget is not full.window and len(seen) < 3000:
        seen.add(widget)
        widget = widget.nextInFocusChain()
    assert wanted <= seen


def test_the_focus_can_be_seen_wherever_tab_leads(full: Controller, qtbot: QtBot) -> None:
    full.window.runs.search.setFocus()
    seen: dict[QWidget, bool] = {}

    def look(widget: QWidget) -> QImage:
        QApplication.processEvents()
        return full.window.grab(QRect(widget.mapTo(full.window, QPoint(-2, -2)), widget.size() + QSize(4, 4))).toImage()

    while (widget := QApplication.focusWidget()) not in seen:
        assert widget is not None
        focused = look(widget)
        qtbot.keyClick(widget, Qt.Key.Key_Tab)
        assert QApplication.focusWidget() is not widget, widget.accessibleName()
        seen[widget] = look(widget) != focused
    assert len(seen) > 40
    unseen = [(type(widget).__name__, widget.objectName(), widget.accessibleName()) for widget in seen if not seen[widget]]
    assert unseen == []


def test_the_list_of_keys_names_every_key(full: Controller) -> None:
    trigger(full, "keys")
    (dialog,) = full.window.findChildren(dialogs.KeysDialog)
    (table,) = dialog.findChildren(dialogs.QTableWidget)
    listed = [[table.item(row, column).text() for column in range(3)] for row in range(table.rowCount())]
    for spec in actions.ACTIONS:
        if spec.key:
            assert [keys.what(spec), keys.key_text(spec.key)] in [row[1:] for row in listed], spec.name
    assert {"1", "3", "5", "7", "9", "F1 or ?", "F4"} <= {row[2] for row in listed}
    dialog.close()


def test_what_is_dropped_on_the_list_of_runs_is_opened_too(
    full: Controller, mesh_files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(mesh_files[0]))])
    everywhere, plain = Qt.DropAction.CopyAction, Qt.KeyboardModifier.NoModifier
    for target in (full.window.runs.queue.rows.viewport(), full.window.runs.list.viewport()):
        enter = QDragEnterEvent(QPoint(5, 5), everywhere, data, Qt.MouseButton.LeftButton, plain)
        QApplication.sendEvent(target, enter)
        # Rows take only rows; a file falls through to the window, which takes it.
        assert enter.isAccepted()
    drop = QDropEvent(QPointF(5, 5), everywhere, data, Qt.MouseButton.LeftButton, plain)
    QApplication.sendEvent(full.window, drop)
    assert full.background.wait(20)
    assert full.workspace.source is not None
    assert full.workspace.source.path == mesh_files[0]
