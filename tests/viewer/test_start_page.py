"""The start page and the pictures on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, Qt
from qtpy.QtGui import QAction, QKeyEvent
from qtpy.QtWidgets import QApplication, QPushButton

from dmp.mesh import TriangleMesh
from dmp_viewer.thumbnails import thumbnail
from dmp_viewer.views.start_page import StartPage


def test_the_start_page_offers_samples_and_recent_files(
    qtbot: QtBot, named_actions: dict[str, QAction], tmp_path: Path
) -> None:
    page = StartPage(named_actions)
    qtbot.addWidget(page)
    page.resize(900, 700)
    page.show()
    page.set_samples([("bumpy", "Bumpy sphere", "A sphere."), ("fan", "Fan block", "A part.")])
    page.set_recent([tmp_path / "a.ply"])
    with qtbot.waitSignal(page.sampleChosen, check_params_cb=lambda name: name == "fan"):
        qtbot.mouseClick(page.cards["fan"], Qt.MouseButton.LeftButton)
    with qtbot.waitSignal(page.sampleChosen, check_params_cb=lambda name: name == "bumpy"):
        QApplication.sendEvent(
            page.cards["bumpy"], QKeyEvent(QEvent.Type.KeyPress, Qt.Key.Key_Space, Qt.KeyboardModifier.NoModifier)
        )
        QApplication.sendEvent(
            page.cards["bumpy"], QKeyEvent(QEvent.Type.KeyRelease, Qt.Key.Key_Space, Qt.KeyboardModifier.NoModifier)
        )
    link = next(button for button in page.findChildren(QPushButton) if button.text() == "a.ply")
    with qtbot.waitSignal(page.recentChosen, check_params_cb=lambda path: path == str(tmp_path / "a.ply")):
        link.click()


def test_a_thumbnail_shows_the_lit_side_of_the_nearest_surface(sphere: TriangleMesh) -> None:
    picture = thumbnail(sphere, 240, 160, (1.0, 0.5, 0.0))
    assert picture.shape == (160, 240, 4)
    middle, corner = picture[80, 120], picture[1, 1]
    assert middle[3] == 255
    assert corner[3] == 0
    assert middle[0] > 120
    assert abs(int(middle[0]) - 2 * int(middle[1])) <= 2
    covered = (picture[..., 3] > 128).sum()
    assert covered == pytest.approx(np.pi * (160 / 1.08 / 2) ** 2, rel=0.03)
    top, bottom = picture[20, 120, 0], picture[140, 120, 0]
    assert top > bottom
