"""The dock with all runs and the queue: search, list, what can be done with the chosen one, and what waits."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from qtpy.QtCore import QPoint, QSize, Qt, Signal
from qtpy.QtGui import QAction, QColor, QImage, QPalette
from qtpy.QtWidgets import (
    QDockWidget,
    QFrame,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QMenu,
    QSizePolicy,
    QStackedWidget,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from dmp_viewer.icons import icon
from dmp_viewer.runs_entries import RunRow, matches
from dmp_viewer.theme import Theme
from dmp_viewer.views.buttons import tool_button
from dmp_viewer.views.queue_list import QueueList
from dmp_viewer.views.runs_list import RunsList

_NO_RUNS = "No runs yet.\n\nEvery training is kept here by itself: open a mesh and press Start."
_NO_MATCH = "No run has all of these words in its name, mesh, settings or state."
# What stands in the menu of a run, in groups.
MENU = (
    ("listed_open", "listed_proceed", "listed_compare"),
    ("listed_settings", "listed_queue", "listed_queue_settings"),
    ("listed_rename", "listed_reveal", "listed_trash"),
)


class RunsDock(QDockWidget):
    """All runs that are kept, and what waits to be trained.

    Args:
        actions: all actions of the window by name.
        parent: the window.

    Signals:
        seen: it has come into sight.
    """

    seen = Signal()

    def __init__(self, actions: dict[str, QAction], parent: QWidget | None = None) -> None:
        super().__init__("Runs", parent)
        self.setObjectName("runs")
        self.setAllowedAreas(Qt.DockWidgetArea.LeftDockWidgetArea | Qt.DockWidgetArea.RightDockWidgetArea)
        self._rows: list[RunRow] = []
        self.search = QLineEdit(self)
        self.search.setPlaceholderText("Search name, mesh, settings, state")
        self.search.setAccessibleName("Search the runs")
        self.search.setClearButtonEnabled(True)
        self.search.textChanged.connect(lambda _text: self._show_rows())
        self.list = RunsList(self._picture)
        self.list.setFrameShape(QFrame.Shape.NoFrame)
        self.list.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.list.customContextMenuRequested.connect(self._show_menu)
        self.pictures_of: Callable[[RunRow], QImage | None] = lambda _row: None
        self._nothing = QLabel(_NO_RUNS)
        self._nothing.setWordWrap(True)
        self._nothing.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._nothing.setMargin(24)
        self._stack = QStackedWidget()
        self._stack.addWidget(self.list)
        self._stack.addWidget(self._nothing)
        self.menu = QMenu(self)
        for group in MENU:
            if not self.menu.isEmpty():
                self.menu.addSeparator()
            for name in group:
                self.menu.addAction(actions[name])
        self._more = QToolButton()
        self._more.setText("More ▾")
        self._more.setAutoRaise(True)
        self._more.setToolTip("What else can be done with the chosen run")
        self._more.setAccessibleName("More for the chosen run")
        self._more.clicked.connect(lambda: self.menu.popup(self._more.mapToGlobal(self._more.rect().bottomLeft())))
        self._more.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextOnly)
        self._more.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.queue = QueueList(actions)
        self._count = QLabel()
        self._float, self._close = self._make_title_bar()
        # Short, for the buttons; the menus say it in full.
        actions["listed_queue"].setIconText("Queue")
        self._lay_out(actions)
        self._show_rows()

    def _make_title_bar(self) -> tuple[QToolButton, QToolButton]:
        """Make a title whose buttons can be reached by keyboard and seen in both themes; the style's own cannot."""
        bar = QWidget(self)
        title = QLabel("Runs", bar)
        font = title.font()
        font.setBold(True)
        font.setPointSizeF(font.pointSizeF() * 1.15)
        title.setFont(font)
        row = QHBoxLayout(bar)
        row.setContentsMargins(8, 6, 4, 2)
        row.setSpacing(0)
        row.addWidget(title, 1)
        buttons = []
        for text, act in (
            ("Make the list a window of its own, or dock it again", lambda: self.setFloating(not self.isFloating())),
            ("Close the list", self.close),
        ):
            button = QToolButton(bar)
            button.setAutoRaise(True)
            button.setToolTip(text)
            button.setAccessibleName(text)
            button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
            button.clicked.connect(lambda _checked=False, act=act: act())
            row.addWidget(button)
            buttons.append(button)
        self.setTitleBarWidget(bar)
        return buttons[0], buttons[1]

    def _lay_out(self, actions: dict[str, QAction]) -> None:
        content = QWidget()
        layout = QVBoxLayout(content)
        layout.setContentsMargins(0, 4, 0, 0)
        layout.setSpacing(4)
        top = QHBoxLayout()
        top.setContentsMargins(8, 0, 8, 0)
        top.addWidget(self.search, 1)
        top.addWidget(self._count)
        buttons = QHBoxLayout()
        buttons.setContentsMargins(6, 0, 6, 0)
        buttons.setSpacing(2)
        for name in ("listed_open", "listed_proceed", "listed_queue"):
            buttons.addWidget(tool_button(actions[name], with_text=True))
        buttons.addStretch(1)
        buttons.addWidget(self._more)
        line = QFrame()
        line.setFrameShape(QFrame.Shape.HLine)
        line.setForegroundRole(QPalette.ColorRole.Mid)
        line.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        layout.addLayout(top)
        layout.addWidget(self._stack, 1)
        layout.addLayout(buttons)
        layout.addWidget(line)
        layout.addWidget(self.queue)
        self.setWidget(content)
        self.visibilityChanged.connect(lambda visible: self.seen.emit() if visible else None)

    def sizeHint(self) -> QSize:
        """Return a width at which nothing important is cut."""
        return QSize(320, 480)

    def set_rows(self, rows: Sequence[RunRow]) -> None:
        """Show these runs, as far as the search lets them."""
        self._rows = list(rows)
        self._show_rows()

    def replace_row(self, row: RunRow) -> None:
        """Show what has become of one run."""
        self.set_rows([row if other.folder == row.folder else other for other in self._rows])

    @property
    def all_rows(self) -> list[RunRow]:
        """All runs, also those that the search hides."""
        return list(self._rows)

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self.list.set_theme(theme)
        self.queue.set_theme(theme)
        self._float.setIcon(icon("window", theme))
        self._close.setIcon(icon("close", theme))
        for text in (self._nothing, self._count):
            palette = text.palette()
            palette.setColor(QPalette.ColorRole.WindowText, QColor(theme.subtle))
            text.setPalette(palette)

    def _show_rows(self) -> None:
        search = self.search.text()
        shown = [row for row in self._rows if matches(row, search)]
        self.list.set_rows(shown)
        self._stack.setCurrentIndex(0 if shown else 1)
        self._nothing.setText(_NO_MATCH if self._rows else _NO_RUNS)
        self._count.setText(f"{len(shown):,} of {len(self._rows):,}" if search else f"{len(shown):,}" if shown else "")
        self._count.setAccessibleName("Number of runs")

    def _picture(self, row: RunRow) -> QImage | None:
        return self.pictures_of(row)

    def _show_menu(self, place: QPoint) -> None:
        if self.list.chosen():
            self.menu.popup(self.list.viewport().mapToGlobal(place))
