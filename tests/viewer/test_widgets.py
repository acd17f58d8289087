"""Single widgets: panel, banner, timeline, curve, colour bar, start page, actions, icons."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, QPoint, Qt
from qtpy.QtGui import QAction, QImage, QKeyEvent
from qtpy.QtWidgets import QApplication, QComboBox, QMainWindow, QPushButton, QSpinBox, QToolButton, QWidget

from dmp.mesh import TriangleMesh
from dmp.settings import SETTING_FIELDS, Settings, choices, settings_for
from dmp_viewer import actions, icons
from dmp_viewer.colors import Limits, color_table
from dmp_viewer.curve import Curve
from dmp_viewer.states import Controls, RunnerState
from dmp_viewer.theme import DARK, LIGHT, palette
from dmp_viewer.thumbnails import thumbnail
from dmp_viewer.views.banner import BannerArea, Message
from dmp_viewer.views.color_bar import ColorBar
from dmp_viewer.views.curve_panel import CurvePanel
from dmp_viewer.views.run_panel import RunPanel, Status, duration
from dmp_viewer.views.setting_editors import NumberEditor, label, matters_to
from dmp_viewer.views.start_page import StartPage
from dmp_viewer.views.timeline import Timeline


@pytest.fixture
def window(qtbot: QtBot) -> QMainWindow:
    window = QMainWindow()
    qtbot.addWidget(window)
    return window


@pytest.fixture
def named_actions(window: QMainWindow) -> dict[str, QAction]:
    return actions.build(window, {spec.name: (lambda: None) for spec in actions.ACTIONS})


@pytest.fixture
def panel(window: QMainWindow, named_actions: dict[str, QAction]) -> RunPanel:
    panel = RunPanel(named_actions)
    window.setCentralWidget(panel)
    window.resize(320, 700)
    window.show()
    return panel


# -- actions ----------------------------------------------------------------------------------------------------------


def test_no_key_does_two_things() -> None:
    keys = [spec.key for spec in actions.ACTIONS if spec.key]
    assert len(keys) == len(set(keys))


def test_every_action_is_in_a_menu_and_explained(window: QMainWindow, named_actions: dict[str, QAction]) -> None:
    menus = actions.fill_menu_bar(window.menuBar(), named_actions)
    listed = {action.objectName() for menu in menus.values() for action in menu.actions()}
    assert {spec.name for spec in actions.ACTIONS} <= listed
    assert all(spec.tip for spec in actions.ACTIONS)


def test_no_menu_has_an_access_key_twice() -> None:
    for menu in actions.MENUS:
        letters = [
            spec.text[spec.text.index("&") + 1].lower() for spec in actions.ACTIONS if spec.menu == menu and not spec.submenu
        ]
        assert len(letters) == len(set(letters)), (menu, letters)


def test_actions_without_a_handler_do_not_appear(window: QMainWindow) -> None:
    assert set(actions.build(window, {"open": lambda: None})) == {"open"}


def test_every_icon_is_drawn_in_the_colour_of_the_theme(qapp: QApplication) -> None:
    for name in icons.names():
        image = icons.pixmap(name, "#ff0000", 24).toImage()
        drawn = [image.pixelColor(x, y) for x in range(24) for y in range(24) if image.pixelColor(x, y).alpha() > 128]
        assert drawn, name
        assert all(color.red() > 200 and color.green() < 60 for color in drawn), name


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_text_can_be_read_in_both_themes(theme: type[LIGHT]) -> None:
    def luminance(color: str) -> float:
        parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    def contrast(first: str, second: str) -> float:
        light, dark = sorted((luminance(first), luminance(second)), reverse=True)
        return (light + 0.05) / (dark + 0.05)

    grounds = (theme.window, theme.base, theme.raised)
    for ground in (*grounds, theme.info, theme.warning, theme.error, theme.success):
        assert contrast(theme.text, ground) >= 7
    for ground in grounds:
        assert contrast(theme.subtle, ground) >= 4.5
    for color in (theme.kept, theme.suggested, theme.best, *theme.curves.values()):
        assert contrast(color, theme.base) >= 3
    assert contrast(theme.accent, theme.on_accent) >= 4.5


# -- run panel --------------------------------------------------------------------------------------------------------


def test_the_panel_returns_what_it_shows(panel: RunPanel) -> None:
    wanted = settings_for(
        preset="paper", steps=123, snapshot_every=7, seed=2**62, learning_rate=3e-4, hold_out=0.125, laplacian_form="sum"
    )
    panel.set_settings(wanted)
    assert panel.settings() == wanted
    assert panel.problem == ""


def test_every_setting_can_be_reached_or_leaves_no_choice(panel: RunPanel) -> None:
    for name in SETTING_FIELDS:
        if name == "task" or len(choices(name)) == 1:
            continue
        assert panel.editor(name).toolTip()
        assert label(name)[0].isupper()


def test_a_preset_brings_all_its_values_but_not_another_seed_or_device(panel: RunPanel, qtbot: QtBot) -> None:
    panel.set_settings(replace(settings_for(), seed=7, device="cpu", steps=17))
    preset = panel.editor("preset")
    assert isinstance(preset, QComboBox)
    preset.setCurrentIndex(preset.findData("paper"))
    with qtbot.waitSignal(panel.settingsEdited):
        preset.activated.emit(preset.currentIndex())
    assert panel.settings() == settings_for(preset="paper", seed=7, device="cpu")


def test_a_number_out_of_its_range_is_told_in_the_panels_words(panel: RunPanel, qtbot: QtBot) -> None:
    editor = panel.editor("learning_rate")
    assert isinstance(editor, NumberEditor)
    editor.clear()
    qtbot.keyClicks(editor, "500")
    assert panel.problem == "Learning rate is 500, but must be between 1e-08 and 10."
    editor.clear()
    qtbot.keyClicks(editor, "1e-3")
    assert panel.problem == ""
    assert panel.settings().learning_rate == 0.001


def test_changed_values_are_marked_and_can_be_taken_back(panel: RunPanel, qtbot: QtBot) -> None:
    reset = next(button for button in panel.findChildren(QPushButton) if button.text().startswith("Back to"))
    assert not reset.isVisible()
    steps = panel.editor("steps")
    assert isinstance(steps, QSpinBox)
    steps.setValue(77)
    assert reset.isVisible()
    assert "Steps" in reset.toolTip()
    qtbot.mouseClick(reset, Qt.MouseButton.LeftButton)
    assert panel.settings() == settings_for()
    assert not reset.isVisible()


def test_advanced_settings_are_folded_and_belong_to_the_method(panel: RunPanel, qtbot: QtBot) -> None:
    heading = next(button for button in panel.findChildren(QToolButton) if button.text() == "Advanced")
    weight = panel.editor("laplacian_weight")
    assert not weight.isVisible()
    qtbot.mouseClick(heading, Qt.MouseButton.LeftButton)
    assert weight.isVisible()
    for method in choices("method"):
        panel.set_settings(replace(Settings(), method=method))  # type: ignore[arg-type]
        for name, item in SETTING_FIELDS.items():
            if item.metadata["advanced"] and len(choices(name)) != 1:
                assert panel.editor(name).isVisible() == matters_to(name, "denoise", method), (method, name)


def test_nothing_in_the_panel_is_cut(panel: RunPanel, qtbot: QtBot) -> None:
    qtbot.waitExposed(panel)
    for editor in (panel.editor(name) for name in ("preset", "steps", "snapshot_every", "seed", "device")):
        right = editor.mapTo(panel, QPoint(editor.width(), 0)).x()
        assert right <= panel.width()


@pytest.mark.parametrize(
    ("state", "controls", "visible"),
    [
        (RunnerState.IDLE, Controls(start=True), {"start", "pause", "stop"}),
        (RunnerState.RUNNING, Controls(pause=True, stop=True), {"start", "pause", "stop"}),
        (RunnerState.PAUSED, Controls(resume=True, stop=True), {"start", "resume", "stop"}),
        (RunnerState.FINISHED, Controls(start=True, proceed=True), {"start", "proceed"}),
    ],
)
def test_the_buttons_in_sight(panel: RunPanel, state: RunnerState, controls: Controls, visible: set[str]) -> None:
    panel.set_controls(controls, state)
    assert {name for name in ("start", "pause", "resume", "proceed", "stop") if panel.button(name).isVisible()} == visible
    assert panel.editor("steps").isEnabled() is not state.is_active


@pytest.mark.parametrize(
    ("status", "told"),
    [
        (Status(), "Ready"),
        (Status(RunnerState.PREPARING), "Preparing…"),
        (Status(RunnerState.RUNNING, 30, 100, 5.0, 6.0, "CPU"), "Training"),
        (Status(RunnerState.STOPPING, 30, 100), "Stopping…"),
        (Status(RunnerState.FINISHED, 30, 100, run_state="stopped"), "Stopped"),
        (Status(RunnerState.IDLE, 30, 100, run_state="interrupted"), "Interrupted"),
    ],
)
def test_the_state_is_told(panel: RunPanel, status: Status, told: str) -> None:
    panel.set_status(status)
    assert panel.state_text == told


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.2, "under 1 s"), (7.6, "8 s"), (125, "2 min 05 s"), (3600, "1 h 00 min"), (9000, "2 h 30 min")]
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


# -- banner -----------------------------------------------------------------------------------------------------------


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


# -- timeline ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def timeline(qtbot: QtBot, window: QMainWindow, named_actions: dict[str, QAction]) -> Timeline:
    timeline = Timeline(named_actions)
    window.setCentralWidget(timeline)
    window.resize(900, 80)
    window.show()
    qtbot.waitExposed(window)
    return timeline


def test_moving_the_handle_names_steps_and_showing_a_step_is_silent(timeline: Timeline) -> None:
    chosen: list[int] = []
    timeline.stepChosen.connect(chosen.append)
    timeline.set_steps([0, 25, 50, 60])
    timeline.set_shown_step(25, 60)
    assert timeline.label == "Step 25 of 60"
    assert chosen == []
    timeline.go(1)
    timeline.go(-1)
    timeline.go_to_end(last=True)
    timeline.go_to_end(last=False)
    assert chosen == [50, 25, 60, 0]


def test_playing_starts_over_at_the_end_and_stops_there(timeline: Timeline, qtbot: QtBot) -> None:
    chosen: list[int] = []
    timeline.stepChosen.connect(chosen.append)
    timeline.set_steps([0, 5, 10])
    timeline.set_shown_step(10, 10)
    with qtbot.waitSignals(
        [timeline.playToggled, timeline.playToggled], timeout=5000, check_params_cbs=[bool, lambda on: not on]
    ):
        timeline.set_playing(True)
    assert chosen == [0, 5, 10]
    assert not timeline.is_playing


def test_there_is_nothing_to_play_with_one_snapshot(timeline: Timeline, qtbot: QtBot) -> None:
    timeline.set_steps([0])
    with qtbot.waitSignal(timeline.playToggled, check_params_cb=lambda on: not on):
        timeline.set_playing(True)
    assert not timeline.is_playing


def test_marks_are_drawn(timeline: Timeline) -> None:
    timeline.set_steps([0, 5, 10])
    before = timeline.slider.grab().toImage()
    timeline.set_markers(5, None, 10)
    assert timeline.slider.grab().toImage() != before


def test_picture_buttons_have_names_and_keys_in_their_tips(timeline: Timeline) -> None:
    for button in timeline.findChildren(QToolButton):
        assert button.accessibleName()
        assert "(" in button.toolTip()


# -- curve ------------------------------------------------------------------------------------------------------------

ROWS = [
    {
        "step": step,
        "seconds": 1.0,
        "data_loss": 2.0 / (step + 1),
        "held_out_error": 0.5,
        "displacement": 0.1,
        "mad": 30.0 - step,
    }
    for step in range(0, 21, 5)
]


@pytest.fixture
def curve(qtbot: QtBot) -> CurvePanel:
    panel = CurvePanel()
    qtbot.addWidget(panel)
    panel.resize(900, 260)
    panel.set_theme(LIGHT)
    panel.show()
    qtbot.waitExposed(panel)
    return panel


def test_the_empty_curve_explains_itself(curve: CurvePanel) -> None:
    curve.set_curve(Curve(), None)
    texts = [label.text() for label in curve.findChildren(QWidget) if label.isVisible() and hasattr(label, "text")]
    assert any("held-out error" in str(text).lower() for text in texts)


def test_the_legend_tells_the_values_of_the_shown_step(curve: CurvePanel) -> None:
    curve.set_curve(Curve(ROWS), settings_for())
    curve.set_shown_step(5)
    assert curve.legend.heading == "Shown: step 5"
    assert curve.legend.value_shown("data_loss") == "0.3333"
    assert curve.legend.value_shown("mad") == "25.00°"


def test_the_legend_switches_lines(curve: CurvePanel, qtbot: QtBot) -> None:
    curve.set_curve(Curve(ROWS), settings_for())
    assert curve.drawn_names() == ["data_loss", "held_out_error", "mad"]
    curve.legend.button("displacement").click()
    curve.legend.button("mad").click()
    assert curve.drawn_names() == ["data_loss", "held_out_error", "displacement"]


def _pixels(widget: QWidget) -> np.ndarray:
    image = widget.grab().toImage().convertToFormat(QImage.Format.Format_RGB888)
    return np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine()).copy()


def test_every_choice_changes_the_picture(curve: CurvePanel, qtbot: QtBot) -> None:
    curve.set_curve(Curve(ROWS), settings_for())
    pictures = [_pixels(curve)]
    for change in (
        lambda: curve.set_log_axis(False),
        lambda: curve.set_smoothing(0.9),
        lambda: curve.set_shown_step(15),
        lambda: curve.set_markers(5, 10, "Because.", 20),
        lambda: curve.set_theme(DARK),
        lambda: curve.set_curve(Curve(ROWS[:3]), settings_for()),
    ):
        change()
        qtbot.wait(20)
        pictures.append(_pixels(curve))
    for before, after in pairwise(pictures):
        assert not np.array_equal(before, after)
    assert curve.advice == "Because."


def test_a_click_on_the_curve_names_the_step_under_it(curve: CurvePanel, qtbot: QtBot) -> None:
    curve.set_curve(Curve(ROWS), settings_for())
    qtbot.wait(50)
    view = curve._plot
    box = view.getViewBox()
    for step in (0.0, 7.0, 20.0):
        scene = box.mapViewToScene(box.viewRange() and _point(step, sum(box.viewRange()[1]) / 2))
        place = view.mapFromScene(scene)
        with qtbot.waitSignal(curve.stepClicked) as clicked:
            qtbot.mouseClick(view.viewport(), Qt.MouseButton.LeftButton, pos=place)
        assert clicked.args[0] == pytest.approx(step, abs=0.2)


def _point(x: float, y: float) -> object:
    from qtpy.QtCore import QPointF

    return QPointF(x, y)


def test_the_crosshair_snaps_to_logged_steps_and_goes_with_the_mouse(curve: CurvePanel, qtbot: QtBot) -> None:
    curve.set_curve(Curve(ROWS), settings_for())
    curve.set_shown_step(0)
    qtbot.wait(50)
    box = curve._plot.getViewBox()
    curve._plot.scene().sigMouseMoved.emit(box.mapViewToScene(_point(11.0, sum(box.viewRange()[1]) / 2)))
    assert curve.legend.heading == "Step 10"
    QApplication.sendEvent(curve._plot.viewport(), QEvent(QEvent.Type.Leave))
    assert curve.legend.heading == "Shown: step 0"


def test_values_below_zero_make_the_axis_linear(curve: CurvePanel) -> None:
    curve.set_curve(Curve([{**row, "data_loss": -1.0} for row in ROWS]), settings_for())
    assert not curve._log_box.isEnabled()
    assert "not above zero" in curve._log_box.toolTip()
    curve.legend.button("data_loss").click()
    assert curve._log_box.isEnabled()


# -- colour bar and start page ----------------------------------------------------------------------------------------


def test_the_colour_bar_tells_its_range_and_unit(qtbot: QtBot) -> None:
    bar = ColorBar()
    qtbot.addWidget(bar)
    bar.gradient.set_scale(color_table("magnitude"), Limits(0, 0.5), 4.0, "edge lengths")
    assert bar.gradient.shown_limits == (0, 2)
    assert bar.gradient.accessibleName() == "Colour bar from 0 to 2 edge lengths"


def test_the_colour_bar_says_what_was_chosen(qtbot: QtBot) -> None:
    bar = ColorBar()
    qtbot.addWidget(bar)
    bar.set_policy("signed", "run", "file")
    boxes = bar.findChildren(QComboBox)
    assert {box.currentData() for box in boxes} == {"signed", "run", "file"}
    with qtbot.waitSignal(bar.quantityChosen, check_params_cb=lambda value: value == "plain"):
        boxes[0].setCurrentIndex(boxes[0].findData("plain"))
        boxes[0].activated.emit(0)


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


def test_both_palettes_fade_what_is_disabled(qapp: QApplication) -> None:
    for theme in (LIGHT, DARK):
        colors = palette(theme)
        assert colors.color(colors.ColorGroup.Disabled, colors.ColorRole.ButtonText).name() == theme.faded
        assert colors.color(colors.ColorGroup.Active, colors.ColorRole.Window).name() == theme.window
