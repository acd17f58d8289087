"""What an empty window shows: what to do, samples to try, and what was open lately."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qtpy.QtCore import QRect, QRectF, QSize, Qt, Signal
from qtpy.QtGui import QAction, QColor, QFont, QImage, QPainter, QPaintEvent, QPalette, QPen, QPixmap
from qtpy.QtWidgets import (
    QAbstractButton,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from dmp_viewer.theme import LIGHT, Theme
from dmp_viewer.views.buttons import follow_action

CARD_PICTURE = QSize(208, 132)
_STEPS = (
    (
        "Open a damaged mesh",
        "A scan with noise or holes, as PLY, OBJ, STL, OFF, GLB, 3MF or VTP. No examples, no training data are needed.",
    ),
    ("Watch the network learn it", "Press Start. The shape is learnt first, the noise last; you see every step."),
    ("Keep the best step", "Go back in time to where the noise is gone and the detail is there, and save it."),
)


class Card(QAbstractButton):
    """A sample to open: picture, title and one sentence."""

    def __init__(self, title: str, text: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setText(title)
        self._text = text
        self._picture: QPixmap | None = None
        self._theme = LIGHT
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setAttribute(Qt.WidgetAttribute.WA_Hover)
        self.setAccessibleName(f"Open the sample {title}")
        self.setAccessibleDescription(text)
        self.setToolTip(text)
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)

    def set_picture(self, image: QImage) -> None:
        """Show a picture of the mesh."""
        self._picture = QPixmap.fromImage(image)
        self._picture.setDevicePixelRatio(image.width() / CARD_PICTURE.width())
        self.update()

    @property
    def has_picture(self) -> bool:
        """Whether the picture has arrived."""
        return self._picture is not None

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        self.update()

    def sizeHint(self) -> QSize:
        """Return the size of picture, title and four lines."""
        lines = self.fontMetrics().lineSpacing()
        return QSize(CARD_PICTURE.width() + 20, CARD_PICTURE.height() + 5 * lines + 40)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the card."""
        theme = self._theme
        painter = QPainter(self)
        painter.setRenderHints(QPainter.RenderHint.Antialiasing | QPainter.RenderHint.SmoothPixmapTransform)
        active = self.underMouse() or self.hasFocus()
        painter.setPen(QPen(QColor(theme.accent if active else theme.line), 2 if active else 1))
        painter.setBrush(QColor(theme.base))
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(1, 1, -1, -1), 8, 8)
        area = QRect(10, 10, CARD_PICTURE.width(), CARD_PICTURE.height())
        if self._picture is not None:
            painter.drawPixmap(area.topLeft(), self._picture)
        metrics = self.fontMetrics()
        bold = QFont(self.font())
        bold.setBold(True)
        painter.setFont(bold)
        painter.setPen(QColor(theme.text))
        line = QRect(area.left() + 2, area.bottom() + 8, area.width() - 4, metrics.lineSpacing())
        painter.drawText(line, Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, self.text())
        painter.setFont(self.font())
        painter.setPen(QColor(theme.subtle))
        rest = QRect(line.left(), line.bottom() + 3, line.width(), 4 * metrics.lineSpacing() + 4)
        painter.drawText(
            rest, int(Qt.TextFlag.TextWordWrap) | int(Qt.AlignmentFlag.AlignLeft) | int(Qt.AlignmentFlag.AlignTop), self._text
        )
        painter.end()


class StartPage(QScrollArea):
    """Shown while nothing is open.

    Signals:
        sampleChosen: name of a sample.
        recentChosen: path, as text.
    """

    sampleChosen = Signal(str)
    recentChosen = Signal(str)

    def __init__(self, actions: dict[str, QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setWidgetResizable(True)
        self._theme = LIGHT
        self._subtle: list[QLabel] = []
        self._numbers: list[QLabel] = []
        self.cards: dict[str, Card] = {}
        content = QWidget()
        column = QVBoxLayout(content)
        column.setContentsMargins(36, 28, 36, 24)
        column.setSpacing(14)
        column.addStretch(2)
        column.addWidget(_label("Restore a damaged mesh with nothing but that mesh", 1.7, bold=True))
        column.addLayout(self._make_steps())
        buttons = QHBoxLayout()
        buttons.setSpacing(10)
        for name, height in (("open", 34), ("open_run", 34)):
            button = QPushButton()
            follow_action(button, actions[name])
            button.setMinimumHeight(height)
            button.setMinimumWidth(150)
            buttons.addWidget(button)
            if name == "open":
                button.setDefault(True)
        buttons.addSpacing(8)
        buttons.addWidget(self._quiet(QLabel("or drop a mesh or a run folder anywhere in this window")))
        buttons.addStretch(1)
        column.addSpacing(4)
        column.addLayout(buttons)
        column.addSpacing(10)
        self._samples_heading = _label("Try a sample", 1.15, bold=True)
        column.addWidget(self._samples_heading)
        self._card_row = QHBoxLayout()
        self._card_row.setSpacing(14)
        column.addLayout(self._card_row)
        self._recent_heading = _label("Open again", 1.15, bold=True)
        column.addWidget(self._recent_heading)
        self._recent_grid = QGridLayout()
        self._recent_grid.setHorizontalSpacing(14)
        self._recent_grid.setVerticalSpacing(0)
        self._recent_grid.setColumnStretch(1, 1)
        column.addLayout(self._recent_grid)
        column.addStretch(3)
        centre = QWidget()
        row = QHBoxLayout(centre)
        row.setContentsMargins(0, 0, 0, 0)
        row.addStretch(1)
        content.setMaximumWidth(1060)
        content.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        row.addWidget(content, 20)
        row.addStretch(1)
        self.setWidget(centre)
        self.set_samples([])
        self.set_recent([])

    def set_samples(self, samples: Sequence[tuple[str, str, str]]) -> None:
        """Offer samples: (name, title, description)."""
        while self._card_row.count():
            item = self._card_row.takeAt(0)
            if item is not None and (widget := item.widget()) is not None:
                widget.deleteLater()
        self.cards = {}
        for name, title, text in samples:
            card = Card(title, text)
            card.set_theme(self._theme)
            card.clicked.connect(lambda _checked=False, name=name: self.sampleChosen.emit(name))
            self._card_row.addWidget(card)
            self.cards[name] = card
        self._card_row.addStretch(1)
        self._samples_heading.setVisible(bool(samples))

    def set_recent(self, paths: Sequence[Path]) -> None:
        """Offer what was open lately."""
        while self._recent_grid.count():
            item = self._recent_grid.takeAt(0)
            if item is not None and (widget := item.widget()) is not None:
                self._subtle = [label for label in self._subtle if label is not widget]
                widget.deleteLater()
        for row, path in enumerate(paths[:4]):
            link = QPushButton(path.name)
            link.setFlat(True)
            link.setCursor(Qt.CursorShape.PointingHandCursor)
            link.clicked.connect(lambda _checked=False, path=path: self.recentChosen.emit(str(path)))
            where = self._quiet(QLabel(str(path.parent)))
            where.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
            self._recent_grid.addWidget(link, row, 0, Qt.AlignmentFlag.AlignLeft)
            self._recent_grid.addWidget(where, row, 1)
        self._recent_heading.setVisible(bool(paths))
        self.set_theme(self._theme)

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        for label in self._subtle:
            palette = label.palette()
            palette.setColor(label.foregroundRole(), QColor(theme.subtle))
            label.setPalette(palette)
        for label in self._numbers:
            palette = label.palette()
            palette.setColor(QPalette.ColorRole.WindowText, QColor(theme.accent))
            label.setPalette(palette)
        for card in self.cards.values():
            card.set_theme(theme)

    def _make_steps(self) -> QHBoxLayout:
        row = QHBoxLayout()
        row.setSpacing(26)
        for number, (title, text) in enumerate(_STEPS, start=1):
            digit = _label(str(number), 2.2, bold=True)
            digit.setAlignment(Qt.AlignmentFlag.AlignTop)
            self._numbers.append(digit)
            words = QVBoxLayout()
            words.setSpacing(2)
            words.addWidget(_label(title, 1.0, bold=True))
            body = self._quiet(QLabel(text))
            body.setWordWrap(True)
            body.setAlignment(Qt.AlignmentFlag.AlignTop)
            words.addWidget(body, 1)
            part = QHBoxLayout()
            part.setSpacing(10)
            part.addWidget(digit, 0)
            part.addLayout(words, 1)
            row.addLayout(part, 1)
        return row

    def _quiet(self, label: QLabel) -> QLabel:
        self._subtle.append(label)
        return label


def _label(text: str, size: float, *, bold: bool) -> QLabel:
    label = QLabel(text)
    font = label.font()
    font.setPointSizeF(font.pointSizeF() * size)
    font.setBold(bold)
    label.setFont(font)
    label.setWordWrap(size > 1.5)
    return label
