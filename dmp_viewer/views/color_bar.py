"""The colour bar that all panes share, drawn by Qt so that its text is sharp at every scale."""

from __future__ import annotations

import numpy as np
from qtpy.QtCore import QRectF, QSize, Qt, Signal
from qtpy.QtGui import QImage, QPainter, QPaintEvent, QPalette, QPen
from qtpy.QtWidgets import QComboBox, QHBoxLayout, QLabel, QSizePolicy, QWidget

from dmp_viewer.colors import PERCENTILE, ColorTable, Limits, nice_ticks

_BAR_HEIGHT = 12


class Gradient(QWidget):
    """A horizontal gradient with round numbers below it."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._table: ColorTable = np.zeros((256, 4), dtype=np.uint8)
        self._limits = Limits(0.0, 1.0)
        self._factor = 1.0
        self._unit = ""
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setToolTip(
            f"The range covers {PERCENTILE:g} % of the vertices, so that a few far ones do not take all the colours. "
            "All panes share it."
        )

    def set_scale(self, table: ColorTable, limits: Limits, factor: float, unit: str) -> None:
        """Show a colour map over a range; numbers are ``factor`` times the limits, in ``unit``."""
        self._table, self._limits, self._factor, self._unit = table, limits, factor, unit
        low, high = self.shown_limits
        self.setAccessibleName(f"Colour bar from {low:.3g} to {high:.3g} {unit}")
        self.update()

    @property
    def shown_limits(self) -> tuple[float, float]:
        """The numbers at both ends, in the shown unit."""
        return self._limits.low * self._factor, self._limits.high * self._factor

    @property
    def unit(self) -> str:
        """The shown unit."""
        return self._unit

    def sizeHint(self) -> QSize:
        """Return room for the gradient and one line of numbers."""
        return QSize(320, _BAR_HEIGHT + self.fontMetrics().height() + 14)

    def minimumSizeHint(self) -> QSize:
        """Return the least room in which three numbers can be told apart."""
        return QSize(140, self.sizeHint().height())

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw gradient, ticks and numbers."""
        painter = QPainter(self)
        metrics = self.fontMetrics()
        margin = 26.0
        bar = QRectF(margin, 5, max(10.0, self.width() - 2 * margin), _BAR_HEIGHT)
        colors = np.ascontiguousarray(self._table)
        image = QImage(colors.data, len(colors), 1, 4 * len(colors), QImage.Format.Format_RGBA8888)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawImage(bar, image)
        painter.setPen(QPen(self.palette().color(QPalette.ColorRole.Mid), 1))
        painter.drawRect(bar)
        low, high = self.shown_limits
        widest = max(metrics.horizontalAdvance(text) for text in ("-0.00", f"{high:.3g}", f"{low:.3g}")) + 18
        ticks = nice_ticks(low, high, max(2, min(9, int(bar.width() / widest))))
        step = ticks[1] - ticks[0] if len(ticks) > 1 else 1.0
        painter.setPen(self.palette().color(QPalette.ColorRole.WindowText))
        for tick in ticks:
            x = bar.left() + (tick - low) / (high - low) * bar.width()
            painter.drawLine(round(x), round(bar.bottom()), round(x), round(bar.bottom()) + 3)
            text = tick_text(tick, step)
            place = QRectF(x - 60, bar.bottom() + 4, 120, metrics.height())
            painter.drawText(place, Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop, text)
        painter.end()


def tick_text(value: float, step: float) -> str:
    """Return a tick's number with as many digits as its step needs."""
    if value == 0:
        return "0"
    if abs(value) >= 1e5 or abs(step) < 1e-4:
        return f"{value:.2g}".replace("-", "−")
    decimals = max(0, -int(np.floor(np.log10(abs(step)) + 1e-9)))
    if round(step, decimals) != round(step, 10):
        decimals += 1
    return f"{value:.{decimals}f}".replace("-", "−")


class ColorBar(QWidget):
    """The gradient with the choices that belong to it: what is coloured, over which range, in which unit.

    Signals:
        quantityChosen, rangeChosen, unitChosen: the new value, as in :class:`dmp_viewer.colors.ColorPolicy`.
    """

    quantityChosen = Signal(str)
    rangeChosen = Signal(str)
    unitChosen = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._quantity = _choice(
            "Colour",
            [("magnitude", "Displacement"), ("signed", "Signed displacement"), ("plain", "Plain")],
            "What the colours show: how far each vertex lies from the smoothed mesh, along its normal with a sign, or nothing.",
        )
        self._range = _choice(
            "Range of the colours",
            [("step", "Range: this step"), ("run", "Range: whole run")],
            "Fit the colours to the shown step, or to all snapshots of the run so that steps can be compared.",
        )
        self._unit = _choice(
            "Unit",
            [("edges", "in edge lengths"), ("file", "in file units")],
            "Mean edge lengths of the input, or the units of the file.",
        )
        self.gradient = Gradient(self)
        self._plain_note = QLabel("Bare surfaces without colours", self)
        self._plain_note.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._plain_note.setEnabled(False)
        self._plain_note.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(8, 2, 8, 2)
        layout.addWidget(self._quantity)
        layout.addWidget(self.gradient, 1)
        layout.addWidget(self._plain_note, 1)
        layout.addWidget(self._unit)
        layout.addWidget(self._range)
        self._plain_note.hide()
        for box, signal in (
            (self._quantity, self.quantityChosen),
            (self._range, self.rangeChosen),
            (self._unit, self.unitChosen),
        ):
            box.activated.connect(lambda _index, box=box, signal=signal: signal.emit(box.currentData()))

    def set_policy(self, quantity: str, range_: str, unit: str) -> None:
        """Show the policy that is in force."""
        for box, value in ((self._quantity, quantity), (self._range, range_), (self._unit, unit)):
            box.setCurrentIndex(box.findData(value))
        plain = quantity == "plain"
        self.gradient.setVisible(not plain)
        self._plain_note.setVisible(plain)
        self._range.setEnabled(not plain)
        self._unit.setEnabled(not plain)


def _choice(name: str, entries: list[tuple[str, str]], tip: str) -> QComboBox:
    box = QComboBox()
    box.setAccessibleName(name)
    box.setToolTip(tip)
    box.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    for value, text in entries:
        box.addItem(text, value)
    return box
