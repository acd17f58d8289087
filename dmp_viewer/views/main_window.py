"""The window: menus, tool bar, meshes, timeline, curve and run panel. It shows and asks; the controller answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from qtpy.QtCore import QByteArray, QEvent, QObject, QPoint, QSize, Qt, Signal
from qtpy.QtGui import QCloseEvent, QDragEnterEvent, QDropEvent, QGuiApplication, QKeyEvent, QKeySequence
from qtpy.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSlider,
    QAbstractSpinBox,
    QComboBox,
    QLabel,
    QMainWindow,
    QMenu,
    QScrollArea,
    QSizePolicy,
    QSplitter,
    QStackedWidget,
    QToolBar,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from dmp_viewer.actions import ACTIONS, build, fill_menu_bar
from dmp_viewer.icons import icon
from dmp_viewer.theme import LIGHT, Theme
from dmp_viewer.views.banner import BannerArea
from dmp_viewer.views.buttons import tool_button
from dmp_viewer.views.color_bar import ColorBar
from dmp_viewer.views.curve_panel import CurvePanel
from dmp_viewer.views.curve_plot import CurvePlot
from dmp_viewer.views.focus_ring import FocusRing
from dmp_viewer.views.interactor import Interactor
from dmp_viewer.views.mesh_panes import MeshPanes
from dmp_viewer.views.other_timeline import OtherTimeline
from dmp_viewer.views.picked_bar import PickedBar
from dmp_viewer.views.rows import Rows
from dmp_viewer.views.run_panel import RunPanel
from dmp_viewer.views.runs_dock import RunsDock
from dmp_viewer.views.start_page import StartPage
from dmp_viewer.views.timeline import Timeline

_FIRST_SIZES = {"rows": [540, 270], "columns": [1100, 290]}
_MOVING_KEYS = (Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_Home, Qt.Key.Key_End)


class MainWindow(QMainWindow):
    """The parts of the window in their places.

    Signals:
        actionTriggered: name of an action of :data:`dmp_viewer.actions.ACTIONS`.
        filesDropped: list of paths.
        sampleChosen: name of a sample.
        recentChosen: path, as text.
        themeChanged: after all parts have taken other colours.
    """

    themeChanged = Signal()
    actionTriggered = Signal(str)
    filesDropped = Signal(object)
    sampleChosen = Signal(str)
    recentChosen = Signal(str)

    def __init__(
        self,
        *,
        multi_samples: int = 0,
        tasks: tuple[str, ...] = ("denoise",),
        devices: tuple[tuple[str, str], ...] = (),
        keys: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__()
        self.setWindowTitle("dmp-viewer")
        self.theme = LIGHT
        self.setAcceptDrops(True)
        self.setMinimumSize(720, 520)
        screen = QGuiApplication.primaryScreen()
        available = screen.availableSize() if screen is not None else QSize(1400, 880)
        # Never larger than the screen: what hangs over its edge cannot be reached.
        self.resize(QSize(1400, 880).boundedTo(available))
        # Asked before the window closes; the controller ends the training in it.
        self.close_guard: Callable[[], bool] = lambda: True
        handlers: dict[str, Callable[[], None]] = {spec.name: partial(self.actionTriggered.emit, spec.name) for spec in ACTIONS}
        self.named_actions = build(self, handlers, keys)
        self._menus = fill_menu_bar(self.menuBar(), self.named_actions)
        self._add_open_menus()
        self._parts(multi_samples, tasks, devices)
        self._tool_bar()
        self.set_has_mesh(False)
        for row in self._passing_rows:
            row.installEventFilter(self)
        for widget in self.findChildren(QWidget):
            widget.setAcceptDrops(False)
            if isinstance(widget, (QAbstractButton, QAbstractSlider, QAbstractSpinBox, QComboBox, QAbstractItemView)):
                widget.installEventFilter(self)
        # Its rows are dragged into another order; files that are dropped on it fall through to the window.
        self.runs.queue.rows.setDragDropMode(QAbstractItemView.DragDropMode.InternalMove)

    # -- what is shown ------------------------------------------------------------------------------------------------

    def set_has_mesh(self, has_mesh: bool) -> None:
        """Show the workspace, or the start page while nothing is open."""
        self._stack.setCurrentIndex(1 if has_mesh else 0)
        # On the start page nobody knows yet what it is about.
        self._pace.setVisible(has_mesh)

    def set_samples(self, samples: Sequence[tuple[str, str, str]]) -> None:
        """Offer samples in the menu and on the start page: (name, title, description)."""
        self._sample_menu.clear()
        for name, title, text in samples:
            action = self._sample_menu.addAction(title)
            action.setStatusTip(text)
            action.triggered.connect(lambda _checked=False, name=name: self.sampleChosen.emit(name))
        self._sample_menu.menuAction().setVisible(bool(samples))
        self.start_page.set_samples(samples)

    def set_recent(self, paths: Sequence[Path]) -> None:
        """Offer what was open lately."""
        self._recent_menu.clear()
        for number, path in enumerate(paths, start=1):
            text = str(path).replace("&", "&&")
            action = self._recent_menu.addAction(f"&{number}  {text}")
            action.triggered.connect(lambda _checked=False, path=path: self.recentChosen.emit(str(path)))
        self._recent_menu.setEnabled(bool(paths))
        self.start_page.set_recent(paths)

    def set_progress(self, text: str) -> None:
        """Say in the status bar how far the training is; nothing while none is active."""
        self._progress.setText(text)

    @property
    def progress_text(self) -> str:
        """What the status bar says about the training."""
        return self._progress.text()

    def set_pace(self, pace: str) -> None:
        """Say who comes first, ``smooth`` for the window or ``fast`` for the training."""
        action = self.named_actions[f"pace_{pace}"]
        action.setChecked(True)
        text = action.text().replace("&", "")
        self._pace.setText(f"{text} ▾")
        self._pace.setAccessibleName(f"Pace: {text}")

    def set_facts(self, text: str) -> None:
        """Say at the right of the status bar what is open."""
        self._facts.setText(text)

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme everywhere."""
        self.theme = theme
        for spec in ACTIONS:
            if spec.icon and spec.name in self.named_actions:
                self.named_actions[spec.name].setIcon(icon(spec.icon, theme))
        for part in (self.panes, self.picked, self.curve, self.timeline, self.panel, self.banners, self.start_page, self.runs):
            part.set_theme(theme)
        self._focus_ring.set_theme(theme)
        self.themeChanged.emit()

    def set_panel_visible(self, visible: bool) -> None:
        """Show or hide the run panel."""
        self.panel.setVisible(visible)

    def set_curve_visible(self, visible: bool) -> None:
        """Show or hide the curve."""
        self.curve.setVisible(visible)

    def show_runs(self) -> None:
        """Bring the list of runs and the queue into sight."""
        self.runs.show()
        self.runs.raise_()

    def menu(self, name: str) -> QMenu:
        """Return a menu by its name; that of a submenu is ``menu/text``."""
        return self._menus[name]

    def keys(self) -> dict[str, str]:
        """Return the key of each action, by name."""
        return {name: QKeySequence.listToString(action.shortcuts()) for name, action in self.named_actions.items()}

    # -- layout -------------------------------------------------------------------------------------------------------

    def layout_state(self) -> tuple[str, dict[str, list[int]]]:
        """Return place and size of the window, base64, and the sizes of its parts."""
        geometry = bytes(self.saveGeometry().toBase64().data()).decode()
        sizes = {name: splitter.sizes() for name, splitter in self._splitters.items()}
        # Rows that come and go will not be there at the next start.
        passing = sum(self._room.values())
        sizes["rows"] = [sizes["rows"][0] - passing, sizes["rows"][1] + passing]
        return geometry, sizes

    def restore_layout(self, geometry: str, splitters: dict[str, list[int]]) -> None:
        """Take over what :meth:`layout_state` returned, unless the window would lie outside of every screen."""
        if geometry:
            self.restoreGeometry(QByteArray.fromBase64(QByteArray(geometry.encode())))
        for name, sizes in splitters.items():
            if name in self._splitters and len(sizes) == self._splitters[name].count() and sum(sizes) > 0:
                self._splitters[name].setSizes(sizes)
        areas = [screen.availableGeometry() for screen in QGuiApplication.screens()]
        if areas and not any(area.intersects(self.frameGeometry()) for area in areas):
            self.move(areas[0].topLeft())

    def docks_state(self) -> str:
        """Return where the list of runs is, how large, and whether it is in sight, base64."""
        return bytes(self.saveState().toBase64().data()).decode()

    def restore_docks(self, state: str) -> None:
        """Take over what :meth:`docks_state` returned."""
        if state:
            self.restoreState(QByteArray.fromBase64(QByteArray(state.encode())))

    def reset_layout(self) -> None:
        """Put all parts where they were at first; the window keeps its place and size."""
        self.runs.setFloating(False)
        self.addDockWidget(Qt.DockWidgetArea.LeftDockWidgetArea, self.runs)
        self.resizeDocks([self.runs], [self.runs.sizeHint().width()], Qt.Orientation.Horizontal)
        self.runs.hide()
        self.set_panel_visible(True)
        self.set_curve_visible(True)
        for name, (first, second) in _FIRST_SIZES.items():
            self._splitters[name].setSizes([first, second])

    def _parts(self, multi_samples: int, tasks: tuple[str, ...], devices: tuple[tuple[str, str], ...]) -> None:
        self.banners = BannerArea()
        self.panes = MeshPanes(multi_samples=multi_samples)
        self.picked = PickedBar(self.named_actions)
        self.color_bar = ColorBar()
        self.timeline = Timeline(self.named_actions)
        self.other_timeline = OtherTimeline(self.named_actions)
        self.curve = CurvePanel()
        self.panel = RunPanel(self.named_actions, tasks=tasks, devices=devices)
        self.start_page = StartPage(self.named_actions)
        self.start_page.sampleChosen.connect(self.sampleChosen)
        self.start_page.recentChosen.connect(self.recentChosen)
        view = QWidget()
        view_layout = QVBoxLayout(view)
        view_layout.setContentsMargins(0, 0, 0, 0)
        view_layout.setSpacing(0)
        view_layout.addWidget(self.panes, 1)
        view_layout.addWidget(self.picked)
        view_layout.addWidget(self.color_bar)
        view_layout.addWidget(self.timeline)
        view_layout.addWidget(self.other_timeline)
        rows = Rows(view, self.curve)
        rows.setSizes(_FIRST_SIZES["rows"])
        columns = QSplitter(Qt.Orientation.Horizontal)
        columns.addWidget(rows)
        columns.addWidget(self.panel)
        columns.setStretchFactor(0, 1)
        columns.setStretchFactor(1, 0)
        columns.setSizes(_FIRST_SIZES["columns"])
        for splitter in (rows, columns):
            splitter.setChildrenCollapsible(False)
            splitter.setHandleWidth(5)
        self._splitters = {"rows": rows, "columns": columns}
        self.banners.heightChanging.connect(rows.keep_upper)
        # Rows that come and go take their room from the curve, so that the meshes stay where they are.
        self._passing_rows = (self.picked, self.other_timeline)
        self._room: dict[QWidget, int] = {}
        self._stack = QStackedWidget()
        self._stack.addWidget(self.start_page)
        self._stack.addWidget(columns)
        central = QWidget()
        layout = QVBoxLayout(central)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.banners)
        layout.addWidget(self._stack, 1)
        self.setCentralWidget(central)
        self.runs = RunsDock(self.named_actions, self)
        self.addDockWidget(Qt.DockWidgetArea.LeftDockWidgetArea, self.runs)
        self.resizeDocks([self.runs], [self.runs.sizeHint().width()], Qt.Orientation.Horizontal)
        self.runs.hide()
        self._focus_ring = FocusRing(self, (Interactor, CurvePlot, QLabel, QScrollArea))
        self._facts = QLabel()
        self._facts.setContentsMargins(0, 0, 8, 0)
        self._progress = QLabel()
        self._progress.setAccessibleName("Progress of the training")
        self._pace = QToolButton()
        self._pace.setAutoRaise(True)
        self._pace.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self._pace.setToolTip("Who comes first while a training runs: the window or the training")
        self._pace.clicked.connect(lambda: self._menus["run/P&ace"].popup(self._pace.mapToGlobal(QPoint(0, 0))))
        for widget in (self._progress, self._pace, self._facts):
            self.statusBar().addPermanentWidget(widget)
        self.statusBar().setSizeGripEnabled(False)

    def _tool_bar(self) -> None:
        bar = QToolBar("Tools")
        bar.setObjectName("tools")
        bar.setMovable(False)
        bar.toggleViewAction().setVisible(False)
        self.addToolBar(bar)
        for name, with_text in (
            ("open", True), ("save", True), ("export", False), ("screenshot", False), ("", False), ("show_runs", True),
            ("fit_spacer", False), ("filling_only", True), ("flip", False), ("swipe", True), ("lens", True), ("", False),
            ("smooth", False), ("edges", False), ("link", False), ("reset_view", True),
        ):  # fmt: skip
            if not name:
                bar.addSeparator()
            elif name == "fit_spacer":
                spacer = QWidget()
                spacer.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
                bar.addWidget(spacer)
            else:
                shown = bar.addWidget(tool_button(self.named_actions[name], with_text=with_text))
                if name == "filling_only":
                    # A tool bar hides the button of a hidden action only when it has made the button itself.
                    action = self.named_actions[name]
                    action.visibleChanged.connect(lambda shown=shown, action=action: shown.setVisible(action.isVisible()))

    def _add_open_menus(self) -> None:
        menu = self._menus["file"]
        before = self.named_actions["open_ground_truth"]
        self._sample_menu = QMenu("Open sa&mple", self)
        self._recent_menu = QMenu("Re&cent files", self)
        menu.insertMenu(before, self._sample_menu)
        menu.insertMenu(self.named_actions["save"], self._recent_menu)
        self._sample_menu.menuAction().setVisible(False)

    # -- events -------------------------------------------------------------------------------------------------------

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Leave Space to a button, arrows, Home and End to a slider or number that has the focus, not to the timeline."""
        if event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent):
            pressed = isinstance(watched, (QAbstractButton, QComboBox, QAbstractItemView)) and event.key() == Qt.Key.Key_Space
            moved = isinstance(watched, (QAbstractSlider, QAbstractSpinBox, QAbstractItemView)) and event.key() in _MOVING_KEYS
            if pressed or moved:
                event.accept()
                return True
        if watched in self._passing_rows and event.type() == QEvent.Type.ShowToParent:
            self._make_room(watched)
        elif watched in self._passing_rows and event.type() == QEvent.Type.HideToParent:
            self._give_room_back(watched)
        return super().eventFilter(watched, event)

    def _make_room(self, row: QWidget) -> None:
        """Let the part above the curve grow by a row that comes, if the curve can spare it."""
        above, below = self._splitters["rows"].sizes()
        height = row.sizeHint().height()
        if self.curve.isVisible() and row not in self._room and below - height >= self.curve.minimumHeight():
            self._room[row] = height
            self._splitters["rows"].setSizes([above + height, below - height])

    def _give_room_back(self, row: QWidget) -> None:
        height = self._room.pop(row, 0)
        above, below = self._splitters["rows"].sizes()
        if height:
            self._splitters["rows"].setSizes([above - height, below + height])

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        """Accept files and folders."""
        if any(url.isLocalFile() for url in event.mimeData().urls()):
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        """Pass dropped files on."""
        paths = [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
        if paths:
            event.acceptProposedAction()
            self.filesDropped.emit(paths)

    def closeEvent(self, event: QCloseEvent) -> None:
        """Close when the guard agrees; OpenGL goes before the window does."""
        if self.close_guard():
            self.panes.shut_down()
            event.accept()
        else:
            event.ignore()
