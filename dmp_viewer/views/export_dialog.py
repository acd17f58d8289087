"""Asks what to export and how, shows how far it is, and lets it be cancelled. It does not block the window."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qtpy.QtCore import Signal
from qtpy.QtWidgets import (
    QDialog,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QListWidget,
    QProgressBar,
    QPushButton,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from dmp_viewer.export_requests import Offer
from dmp_viewer.views.export_pages import AnimationPage, CurvePage, MeshPage, Page, PicturePage, ReportPage


class ExportDialog(QDialog):
    """The kinds of exports at the left, the choices of one at the right, progress below.

    Signals:
        exportRequested: what is asked for, a :data:`dmp_viewer.export_requests.Request`.
        cancelRequested: give up what is being exported.
    """

    exportRequested = Signal(object)
    cancelRequested = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle("Export")
        self.mesh, self.picture, self.animation = MeshPage(), PicturePage(), AnimationPage()
        self.curve, self.report = CurvePage(), ReportPage()
        self.pages: tuple[Page, ...] = (self.mesh, self.picture, self.animation, self.curve, self.report)
        self.kinds = QListWidget(self)
        self.kinds.setAccessibleName("What to export")
        self._stack = QStackedWidget(self)
        for page in self.pages:
            self.kinds.addItem(page.title)
            self._stack.addWidget(page)
            page.changed.connect(self._update)
        self.kinds.setFixedWidth(max(110, self.kinds.sizeHintForColumn(0) + 36))
        self.kinds.currentRowChanged.connect(self._on_row_changed)
        self._reason = QLabel(self)
        self._reason.setWordWrap(True)
        self._progress_text = QLabel(self)
        self._bar = QProgressBar(self)
        self._bar.setTextVisible(False)
        self._bar.setAccessibleName("Progress of the export")
        self.cancel_button = QPushButton("Cance&l", self)
        self.cancel_button.clicked.connect(self.cancelRequested)
        self._progress = QWidget(self)
        row = QHBoxLayout(self._progress)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self._progress_text)
        row.addWidget(self._bar, 1)
        row.addWidget(self.cancel_button)
        self._progress.hide()
        self.export_button = QPushButton("&Export…", self)
        self.export_button.setDefault(True)
        self.export_button.clicked.connect(self._on_export_clicked)
        self.close_button = QPushButton("Close", self)
        self.close_button.clicked.connect(self.close)
        for button in (self.cancel_button, self.close_button):
            button.setAutoDefault(False)
        buttons = QHBoxLayout()
        buttons.addWidget(self._reason, 1)
        buttons.addWidget(self.export_button)
        buttons.addWidget(self.close_button)
        columns = QHBoxLayout()
        columns.setSpacing(12)
        columns.addWidget(self.kinds)
        columns.addWidget(self._stack, 1)
        layout = QVBoxLayout(self)
        layout.setSpacing(10)
        layout.addLayout(columns, 1)
        layout.addWidget(self._progress)
        layout.addLayout(buttons)
        self._is_busy = False
        self.kinds.setCurrentRow(0)
        self.resize(560, 430)

    def set_offer(self, offer: Offer) -> None:
        """Fit all choices to what is there."""
        for page in self.pages:
            page.set_offer(offer)
        self._update()

    def choose(self, page: Page) -> None:
        """Show one of the pages."""
        self.kinds.setCurrentRow(self.pages.index(page))

    @property
    def page(self) -> Page:
        """The page on show."""
        return self.pages[max(0, self.kinds.currentRow())]

    def set_progress(self, text: str, done: int, total: int) -> None:
        """Show how far an export is; a total of 0 means that nobody knows."""
        self._is_busy = True
        self._progress_text.setText(text)
        self._bar.setRange(0, total)
        self._bar.setValue(done)
        self._progress.show()
        self._update()

    def set_idle(self) -> None:
        """Nothing is being exported."""
        self._is_busy = False
        self._progress.hide()
        self._update()

    @property
    def progress_text(self) -> str:
        """What is being done, empty for nothing."""
        return self._progress_text.text() if self._is_busy else ""

    @property
    def reason(self) -> str:
        """Why nothing can be exported from this page now, empty when it can."""
        return self._reason.text()

    def _on_row_changed(self, row: int) -> None:
        self._stack.setCurrentIndex(row)
        self._update()

    def _on_export_clicked(self) -> None:
        self.exportRequested.emit(self.page.request())

    def _update(self) -> None:
        reason = self.page.reason
        self._reason.setText(reason)
        self.export_button.setEnabled(not reason and not self._is_busy)


def ask_target(parent: QWidget, title: str, proposal: Path, suffixes: Sequence[str]) -> Path | None:
    """Let the user choose where to write; without a suffix the first of ``suffixes`` is taken."""
    filters = ";;".join(f"{suffix[1:].upper()} (*{suffix})" for suffix in suffixes)
    name, _ = QFileDialog.getSaveFileName(parent, title, str(proposal), filters)
    if not name:
        return None
    path = Path(name)
    return path if path.suffix else path.with_suffix(suffixes[0])
