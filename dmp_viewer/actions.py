"""One table of everything that can be done, with its key: it feeds the menus, the tool bar and the list of keys."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from qtpy.QtGui import QAction, QActionGroup, QKeySequence
from qtpy.QtWidgets import QMenu, QMenuBar, QWidget

from dmp_viewer.colors import QUANTITIES


@dataclass(frozen=True)
class ActionSpec:
    """One thing that can be done.

    Attributes:
        name: how the code calls it.
        menu: the menu it stands in.
        text: what the menu says; ``&`` marks the access key.
        key: shortcut, as Qt writes it, or empty; several are parted by ``; ``.
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


MENUS = {"file": "&File", "view": "&View", "compare": "&Compare", "run": "&Run", "step": "&Step", "help": "&Help"}
_COLOR, _RANGE, _MIDDLE, _THEME = "&Colour by", "Colour &range", "&Middle pane", "&Theme"
_LISTED, _QUEUE, _PACE = "Chosen in the &list of runs", "&Queue", "P&ace"
_SIDES = "Look fro&m"

ACTIONS: tuple[ActionSpec, ...] = (
    ActionSpec("open", "file", "&Open mesh…", "Ctrl+O", "Open a mesh to restore.", "open"),
    ActionSpec("open_ground_truth", "file", "Open &ground truth…", "Ctrl+G",
               "Open the clean version of this mesh, to measure against."),
    ActionSpec("open_run", "file", "Open &run…", "Ctrl+Shift+O", "Open the folder of an earlier training."),
    ActionSpec("save", "file", "&Save mesh…", "Ctrl+S",
               "Save the kept step as a mesh; without one, the shown step.", "save", separated=True),
    ActionSpec("save_shown", "file", "Save s&hown step…", "Ctrl+Shift+S", "Save the step that is shown now as a mesh."),
    ActionSpec("export", "file", "&Export…", "Ctrl+E",
               "Export meshes with all that is known, pictures of any size, animations, the curve, or a report.", "export"),
    ActionSpec("screenshot", "file", "Save &picture…", "F12", "Save a picture of the whole window.", "camera"),
    ActionSpec("mesh_report", "file", "Mesh repor&t…", "Ctrl+I",
               "What is odd about the open mesh, what that means for the result, and what can be mended.", separated=True),
    ActionSpec("quit", "file", "&Quit", "Ctrl+Q",
               "Close the window. A training is ended cleanly and can be continued later.", separated=True),
    *(ActionSpec(name, "view", spec.label, f"Ctrl+{key}", spec.help, group="quantity", checkable=True, submenu=_COLOR)
      for key, (name, spec) in enumerate(QUANTITIES.items(), start=1)),
    ActionSpec("range_step", "view", "From the &shown step", "", "Fit the range of the colours to the shown step.",
               group="range", checkable=True, submenu=_RANGE),
    ActionSpec("range_run", "view", "From the &whole run", "",
               "Fit the range of the colours to all snapshots, so that steps can be compared.",
               group="range", checkable=True, submenu=_RANGE),
    ActionSpec("lock_range", "view", "&Locked", "O", "Hold the range of the colours as it is now.",
               group="range", checkable=True, submenu=_RANGE),
    ActionSpec("outliers", "view", "Cover &outliers too", "",
               "Let the range cover every vertex; otherwise a few far ones may lie beyond it.",
               checkable=True, separated=True, submenu=_RANGE),
    ActionSpec("set_range", "view", "&Type the range…", "", "Type both ends of the range, which is locked then.",
               submenu=_RANGE),
    ActionSpec("smooth", "view", "&Smooth shading", "G",
               "Hide the faces; flat shading shows each as it is.", "smooth", checkable=True, separated=True),
    ActionSpec("edges", "view", "Show &edges", "E",
               "Draw the edges of the triangles.", "edges", checkable=True),
    ActionSpec("filling_only", "view", "&Hole filling only", "H",
               "Show hole filling alone in place of the completion, to compare both.", "filling", checkable=True),
    ActionSpec("link", "view", "&Link cameras", "L", "Turn all three panes together.", "link", checkable=True),
    ActionSpec("z_up", "view", "&Z axis up", "Z", "Let the Z axis point up instead of the Y axis.", checkable=True),
    ActionSpec("orthographic", "view", "&Orthographic view", "5",
               "Draw the meshes without perspective: what is equally large looks so, however far away it is.", checkable=True),
    ActionSpec("reset_view", "view", "&Fit view", "R", "Show the whole mesh in all panes.", "fit"),
    ActionSpec("view_front", "view", "&Front", "1", "Look at the meshes straight from the front.", submenu=_SIDES),
    ActionSpec("view_side", "view", "&Right side", "3", "Look at the meshes straight from the right.", submenu=_SIDES),
    ActionSpec("view_top", "view", "&Top", "7", "Look at the meshes straight from above.", submenu=_SIDES),
    ActionSpec("view_oblique", "view", "&Oblique", "9",
               "Look at the meshes from the front, a little from above and from the right, as at first.", submenu=_SIDES),
    ActionSpec("show_runs", "view", "R&uns and queue", "F4", "Show or hide the list of all runs, and what waits to be trained.",
               "runs", checkable=True, separated=True),
    ActionSpec("show_panel", "view", "Run pa&nel", "F9", "Show or hide the run panel.", checkable=True),
    ActionSpec("show_curve", "view", "&Curve", "F10", "Show or hide the training curve.", checkable=True),
    ActionSpec("show_thumbnails", "view", "&Pictures of the steps", "F11",
               "Show or hide the small pictures above the timeline.", checkable=True),
    ActionSpec("reset_layout", "view", "Reset la&yout", "",
               "Put all parts of the window where they were at first.", separated=True),
    ActionSpec("theme_auto", "view", "As the &system", "",
               "Light or dark as the system wants it.", group="theme", checkable=True, separated=True, submenu=_THEME),
    ActionSpec("theme_light", "view", "&Light", "", "Light colours.", group="theme", checkable=True, submenu=_THEME),
    ActionSpec("theme_dark", "view", "&Dark", "", "Dark colours.", group="theme", checkable=True, submenu=_THEME),
    ActionSpec("flip", "compare", "Fl&ip to the input", "A",
               "Show the input in place of the prediction. Press to switch, or hold the key for a short look.",
               "flip", checkable=True),
    ActionSpec("swipe", "compare", "&Swipe", "W",
               "Show the input at the left of a line and the prediction at its right, in one pane.", "swipe", checkable=True),
    ActionSpec("lens", "compare", "&Lens", "Q", "Show the input in a lens over the prediction; it follows the mouse.",
               "lens", checkable=True),
    ActionSpec("against_middle", "compare", "&Against the middle pane", "Shift+A",
               "Flip, swipe and lens show what the middle pane shows, instead of the input.", checkable=True),
    ActionSpec("middle_smoothed", "compare", "&Smoothed", "", "Show the smoothed mesh in the middle pane.",
               group="middle", checkable=True, separated=True, submenu=_MIDDLE),
    ActionSpec("middle_truth", "compare", "&Ground truth", "", "Show the ground truth in the middle pane.",
               group="middle", checkable=True, submenu=_MIDDLE),
    ActionSpec("middle_step", "compare", "&Reference step", "", "Show the reference step in the middle pane.",
               group="middle", checkable=True, submenu=_MIDDLE),
    ActionSpec("middle_run", "compare", "&Compared run", "", "Show the compared run in the middle pane.",
               group="middle", checkable=True, submenu=_MIDDLE),
    ActionSpec("middle_filter", "compare", "&Filter", "", "Show the result of the filter in the middle pane.",
               group="middle", checkable=True, submenu=_MIDDLE),
    ActionSpec("next_middle", "compare", "&Next in the middle pane", "M", "Let the middle pane show the next of what it can."),
    ActionSpec("compare_run", "compare", "Compare with a &run…", "Ctrl+R",
               "Lay another run of this mesh beside the one on show: its steps in the middle pane, its curve over this one.",
               separated=True),
    ActionSpec("forget_other", "compare", "L&et the compared run go", "", "Compare with no other run any more.", "close"),
    ActionSpec("other_previous", "compare", "Pre&vious step of the compared run", "Shift+Left",
               "Show the snapshot before, of the compared run.", "previous"),
    ActionSpec("other_next", "compare", "Ne&xt step of the compared run", "Shift+Right",
               "Show the next snapshot of the compared run.", "next"),
    ActionSpec("compare_filter", "compare", "&Compare with a filter…", "Ctrl+Shift+F",
               "Show in the middle pane what a classical filter makes of the input."),
    ActionSpec("pick_vertex", "compare", "&Pick a vertex…", "P",
               "Show one vertex's values in all panes and over the steps. A click on a mesh picks one, too.", separated=True),
    ActionSpec("forget_vertex", "compare", "&Forget the picked vertex", "Esc", "Pick no vertex any more.", "close"),
    ActionSpec("start", "run", "&Start", "F5", "Train on the open mesh from the beginning.", "play"),
    ActionSpec("proceed", "run", "&Continue", "Shift+F5", "Go on with the stopped run from its last step.", "play"),
    ActionSpec("pause", "run", "&Pause", "F6", "Hold the training; Resume goes on.", "pause"),
    ActionSpec("resume", "run", "&Resume", "F7", "Go on after a pause.", "play"),
    ActionSpec("stop", "run", "S&top", "F8", "End the training. What it has learnt stays, and it can be continued.", "stop"),
    ActionSpec("pace_smooth", "run", "Smooth &window", "",
               "The window goes first: the training rests while you turn, zoom or scrub, and leaves a core to the window.",
               group="pace", checkable=True, separated=True, submenu=_PACE),
    ActionSpec("pace_fast", "run", "&Fast training", "",
               "The training goes first: it never rests, its news are shown once a second, and a new run uses all cores.",
               group="pace", checkable=True, submenu=_PACE),
    ActionSpec("queue_add", "run", "&Add to the queue", "Ctrl+F5",
               "Let a training of the open mesh with the settings of the run panel wait for its turn.",
               "queue", separated=True, submenu=_QUEUE),
    ActionSpec("queue_go", "run", "&Start the queue", "Ctrl+Shift+F5",
               "Train what waits, one after another; or hold the queue after the present training.", "play", submenu=_QUEUE),
    ActionSpec("queue_up", "run", "Train &earlier", "", "Move what is chosen in the queue one place up.", "up", submenu=_QUEUE),
    ActionSpec("queue_down", "run", "Train &later", "", "Move what is chosen in the queue one place down.", "down",
               submenu=_QUEUE),
    ActionSpec("queue_remove", "run", "&Take out of the queue", "", "Let what is chosen in the queue wait no longer.", "close",
               submenu=_QUEUE),
    ActionSpec("listed_open", "run", "&Open", "", "Show the run that is chosen in the list.", "open", submenu=_LISTED),
    ActionSpec("listed_proceed", "run", "&Continue", "", "Open the chosen run and go on with its training.", "play",
               submenu=_LISTED),
    ActionSpec("listed_compare", "run", "Com&pare with the run on show", "",
               "Lay the chosen run of the same mesh beside the one on show.", submenu=_LISTED),
    ActionSpec("listed_settings", "run", "Use its &settings", "", "Copy the settings of the chosen run into the run panel.",
               separated=True, submenu=_LISTED),
    ActionSpec("listed_queue", "run", "Put into the &queue", "", "Let the chosen runs be continued one after another.", "queue",
               submenu=_LISTED),
    ActionSpec("listed_queue_settings", "run", "Queue its settings for the open &mesh", "",
               "Let a training of the open mesh wait for each chosen run, with that run's settings.", submenu=_LISTED),
    ActionSpec("listed_rename", "run", "&Rename…", "", "Give the chosen run another name.", separated=True, submenu=_LISTED),
    ActionSpec("listed_reveal", "run", "Show its &folder", "", "Open the folder of the chosen run.", submenu=_LISTED),
    ActionSpec("listed_trash", "run", "Move to the &trash", "", "Move the chosen runs to the trash of the system.", "trash",
               submenu=_LISTED),
    ActionSpec("first_step", "step", "&First", "Home", "Show the first snapshot.", "first"),
    ActionSpec("previous_step", "step", "&Previous", "Left", "Show the snapshot before.", "previous"),
    ActionSpec("next_step", "step", "&Next", "Right", "Show the next snapshot.", "next"),
    ActionSpec("last_step", "step", "&Last", "End", "Show the newest snapshot.", "last"),
    ActionSpec("play", "step", "Pla&y", "Space", "Play the snapshots one after the other.", "play", checkable=True),
    ActionSpec("faster", "step", "Play f&aster", "Ctrl+Up", "Play more snapshots a second."),
    ActionSpec("slower", "step", "Play slo&wer", "Ctrl+Down", "Play fewer snapshots a second."),
    ActionSpec("follow", "step", "Foll&ow latest", "F",
               "Always show the newest snapshot.", "follow", checkable=True, separated=True),
    ActionSpec("keep", "step", "&Keep this step", "K", "Choose the shown step as the result. Training can go on.", "keep"),
    ActionSpec("forget_kept", "step", "For&get the kept step", "", "Have no kept step any more."),
    ActionSpec("bookmark", "step", "&Bookmark", "B",
               "Mark the shown step to come back to, or take its mark away.", "bookmark", checkable=True, separated=True),
    ActionSpec("previous_bookmark", "step", "Pre&vious bookmark", "Ctrl+Left", "Show the marked step before."),
    ActionSpec("next_bookmark", "step", "Ne&xt bookmark", "Ctrl+Right", "Show the next marked step."),
    ActionSpec("set_reference", "step", "Use as &reference step", "X",
               "Compare other steps with the shown one: by colours, and in the middle pane.", separated=True),
    ActionSpec("show_suggested", "step", "Show the s&uggested step", "S", "Show the step where overfitting seems to begin."),
    ActionSpec("show_best", "step", "Show the best s&tep", "Shift+S", "Show the step that is closest to the ground truth."),
    ActionSpec("keys", "help", "&Keys", "F1; ?", "List all keys."),
    ActionSpec("log_file", "help", "Copy &path of the log file", "",
               "Put the path of the log file on the clipboard, for a bug report."),
    ActionSpec("about", "help", "&About", "", "Versions and licence.", separated=True),
)  # fmt: skip


def build(
    parent: QWidget, handlers: dict[str, Callable[[], None]], keys: Mapping[str, str] | None = None
) -> dict[str, QAction]:
    """Make all actions; those without a handler are not made, so that no dead control appears.

    Args:
        parent: the window in which the keys work.
        handlers: what each action does, by name.
        keys: key of each action, by name; by default those of the table.
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
        shortcuts = QKeySequence.listFromString(spec.key if keys is None else keys[spec.name])
        action.setShortcuts(shortcuts)
        plain = spec.text.replace("&", "").rstrip("…")
        key = f"  ({shortcuts[0].toString(QKeySequence.SequenceFormat.NativeText)})" if shortcuts else ""
        action.setToolTip(f"{spec.tip or plain}{key}")
        action.setStatusTip(spec.tip)
        # A held key walks through the snapshots, but switches nothing to and fro.
        action.setAutoRepeat(not spec.checkable)
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
        name = f"{spec.menu}/{spec.submenu}" if spec.submenu else spec.menu
        if spec.separated:
            menus.get(name, menu).addSeparator()
        if name not in menus:
            menus[name] = menu.addMenu(spec.submenu)
        menu = menus[name]
        menu.addAction(actions[spec.name])
    for menu in menus.values():
        menu.setToolTipsVisible(False)
    return menus
