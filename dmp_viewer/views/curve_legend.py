"""The legend of the curve, which tells the values at the pointed or shown step as well."""

from __future__ import annotations

from collections.abc import Mapping

from qtpy.QtCore import QRectF, QSize, Qt, Signal
from qtpy.QtGui import QColor, QFontMetrics, QIcon, QPainter, QPen, QPixmap
from qtpy.QtWidgets import QCheckBox, QGridLayout, QLabel, QScrollArea, QSizePolicy, QVBoxLayout, QWidget

from dmp_viewer.curve import MEASURE_BY_NAME, MEASURES
from dmp_viewer.theme import LIGHT, Theme

# Lines differ in style as well as in colour, so that nobody has to tell hues apart.
_STYLES = {
    "laplacian_loss": Qt.PenStyle.DashLine,
    "normal_loss": Qt.PenStyle.DashLine,
    "total_loss": Qt.PenStyle.DashDotLine,
    "held_out_normal_error": Qt.PenStyle.DashLine,
    "displacement": Qt.PenStyle.DotLine,
    "input_distance": Qt.PenStyle.DashDotLine,
    "inserted_movement": Qt.PenStyle.DashDotLine,
    "hole_distance": Qt.PenStyle.DashLine,
    "hole_normal_error": Qt.PenStyle.DashDotDotLine,
    "vertex_error": Qt.PenStyle.DashLine,
    "mad": Qt.PenStyle.DashDotDotLine,
}


def line_style(name: str) -> Qt.PenStyle:
    """Return the line style of a measure."""
    return _STYLES.get(name, Qt.PenStyle.SolidLine)


class CurveLegend(QScrollArea):
    """One row a measure: its line, its name (click: show or hide), its value.

    Signals:
        toggled: name of a measure and whether it is to be drawn.
    """

    toggled = Signal(str, bool)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFrameShape(QScrollArea.Shape.NoFrame)
        self.setWidgetResizable(True)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        content = QWidget()
        self._heading = QLabel(content)
        self._heading.setContentsMargins(6, 0, 0, 2)
        self._grid = QGridLayout()
        self._grid.setContentsMargins(0, 0, 6, 0)
        self._grid.setVerticalSpacing(0)
        self._grid.setHorizontalSpacing(10)
        self._grid.setColumnStretch(0, 1)
        layout = QVBoxLayout(content)
        layout.setContentsMargins(4, 2, 4, 2)
        layout.setSpacing(0)
        layout.addWidget(self._heading)
        layout.addLayout(self._grid)
        layout.addStretch(1)
        self.setWidget(content)
        self._other_heading = QLabel(content)
        self._other_heading.setContentsMargins(6, 0, 0, 2)
        self._other_heading.setWordWrap(True)
        self._other_heading.hide()
        layout.insertWidget(1, self._other_heading)
        self._buttons: dict[str, QCheckBox] = {}
        self._values: dict[str, QLabel] = {}
        self._other_values: dict[str, QLabel] = {}
        self._has_other = False
        # Wide enough for the longest name and value, so that nothing is cut when the values come.
        metrics = self.fontMetrics()
        longest = max(metrics.horizontalAdvance(measure.label) for measure in MEASURES)
        self._width = longest + metrics.horizontalAdvance("00.00°") + 110
        self._other_width = metrics.horizontalAdvance("0.0000°") + 12
        self.setFixedWidth(self._width)
        self._theme = LIGHT

    def set_other(self, name: str) -> None:
        """Make room for the values of another run; an empty name takes them away."""
        self._has_other = bool(name)
        self._other_heading.setVisible(self._has_other)
        self._other_heading.setText(f"○ right column: {name}")
        self._other_heading.setToolTip(name)
        self.setFixedWidth(self._width + (self._other_width if self._has_other else 0))

    def set_measures(self, units: Mapping[str, str], hidden: set[str]) -> None:
        """List other measures, each with its unit."""
        for widget in (*self._buttons.values(), *self._values.values(), *self._other_values.values()):
            self._grid.removeWidget(widget)
            # Until the event loop deletes it, it would be seen behind its successor.
            widget.hide()
            widget.deleteLater()
        self._buttons, self._values, self._other_values = {}, {}, {}
        for row, (name, unit) in enumerate(units.items()):
            measure = MEASURE_BY_NAME[name]
            button = QCheckBox(measure.label)
            button.setChecked(name not in hidden)
            button.setIconSize(QSize(24, 14))
            button.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
            counted = "It has no unit." if unit == "none" else f"In {unit}."
            button.setToolTip(f"<p>{measure.help}</p><p>{counted} Click to show or hide.</p>")
            button.toggled.connect(lambda on, name=name: self._on_toggled(name, on))
            self._grid.addWidget(button, row, 0)
            self._buttons[name] = button
            for column, labels in ((1, self._values), (2, self._other_values)):
                value = QLabel()
                value.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
                value.setMinimumWidth(QFontMetrics(value.font()).horizontalAdvance("0.0000°"))
                value.setVisible(column == 1 or self._has_other)
                self._grid.addWidget(value, row, column)
                labels[name] = value

    def set_row(self, row: Mapping[str, float] | None, other: Mapping[str, float] | None, *, hovered: bool) -> None:
        """Show the values of a logged step, and of the nearest one of another run."""
        self._heading.setText("" if row is None else f"{'Step' if hovered else 'Shown: step'} {int(row['step']):,}")
        for values, labels in ((row, self._values), (other, self._other_values)):
            for name, label in labels.items():
                label.setText("" if values is None or name not in values else value_text(name, values[name]))

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        for name, button in self._buttons.items():
            button.setIcon(_line_icon(theme, name, faint=not button.isChecked()))

    def value_shown(self, name: str) -> str:
        """Return the text beside a measure."""
        return self._values[name].text()

    def other_value_shown(self, name: str) -> str:
        """Return the text beside a measure for the other run."""
        return self._other_values[name].text()

    def button(self, name: str) -> QCheckBox:
        """Return the check box of a measure."""
        return self._buttons[name]

    @property
    def heading(self) -> str:
        """The line above the values."""
        return self._heading.text()

    def _on_toggled(self, name: str, on: bool) -> None:
        self._buttons[name].setIcon(_line_icon(self._theme, name, faint=not on))
        self.toggled.emit(name, on)


def value_text(name: str, value: float) -> str:
    """Return a value with three significant digits; angles in degrees."""
    if MEASURE_BY_NAME[name].unit == "degrees":
        return f"{value:.2f}°"
    if value != 0 and not 1e-3 <= abs(value) < 1e4:
        return f"{value:.1e}"
    return f"{value:.4f}" if abs(value) < 1 else f"{value:.3f}"


def _line_icon(theme: Theme, name: str, *, faint: bool) -> QIcon:
    """Draw a piece of the line, faint when it is hidden."""
    picture = QPixmap(48, 28)
    picture.setDevicePixelRatio(2.0)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setOpacity(0.35 if faint else 1.0)
    painter.setPen(QPen(QColor(theme.curves[name]), 2.2, line_style(name)))
    area = QRectF(0, 0, 24, 14)
    painter.drawLine(area.left(), area.center().y(), area.right(), area.center().y())
    painter.end()
    return QIcon(picture)
