"""One table of everything that can be done, with its key: it feeds the menus, the tool bar and the list of keys."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from qtpy.QtGui import QAction, QActionGroup, QKeySequence
from qtpy.QtWidgets import QMenu, QMenuBar, QWidget


@dataclass(frozen=True)
class ActionSpec:
    """One thing that can be done.

    Attributes:
        name: how the code calls it.
        menu: the menu it stands in.
        text: what the menu says; ``&`` marks the access key.
        key: shortcut, as Qt writes it, or empty.
        tip: one sentence for the status bar and the tool tip.
        icon: name of the icon, or empty.
        group: actions of one group exclude each other.
        checkable: whether it can be on or off.
        separated: whether a line stands above it.
        submenu: a menu inside the menu to stand in, or empty.
    """

    name: str
    menu: str
    text: str
    key: str = ""
    tip: str = ""
    icon: str = ""
    group: str = ""
    checkable: bool = False
    separated: bool = False
    submenu: str = ""


MENUS = {"file": "&File", "view": "&View", "run": "&Run", "step": "&Step", "help": "&Help"}

ACTIONS: tuple[ActionSpec, ...] = (
    ActionSpec("open", "file", "&Open mesh…", "Ctrl+O", "Open a mesh to restore.", "open"),
    ActionSpec("open_ground_truth", "file", "Open &ground truth…", "Ctrl+G",
               "Open the clean version of this mesh, to measure against."),
    ActionSpec("open_run", "file", "Open &run…", "Ctrl+Shift+O", "Open the folder of an earlier training."),
    ActionSpec("save", "file", "&Save mesh…", "Ctrl+S",
               "Save the kept step as a mesh; without one, the shown step.", "save", separated=True),
    ActionSpec("save_shown", "file", "Save s&hown step…", "Ctrl+Shift+S", "Save the step that is shown now as a mesh."),
    ActionSpec("screenshot", "file", "Save &picture…", "F12", "Save a picture of the whole window.", "camera"),
    ActionSpec("quit", "file", "&Quit", "Ctrl+Q",
               "Close the window. A training is ended cleanly and can be continued later.", separated=True),
    ActionSpec("magnitude", "view", "Colour by &displacement", "Ctrl+1",
               "Colour by the length of the displacement from the smoothed mesh.", group="quantity", checkable=True),
    ActionSpec("signed", "view", "Colour by &signed displacement", "Ctrl+2",
               "Colour by the displacement along the normal of the smoothed mesh: inwards blue, outwards red.",
               group="quantity", checkable=True),
    ActionSpec("plain", "view", "&Plain shading", "Ctrl+3", "Show the bare surface.", group="quantity", checkable=True),
    ActionSpec("edges", "view", "Show &edges", "E",
               "Draw the edges of the triangles.", "edges", checkable=True, separated=True),
    ActionSpec("filling_only", "view", "&Hole filling only", "H",
               "Show hole filling alone in place of the completion, to compare both.", "filling", checkable=True),
    ActionSpec("link", "view", "&Link cameras", "L", "Turn all three panes together.", "link", checkable=True),
    ActionSpec("z_up", "view", "&Z axis up", "Z", "Let the Z axis point up instead of the Y axis.", checkable=True),
    ActionSpec("reset_view", "view", "&Fit view", "R", "Show the whole mesh in all panes.", "fit"),
    ActionSpec("show_panel", "view", "Run pa&nel", "F9", "Show or hide the run panel.", checkable=True, separated=True),
    ActionSpec("show_curve", "view", "&Curve", "F10", "Show or hide the training curve.", checkable=True),
    ActionSpec("theme_auto", "view", "As the &system", "",
               "Light or dark as the system wants it.", group="theme", checkable=True, submenu="&Theme"),
    ActionSpec("theme_light", "view", "&Light", "", "Light colours.", group="theme", checkable=True, submenu="&Theme"),
    ActionSpec("theme_dark", "view", "&Dark", "", "Dark colours.", group="theme", checkable=True, submenu="&Theme"),
    ActionSpec("start", "run", "&Start", "F5", "Train on the open mesh from the beginning.", "play"),
    ActionSpec("proceed", "run", "&Continue", "Shift+F5", "Go on with the stopped run from its last step.", "play"),
    ActionSpec("pause", "run", "&Pause", "F6", "Hold the training; Resume goes on.", "pause"),
    ActionSpec("resume", "run", "&Resume", "F7", "Go on after a pause.", "play"),
    ActionSpec("stop", "run", "S&top", "F8", "End the training. What it has learnt stays, and it can be continued.", "stop"),
    ActionSpec("first_step", "step", "&First", "Home", "Show the first snapshot.", "first"),
    ActionSpec("previous_step", "step", "&Previous", "Left", "Show the snapshot before.", "previous"),
    ActionSpec("next_step", "step", "&Next", "Right", "Show the next snapshot.", "next"),
    ActionSpec("last_step", "step", "&Last", "End", "Show the newest snapshot.", "last"),
    ActionSpec("play", "step", "Pl&ay", "Space", "Play the snapshots one after the other.", "play", checkable=True),
    ActionSpec("follow", "step", "Foll&ow latest", "F",
               "Always show the newest snapshot.", "follow", checkable=True, separated=True),
    ActionSpec("keep", "step", "&Keep this step", "K", "Choose the shown step as the result. Training can go on.", "keep"),
    ActionSpec("forget_kept", "step", "For&get the kept step", "", "Have no kept step any more."),
    ActionSpec("show_suggested", "step", "Show the s&uggested step", "S", "Show the step where overfitting seems to begin."),
    ActionSpec("keys", "help", "&Keys", "F1", "List all keys."),
    ActionSpec("log_file", "help", "Copy &path of the log file", "",
               "Put the path of the log file on the clipboard, for a bug report."),
    ActionSpec("about", "help", "&About", "", "Versions and licence.", separated=True),
)  # fmt: skip


def build(parent: QWidget, handlers: dict[str, Callable[[], None]]) -> dict[str, QAction]:
    """Make all actions; those without a handler are not made, so that no dead control appears.

    Args:
        parent: the window in which the keys work.
        handlers: what each action does, by name.
    """
    actions: dict[str, QAction] = {}
    groups: dict[str, QActionGroup] = {}
    for spec in ACTIONS:
        if spec.name not in handlers:
            continue
        action = QAction(spec.text, parent)
        action.setObjectName(spec.name)
        action.setCheckable(spec.checkable)
        # In a menu the picture would take the place of the check mark.
        action.setIconVisibleInMenu(not spec.checkable)
        if spec.key:
            action.setShortcut(QKeySequence(spec.key))
        plain = spec.text.replace("&", "").rstrip("…")
        action.setToolTip(f"{spec.tip or plain}{f'  ({key_text(spec.key)})' if spec.key else ''}")
        action.setStatusTip(spec.tip)
        action.triggered.connect(lambda _checked=False, handler=handlers[spec.name]: handler())
        if spec.group:
            if spec.group not in groups:
                groups[spec.group] = QActionGroup(parent)
            groups[spec.group].addAction(action)
        actions[spec.name] = action
        parent.addAction(action)
    return actions


def fill_menu_bar(bar: QMenuBar, actions: dict[str, QAction]) -> dict[str, QMenu]:
    """Put the actions into menus as the table says; returns the menus by name, submenus as ``menu/text``."""
    menus = {name: bar.addMenu(title) for name, title in MENUS.items()}
    for spec in ACTIONS:
        if spec.name not in actions:
            continue
        menu = menus[spec.menu]
        if spec.separated:
            menu.addSeparator()
        if spec.submenu:
            name = f"{spec.menu}/{spec.submenu}"
            if name not in menus:
                menu.addSeparator()
                menus[name] = menu.addMenu(spec.submenu)
            menu = menus[name]
        menu.addAction(actions[spec.name])
    for menu in menus.values():
        menu.setToolTipsVisible(False)
    return menus


def key_text(key: str) -> str:
    """Return a key as this system writes it."""
    return QKeySequence(key).toString(QKeySequence.SequenceFormat.NativeText)


def keys_table() -> list[tuple[str, str, str]]:
    """Return (menu, what, key) for everything that has a key, in the order of the menus."""
    return [
        (MENUS[spec.menu].replace("&", ""), spec.text.replace("&", "").rstrip("…"), key_text(spec.key))
        for spec in ACTIONS
        if spec.key
    ]
