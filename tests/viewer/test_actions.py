"""Actions, menus, keys, icons and themes."""

from __future__ import annotations

import pytest
from qtpy.QtGui import QAction
from qtpy.QtWidgets import QApplication, QMainWindow

from dmp_viewer import actions, icons
from dmp_viewer.theme import DARK, LIGHT, palette


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


def test_both_palettes_fade_what_is_disabled(qapp: QApplication) -> None:
    for theme in (LIGHT, DARK):
        colors = palette(theme)
        assert colors.color(colors.ColorGroup.Disabled, colors.ColorRole.ButtonText).name() == theme.faded
        assert colors.color(colors.ColorGroup.Active, colors.ColorRole.Window).name() == theme.window
