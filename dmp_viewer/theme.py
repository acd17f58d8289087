"""Light and dark: one set of colours for widgets, the 3-D view and the plot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from qtpy.QtCore import Qt
from qtpy.QtGui import QColor, QPalette
from qtpy.QtWidgets import QApplication


@dataclass(frozen=True)
class Theme:
    """Colours as ``#rrggbb``.

    Attributes:
        is_dark: which of the two it is.
        window, base, raised, text, subtle, line, accent, on_accent: surfaces, writing and lines of the widgets.
        view_top, view_bottom: gradient behind the meshes.
        mesh, mesh_edges: a mesh without values, and its edges.
        info, warning, error, success: backgrounds of messages.
        kept, suggested, best: markers on curve and timeline.
        hole, pointed, halo: outline of holes and seams, of the hole that is looked at, and what surrounds both.
        curves: colours of the measures by name; each is told apart by its line style too.
    """

    is_dark: bool
    window: str
    base: str
    raised: str
    text: str
    subtle: str
    line: str
    accent: str
    on_accent: str
    view_top: str
    view_bottom: str
    mesh: str
    mesh_edges: str
    info: str
    warning: str
    error: str
    success: str
    kept: str
    suggested: str
    best: str
    hole: str
    pointed: str
    halo: str
    curves: dict[str, str]

    @property
    def faded(self) -> str:
        """Writing and icons of what cannot be used now."""
        return _mixed(self.text, self.window, 0.5).name()


LIGHT = Theme(
    is_dark=False, window="#f3f4f6", base="#ffffff", raised="#fafbfc", text="#1b1f24", subtle="#5c6670", line="#cfd5db",
    accent="#1f66c1", on_accent="#ffffff", view_top="#ffffff", view_bottom="#e3e8ee", mesh="#c9ced6", mesh_edges="#30363d",
    info="#e3effc", warning="#fdf1d6", error="#fbe3e1", success="#e0f3e4", kept="#1a7f37", suggested="#8250df",
    best="#00796b", hole="#e6007e", pointed="#ffc400", halo="#ffffff",
    curves={
        "data_loss": "#1f66c1", "laplacian_loss": "#b35900", "position_loss": "#1f66c1",
        "normal_loss": "#b35900",
        "inserted_movement": "#6f42c1", "made_up_error": "#c2255c",
        "hole_distance": "#5c940d", "hole_normal_error": "#00796b",
        "total_loss": "#57606a", "held_out_error": "#c2255c", "held_out_risk": "#c2255c",
        "held_out_excess": "#e0569b", "held_out_lowest_step": "#868e96",
        "held_out_normal_error": "#e0569b", "displacement": "#6f42c1", "input_distance": "#0b7285", "vertex_error": "#5c940d",
        "mad": "#00796b",
    },
)  # fmt: skip

DARK = Theme(
    is_dark=True, window="#1f2329", base="#16191e", raised="#262b32", text="#e6e9ed", subtle="#9aa5b1", line="#3a414a",
    accent="#5aa2f5", on_accent="#0c1420", view_top="#2b313a", view_bottom="#14171b", mesh="#aeb6c1", mesh_edges="#0e1116",
    info="#1d3350", warning="#4a3a12", error="#54221f", success="#1c3f28", kept="#56d364", suggested="#bc8cff",
    best="#2dd4bf", hole="#ff4fb0", pointed="#ffd84d", halo="#0b0d10",
    curves={
        "data_loss": "#6cb0ff", "laplacian_loss": "#f0a35e", "position_loss": "#6cb0ff",
        "normal_loss": "#f0a35e",
        "inserted_movement": "#b79cff", "made_up_error": "#ff7aa8",
        "hole_distance": "#a9d86e", "hole_normal_error": "#2dd4bf",
        "total_loss": "#a8b1bb", "held_out_error": "#ff7aa8", "held_out_risk": "#ff7aa8",
        "held_out_excess": "#e29bd0", "held_out_lowest_step": "#a8b1bb",
        "held_out_normal_error": "#e29bd0", "displacement": "#b79cff", "input_distance": "#5fd0e6", "vertex_error": "#a9d86e",
        "mad": "#2dd4bf",
    },
)  # fmt: skip


def wanted(choice: str, application: QApplication) -> Theme:
    """Return the theme for ``auto``, ``light`` or ``dark``; ``auto`` asks the system and takes light when it does not know."""
    if choice == "auto":
        return DARK if application.styleHints().colorScheme() == Qt.ColorScheme.Dark else LIGHT
    return DARK if choice == "dark" else LIGHT


def apply(choice: str, application: QApplication) -> Theme:
    """Give the whole application a theme and return it."""
    hints = application.styleHints()
    scheme = {"light": Qt.ColorScheme.Light, "dark": Qt.ColorScheme.Dark}.get(choice, Qt.ColorScheme.Unknown)
    if hasattr(hints, "setColorScheme"):  # Qt 6.8; it also colours the frames that the system draws
        hints.setColorScheme(scheme)
    theme = wanted(choice, application)
    application.setPalette(palette(theme))
    application.setPalette(box_palette(theme), "QCheckBox")
    return theme


def box_palette(theme: Theme) -> QPalette:
    """Return the palette of check boxes: the style outlines them darker than the window, which nobody sees on a dark one."""
    result = palette(theme)
    if theme.is_dark:
        result.setColor(QPalette.ColorRole.Base, _mixed(theme.window, theme.text, 0.28))
    return result


def palette(theme: Theme) -> QPalette:
    """Return the Qt palette of a theme, disabled colours included."""
    role, group = QPalette.ColorRole, QPalette.ColorGroup
    result = QPalette()
    for name, color in (
        (role.Window, theme.window), (role.WindowText, theme.text), (role.Base, theme.base), (role.AlternateBase, theme.raised),
        (role.Text, theme.text), (role.Button, theme.raised), (role.ButtonText, theme.text), (role.BrightText, theme.on_accent),
        (role.Highlight, theme.accent), (role.HighlightedText, theme.on_accent), (role.Link, theme.accent),
        (role.LinkVisited, theme.accent), (role.ToolTipBase, theme.raised), (role.ToolTipText, theme.text),
        (role.PlaceholderText, theme.subtle), (role.Accent, theme.accent),
    ):  # fmt: skip
        result.setColor(name, QColor(color))
    window = QColor(theme.window)
    for name, factor in ((role.Light, 130), (role.Midlight, 115), (role.Mid, 85), (role.Dark, 70), (role.Shadow, 45)):
        shade = window.lighter(factor) if factor > 100 else window.darker(round(10_000 / factor))
        result.setColor(name, shade)
    faded = QColor(theme.faded)
    for name in (role.WindowText, role.Text, role.ButtonText):
        result.setColor(group.Disabled, name, faded)
    result.setColor(group.Disabled, role.Highlight, QColor(theme.line))
    result.setColor(group.Disabled, role.HighlightedText, faded)
    return result


def _mixed(first: str, second: str, share: float) -> QColor:
    """Return a colour between two, ``share`` of the way to the second."""
    a, b = QColor(first), QColor(second)
    return QColor.fromRgbF(
        a.redF() + (b.redF() - a.redF()) * share,
        a.greenF() + (b.greenF() - a.greenF()) * share,
        a.blueF() + (b.blueF() - a.blueF()) * share,
    )


def rgb(color: str) -> tuple[float, float, float]:
    """Return a colour as VTK wants it, three numbers from 0 to 1."""
    parsed = QColor(color)
    return (parsed.redF(), parsed.greenF(), parsed.blueF())


def application() -> QApplication:
    """Return the running application."""
    return cast(QApplication, QApplication.instance())
