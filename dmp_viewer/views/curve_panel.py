"""The training curve: losses and errors over the steps, growing live, with the steps that matter marked."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence

from qtpy.QtCore import Qt, QTimer, Signal
from qtpy.QtGui import QColor, QPalette, QResizeEvent
from qtpy.QtWidgets import (
    QCheckBox,
    QHBoxLayout,
    QLabel,
    QSizePolicy,
    QSlider,
    QStackedLayout,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from dmp.settings import Settings
from dmp_viewer.curve import EXPLANATIONS, MEASURE_BY_NAME, MEASURES, Curve, Reference, axis_text, unit_text
from dmp_viewer.icons import icon
from dmp_viewer.step_mark import StepMark
from dmp_viewer.theme import LIGHT, Theme
from dmp_viewer.views.curve_legend import CurveLegend
from dmp_viewer.views.curve_plot import CurvePlot

# A completion is judged by its movement; how well it meets what is known says little about the holes.
_QUIET_IN_HOLES = ("data_loss", "laplacian_loss")
_LOG_TIP = "Logarithmic axis for losses and errors; MAD keeps its own linear axis."
_NO_LOG_TIP = "One of the drawn values is not above zero, which a logarithmic axis cannot show."
_MOST_ADVICE_LINES = 3


class CurvePanel(QWidget):
    """Plot, legend with values, and a sentence about the suggested step.

    Signals:
        stepClicked: the step under a click, as a float.
        logAxisChanged: whether the left axis is logarithmic.
        smoothingChanged: strength of the smoothing, 0 to 0.99.
    """

    stepClicked = Signal(float)
    logAxisChanged = Signal(bool)
    smoothingChanged = Signal(float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._curve = Curve()
        self._other: Curve | None = None
        self._settings: Settings | None = None
        self._theme: Theme = LIGHT
        self._log = True
        self._advice_step: int | None = None
        self._advice_reason = ""
        self._hidden = {measure.name for measure in MEASURES if not measure.shown}
        self._shown_step: int | None = None
        self._hovered_step: float | None = None
        self._task = ""
        self._note = ""
        self._references: tuple[Reference, ...] = ()
        self._build()

    # -- what is shown ------------------------------------------------------------------------------------------------

    def set_curve(self, curve: Curve, settings: Settings | None) -> None:
        """Draw a curve; called again with the same one when it has grown."""
        if curve is not self._curve:
            self.plot.forget_averages()
        self._curve, self._settings = curve, settings
        self._stack.setCurrentIndex(1 if len(curve) > 1 else 0)
        if self._all_names() != self.plot.names:
            self._make_lines()
        self._draw_all()
        self._update_readout()

    def set_other(self, curve: Curve | None, name: str) -> None:
        """Lay the curve of another run over this one; None takes it away."""
        if curve is not None and curve is not self._other:
            # What another method minimises cannot be compared; it is drawn when somebody asks for it.
            self._hidden |= {name for name in curve.names() if name.endswith("_loss") and name not in self._curve.names()}
        self._other = curve
        self._legend.set_other(name if curve is not None else "")
        self._make_lines()
        self._draw_all()
        self._update_readout()

    def set_task(self, task: str) -> None:
        """Explain the curve of a kind of training (key of :data:`EXPLANATIONS`) and draw at first what it is judged by."""
        if task == self._task:
            return
        self._task = task
        text = EXPLANATIONS[task]
        self._empty.setText(f"The curve grows here during training.\n\n{text}")
        self._help.setToolTip(f"<p>{text}</p>")
        self._help.setAccessibleDescription(text)
        quiet = _QUIET_IN_HOLES if task in ("complete", "made-up-holes") else ()
        self._hidden = {measure.name for measure in MEASURES if not measure.shown or measure.name in quiet}
        if self.plot.names:
            self._list_measures()
            self._draw_all()
            self._update_readout()

    def set_note(self, text: str) -> None:
        """Say something else than which step is suggested; an empty text brings the suggestion back."""
        if text != self._note:
            self._note = text
            self._write_advice()

    def set_references(self, references: tuple[Reference, ...]) -> None:
        """Draw level lines to compare measures with."""
        if references != self._references:
            self._references = references
            self.plot.set_levels(references)

    def set_shown_step(self, step: int | None) -> None:
        """Move the line of the shown step."""
        self._shown_step = step
        self.plot.set_shown_step(step)
        self._update_readout()

    def set_marks(self, marks: Sequence[StepMark], reason: str = "", stretch: tuple[int, int] | None = None) -> None:
        """Mark the steps that matter; the reason for the suggested one is written above the plot.

        Args:
            marks: the steps.
            reason: a sentence.
            stretch: first and last step that are about as good as the suggested one.
        """
        self.plot.set_marks(marks, stretch)
        self._advice_step = next((mark.step for mark in marks if mark.name == "suggested"), None)
        self._advice_reason = reason if self._advice_step is not None else ""
        self._write_advice()

    def set_log_axis(self, logarithmic: bool) -> None:
        """Make the left axis logarithmic or linear."""
        self._log = logarithmic
        self._log_box.setChecked(logarithmic)
        self._draw_all()

    @property
    def is_log(self) -> bool:
        """Whether the left axis is wanted to be logarithmic."""
        return self._log

    def set_smoothing(self, strength: float) -> None:
        """Smooth the drawn lines by a running average; the measured values stay visible, faintly."""
        self.plot.strength = min(max(strength, 0.0), 0.99)
        self._smoothing.setValue(round(self.plot.strength * 100))
        self._smoothing_text.setText(f"{self.plot.strength:.2f}")
        self.plot.forget_averages()
        self._draw_all()

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        self.plot.set_theme(theme)
        self.plot.set_levels(self._references)
        self._legend.set_theme(theme)
        self._write_advice()
        self._help.setIcon(icon("help", theme, color=theme.subtle))
        palette = self._empty.palette()
        palette.setColor(QPalette.ColorRole.Window, QColor(theme.base))
        palette.setColor(QPalette.ColorRole.WindowText, QColor(theme.subtle))
        self._empty.setPalette(palette)
        self._empty.parentWidget().setPalette(palette)

    @property
    def legend(self) -> CurveLegend:
        """The legend with its values."""
        return self._legend

    def drawn_names(self) -> list[str]:
        """Return the measures that are drawn now."""
        return [name for name in self.plot.names if name not in self._hidden]

    @property
    def advice(self) -> str:
        """The sentence about the suggested step, or what is said in its place."""
        return self._note or self._advice_reason

    # -- building -----------------------------------------------------------------------------------------------------

    def _build(self) -> None:
        self.plot = CurvePlot()
        self.plot.hovered.connect(self._on_plot_hovered)
        self.plot.clicked.connect(self._on_plot_clicked)
        self._legend = CurveLegend()
        self._legend.toggled.connect(self._on_legend_toggled)
        title = QLabel("Training curve")
        font = title.font()
        font.setBold(True)
        title.setFont(font)
        self._help = QToolButton()
        self._help.setAutoRaise(True)
        self._help.setAccessibleName("What the curve shows")
        self._advice = QLabel()
        self._advice.setTextFormat(Qt.TextFormat.RichText)
        self._advice.setWordWrap(True)
        self._advice.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Minimum)
        self._advice.setTextInteractionFlags(
            Qt.TextInteractionFlag.LinksAccessibleByMouse | Qt.TextInteractionFlag.LinksAccessibleByKeyboard
        )
        self._advice.linkActivated.connect(lambda step: self.stepClicked.emit(float(step)))
        self._log_box = QCheckBox("Log axis")
        self._log_box.setChecked(True)
        self._log_box.clicked.connect(self.logAxisChanged)
        self._smoothing = QSlider(Qt.Orientation.Horizontal)
        self._smoothing.setRange(0, 99)
        self._smoothing.setFixedWidth(90)
        self._smoothing.setAccessibleName("Smoothing of the curve")
        self._smoothing.setToolTip("Running average of the drawn lines. The measured values stay visible, faintly.")
        self._smoothing.valueChanged.connect(lambda value: self.smoothingChanged.emit(value / 100))
        self._smoothing_text = QLabel("0.00")
        self._smoothing_text.setMinimumWidth(self._smoothing_text.sizeHint().width())
        head = QHBoxLayout()
        head.setContentsMargins(8, 0, 8, 0)
        head.addWidget(title)
        head.addWidget(self._help)
        head.addSpacing(8)
        head.addWidget(self._advice, 1)
        head.addSpacing(12)
        for widget in (self._log_box, QLabel("Smoothing"), self._smoothing, self._smoothing_text):
            head.addWidget(widget)

        full = QWidget()
        row = QHBoxLayout(full)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(0)
        row.addWidget(self.plot, 1)
        row.addWidget(self._legend)
        self._empty = QLabel()
        self._empty.setWordWrap(True)
        self._empty.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._empty.setAutoFillBackground(True)
        self._empty.setMargin(16)
        self._stack = QStackedLayout()
        middle = QWidget()
        middle_row = QHBoxLayout(middle)
        middle_row.setContentsMargins(0, 0, 0, 0)
        middle_row.addStretch(1)
        middle_row.addWidget(self._empty, 8)
        middle_row.addStretch(1)
        self._empty.setMaximumWidth(720)
        middle.setAutoFillBackground(True)
        self._stack.addWidget(middle)
        self._stack.addWidget(full)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 4, 0, 0)
        layout.setSpacing(2)
        layout.addLayout(head)
        layout.addLayout(self._stack, 1)
        self.setMinimumHeight(130)
        self.set_task("denoise")

    # -- drawing ------------------------------------------------------------------------------------------------------

    def _all_names(self) -> list[str]:
        """Return what is measured in one of both runs, in the order of :data:`MEASURES`."""
        found = {*self._curve.names(), *(self._other.names() if self._other is not None else ())}
        return [measure.name for measure in MEASURES if measure.name in found]

    def _make_lines(self) -> None:
        self.plot.set_hidden(self._hidden)
        self.plot.set_names(self._all_names())
        self.plot.set_other(self._other)
        self._list_measures()

    def _list_measures(self) -> None:
        units = {name: unit_text(MEASURE_BY_NAME[name].unit, self._settings) for name in self.plot.names}
        self._legend.set_measures(units, self._hidden)
        self._legend.set_theme(self._theme)

    def _draw_all(self) -> None:
        left = [name for name in self.drawn_names() if MEASURE_BY_NAME[name].unit != "degrees"]
        curves = [self._curve] if self._other is None else [self._curve, self._other]
        possible = all(curve.lowest(name) > 0 for name in left for curve in curves)
        self._log_box.setEnabled(possible)
        self._log_box.setToolTip(_LOG_TIP if possible else _NO_LOG_TIP)
        self.plot.set_hidden(self._hidden)
        degrees = [name for name in self.drawn_names() if name not in left]
        right = ("MAD (degrees)" if degrees == ["mad"] else "Degrees") if degrees else ""
        self.plot.set_axes(axis_text(left, self._settings), right, logarithmic=self._log and possible)
        self.plot.draw(self._curve)
        self.plot.set_levels(self._references)

    def _update_readout(self) -> None:
        step = self._hovered_step if self._hovered_step is not None else self._shown_step
        row: Mapping[str, float] | None = None if step is None else self._curve.nearest(step)
        other = None if step is None or self._other is None else self._other.nearest(step)
        self._legend.set_row(row, other, hovered=self._hovered_step is not None)

    def _write_advice(self) -> None:
        """Say it in a few lines; where there is no room for all of it, its end is in the tool tip only."""
        self._advice.setToolTip(f"<p>{html.escape(self.advice)}</p>" if self.advice else "")
        lead, plain = "", ""
        if not self._note and self._advice_step is not None:
            plain = f"Suggested: step {self._advice_step:,}. "
            link = f'<a style="color:{self._theme.suggested}" href="{self._advice_step}">step {self._advice_step:,}</a>'
            lead = f"Suggested: {link}. "
        metrics = self._advice.fontMetrics()
        # A line loses about a word where it is broken.
        width = max(60, self._advice.width())
        room = round(_MOST_ADVICE_LINES * width * 0.85 if metrics.horizontalAdvance(plain + self.advice) > width else width)
        text = metrics.elidedText(self.advice, Qt.TextElideMode.ElideRight, max(0, room - metrics.horizontalAdvance(plain)))
        self._advice.setText(f'{lead}<span style="color:{self._theme.subtle}">{html.escape(text)}</span>' if text else lead)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Cut the advice to the new width, once the layout knows it."""
        super().resizeEvent(event)
        QTimer.singleShot(0, self, self._write_advice)

    # -- what the user does -------------------------------------------------------------------------------------------

    def _on_plot_hovered(self, step: float | None) -> None:
        row = None if step is None else self._curve.nearest(step)
        self._hovered_step = None if row is None else row["step"]
        self.plot.set_hovered_step(self._hovered_step)
        self._update_readout()

    def _on_plot_clicked(self, step: float) -> None:
        if len(self._curve):
            self.stepClicked.emit(step)

    def _on_legend_toggled(self, name: str, visible: bool) -> None:
        (self._hidden.discard if visible else self._hidden.add)(name)
        self._draw_all()
