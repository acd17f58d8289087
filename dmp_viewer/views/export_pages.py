"""The pages of the export dialog: one for each thing that can be exported."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from qtpy.QtCore import Qt, Signal
from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from dmp.exports.animations import Plan
from dmp.exports.scenes import LARGEST_SIDE, SMALLEST_SIDE
from dmp_viewer.export_requests import (
    AnimationRequest,
    CurveRequest,
    MeshRequest,
    Offer,
    PictureRequest,
    ReportRequest,
    Request,
)
from dmp_viewer.export_scenes import PANES_OF, PaneChoice, PictureWish

_NO_STEP = "There is no prediction yet. Start a training, or open a run."
_MESH_FORMATS = (
    (".ply", "PLY – keeps everything, exactly"),
    (".vtp", "VTP – keeps everything, for ParaView"),
    (".obj", "OBJ – positions and colours"),
    (".off", "OFF – positions only"),
    (".stl", "STL – positions only, rounded"),
)
_PICTURE_FORMATS = ((".png", "PNG"), (".jpg", "JPEG – smaller, not transparent"))
_CURVE_FORMATS = (
    (".csv", "CSV – the numbers, for spreadsheets"),
    (".png", "PNG – a chart"),
    (".svg", "SVG – a chart to enlarge and edit"),
    (".pdf", "PDF – a chart for print"),
)


class Page(QWidget):
    """One page: a sentence, and the choices below it.

    Signals:
        changed: a choice was changed.

    Attributes:
        title: its name in the list.
        reason: why nothing can be exported from here now; empty when it can.
    """

    changed = Signal()
    title = ""

    def __init__(self, help_text: str) -> None:
        super().__init__()
        self.reason = ""
        self.offer = Offer()
        text = QLabel(help_text)
        text.setWordWrap(True)
        self.form = QFormLayout()
        self.form.setContentsMargins(0, 6, 0, 0)
        self.form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(4, 0, 0, 0)
        layout.addWidget(text)
        layout.addLayout(self.form)
        layout.addStretch(1)

    def set_offer(self, offer: Offer) -> None:
        """Fit the choices to what is there."""
        self.offer = offer

    def request(self) -> Request:
        """Return what is asked for; only when there is no reason against it."""
        raise NotImplementedError

    def _choice(self, name: str, entries: Sequence[tuple[Any, str]], tip: str = "") -> QComboBox:
        box = QComboBox()
        box.setAccessibleName(name)
        box.setToolTip(f"<p>{tip}</p>" if tip else "")
        for value, text in entries:
            box.addItem(text, value)
        box.currentIndexChanged.connect(lambda _index: self.changed.emit())
        box.activated.connect(lambda _index: box.setProperty("chosen", True))
        self.form.addRow(name, box)
        return box

    def _tick(self, text: str, *, on: bool, tip: str = "") -> QCheckBox:
        box = QCheckBox(text)
        box.setChecked(on)
        box.setToolTip(f"<p>{tip}</p>" if tip else "")
        box.toggled.connect(lambda _on: self.changed.emit())
        self.form.addRow("", box)
        return box


def _fill_steps(box: QComboBox, offer: Offer) -> None:
    """Offer the kept step, which is the result unless somebody chooses the other, and the shown one."""
    wants_shown = box.currentIndex() == box.count() - 1 and bool(box.property("chosen"))
    box.blockSignals(True)
    box.clear()
    if offer.kept_step is not None:
        box.addItem(f"The kept step, {offer.kept_step:,}", offer.kept_step)
    if offer.shown_step is not None and offer.shown_step != offer.kept_step:
        box.addItem(f"The shown step, {offer.shown_step:,}", offer.shown_step)
    box.setCurrentIndex(box.count() - 1 if wants_shown else 0)
    box.blockSignals(False)


class MeshPage(Page):
    """The mesh of a step."""

    title = "Mesh"

    def __init__(self) -> None:
        super().__init__("The restored mesh of a step, for other programs.")
        self.step = self._choice("Step", ())
        self.format = self._choice("Format", _MESH_FORMATS)
        self.attributes = self._tick(
            "Write what is known of each vertex", on=True,
            tip="Its displacement from the smoothed mesh and the length of it; with a ground truth its error; for a filled "
            "hole whether the vertex was inserted. Lengths are in the units of the file.",
        )  # fmt: skip
        self.colors = self._tick("Colour the vertices as in the window", on=False)
        self.changed.connect(self._update)

    def set_offer(self, offer: Offer) -> None:
        """Fit the choices to what is there."""
        super().set_offer(offer)
        _fill_steps(self.step, offer)
        self.reason = "" if offer.shown_step is not None else _NO_STEP
        self._update()

    def _update(self) -> None:
        suffix, color = self.format.currentData(), self.offer.color_name
        self.attributes.setEnabled(suffix in (".ply", ".vtp"))
        self.colors.setEnabled(suffix in (".ply", ".vtp", ".obj") and bool(color))
        self.colors.setText(f"Colour the vertices by: {color.lower()}" if color else "Colour the vertices as in the window")

    def request(self) -> Request:
        """Return what is asked for."""
        return MeshRequest(
            self.step.currentData(), self.format.currentData(), self.attributes.isEnabled() and self.attributes.isChecked(),
            self.colors.isEnabled() and self.colors.isChecked(),
        )  # fmt: skip


class _SizedPage(Page):
    """A page with panes and a size."""

    sizes: Sequence[tuple[str, tuple[int, int]]] = ()
    usual_size = 0
    choices: Sequence[PaneChoice] = ("all", "predicted", "input", "middle")

    def _add_panes_and_size(self) -> None:
        self.panes = self._choice("Panes", [(choice, choice) for choice in self.choices])
        self.size = self._choice("Size", [(size, text) for text, size in self.sizes] + [(None, "Other…")])
        self.size.setCurrentIndex(self.usual_size)
        self.width_box, self.height_box = _pixels("Width"), _pixels("Height")
        sides = QHBoxLayout()
        sides.setContentsMargins(0, 0, 0, 0)
        sides.addWidget(self.width_box, 1)
        sides.addWidget(QLabel("×"))
        sides.addWidget(self.height_box, 1)
        sides.addWidget(QLabel("pixels"))
        self.form.addRow("", sides)
        self.size.currentIndexChanged.connect(lambda _index: self._take_size())
        self._take_size()

    def _take_size(self) -> None:
        size = self.size.currentData()
        for box, side in zip((self.width_box, self.height_box), size or self.chosen_size, strict=True):
            box.setValue(side)
            box.setEnabled(size is None)

    @property
    def chosen_size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.width_box.value(), self.height_box.value()

    def set_offer(self, offer: Offer) -> None:
        """Fit the choices to what is there."""
        super().set_offer(offer)
        first, middle, last = offer.pane_names
        names: dict[PaneChoice, str] = {
            "all": "All three", "input": first, "middle": middle, "predicted": last, "outer": f"{first} and {last}",
        }  # fmt: skip
        for index, choice in enumerate(self.choices):
            self.panes.setItemText(index, names[choice])

    def _wish(self, **more: Any) -> PictureWish:
        width, height = self.chosen_size
        return PictureWish(panes=self.panes.currentData(), width=width, height=height, **more)


class PicturePage(_SizedPage):
    """A picture of the panes."""

    title = "Picture"
    sizes = (
        ("As on the screen", (1200, 500)),
        ("Full HD", (1920, 1080)),
        ("4K", (3840, 2160)),
        ("8K", (7680, 4320)),
        ("Wide, for a page", (2400, 1000)),
    )
    usual_size = 4

    def __init__(self) -> None:
        super().__init__("The meshes as the window shows them now: same view, same colours, any size.")
        self._add_panes_and_size()
        self.format = self._choice("Format", _PICTURE_FORMATS)
        self.ground = self._choice("Ground", (("theme", "As in the window"), ("white", "White"), ("none", "Transparent")))
        self.titles = self._tick("Write what the panes show", on=True)
        self.scale = self._tick("Explain the colours", on=True)
        self.changed.connect(self._update)

    def set_offer(self, offer: Offer) -> None:
        """Fit the choices to what is there."""
        super().set_offer(offer)
        self.size.setItemData(0, offer.screen_size)
        self._take_size()
        self._update()

    def _update(self) -> None:
        self.reason = ""
        if self.format.currentData() == ".jpg" and self.ground.currentData() == "none":
            self.reason = "JPEG cannot be transparent. Choose PNG, or another ground."
        self.scale.setEnabled(bool(self.offer.color_name))

    def request(self) -> Request:
        """Return what is asked for."""
        ground = self.ground.currentData()
        wish = self._wish(
            is_transparent=ground == "none", has_titles=self.titles.isChecked(), has_scale=self.scale.isChecked(),
            has_white_ground=ground == "white",
        )  # fmt: skip
        return PictureRequest(wish, self.format.currentData())


class AnimationPage(_SizedPage):
    """An animation of the steps, or a turntable."""

    title = "Animation"
    sizes = (
        ("Small", (800, 450)),
        ("Medium", (1280, 720)),
        ("Full HD", (1920, 1080)),
        ("Square", (720, 720)),
    )
    choices = ("outer", "all", "predicted", "input", "middle")

    def __init__(self) -> None:
        super().__init__("All steps of the run one after the other, or the meshes turning once around.")
        self.kind = self._choice("Show", ((False, "The steps of the run"), (True, "A full turn of the shown step")))
        self._add_panes_and_size()
        self.format = self._choice("Format", ((".gif", "GIF – plays everywhere"), (".mp4", "MP4 – smaller and finer")))
        self.seconds = QDoubleSpinBox()
        self.seconds.setRange(0.5, 120.0)
        self.seconds.setDecimals(1)
        self.seconds.setSuffix(" s")
        self.seconds.setAccessibleName("Length")
        self.form.addRow("Length", self.seconds)
        self.fps = QSpinBox()
        self.fps.setRange(1, 60)
        self.fps.setValue(15)
        self.fps.setSuffix(" frames per second")
        self.fps.setAccessibleName("Frames per second")
        self.form.addRow("Speed", self.fps)
        self.turn = QSpinBox()
        self.turn.setRange(-720, 720)
        self.turn.setSingleStep(45)
        self.turn.setSuffix("°")
        self.turn.setAccessibleName("Turn meanwhile")
        self.turn.setToolTip("<p>By how much the meshes turn while the steps go by.</p>")
        self.form.addRow("Turn meanwhile", self.turn)
        self._note = QLabel()
        self._note.setWordWrap(True)
        self.form.addRow("", self._note)
        for box in (self.seconds, self.fps, self.turn):
            box.valueChanged.connect(lambda _value: self.changed.emit())
        self.kind.currentIndexChanged.connect(lambda _index: self._take_length())
        self.changed.connect(self._update)

    def set_offer(self, offer: Offer) -> None:
        """Fit the choices to what is there."""
        had_steps = len(self.offer.steps)
        super().set_offer(offer)
        if len(offer.steps) != had_steps:
            self._take_length()
        self._update()

    def _take_length(self) -> None:
        """Propose a length that suits what is shown."""
        turns = bool(self.kind.currentData())
        self.seconds.setValue(6.0 if turns else min(20.0, max(2.0, len(self.offer.steps) / 8)))

    def _update(self) -> None:
        offer, turns = self.offer, bool(self.kind.currentData())
        self.turn.setEnabled(not turns)
        self.reason = ""
        if not turns and len(offer.steps) < 2:
            self.reason = "There are no steps to animate yet. Start a training, or open a run."
        elif self.format.currentData() == ".mp4" and offer.no_mp4:
            self.reason = offer.no_mp4
        frames = max(2, round(self.seconds.value() * self.fps.value()))
        self._note.setText(f"{frames:,} frames" + ("" if turns else f" of {len(offer.steps):,} steps"))

    def request(self) -> Request:
        """Return what is asked for."""
        turns = bool(self.kind.currentData())
        plan = Plan(
            turns, self.offer.shown_step or 0, turn=360.0 if turns else float(self.turn.value()), seconds=self.seconds.value(),
            frames_per_second=float(self.fps.value()),
        )  # fmt: skip
        wish = self._wish()
        if self.format.currentData() == ".mp4":
            # Video is coded in blocks of two by two pixels.
            wish = PictureWish(panes=wish.panes, width=wish.width - wish.width % 2, height=wish.height - wish.height % 2)
        return AnimationRequest(wish, plan, self.format.currentData())


class CurvePage(Page):
    """The training curve."""

    title = "Curve"

    def __init__(self) -> None:
        super().__init__("The training curve: all numbers as a table, or a chart of what the window draws.")
        self.format = self._choice("Format", _CURVE_FORMATS)

    def set_offer(self, offer: Offer) -> None:
        """Fit the choices to what is there."""
        super().set_offer(offer)
        self.reason = "" if offer.has_curve else "There is no curve yet. Start a training, or open a run."

    def request(self) -> Request:
        """Return what is asked for."""
        return CurveRequest(self.format.currentData())


class ReportPage(Page):
    """A report to send to a colleague."""

    title = "Report"

    def __init__(self) -> None:
        super().__init__(
            "One page to send to a colleague or to print: pictures, numbers, what is odd about the mesh, settings, curve. "
            "One HTML file that needs nothing else and no network."
        )
        self.step = self._choice("Step", ())

    def set_offer(self, offer: Offer) -> None:
        """Fit the choices to what is there."""
        super().set_offer(offer)
        _fill_steps(self.step, offer)
        self.reason = "" if offer.shown_step is not None else _NO_STEP

    def request(self) -> Request:
        """Return what is asked for."""
        return ReportRequest(self.step.currentData())


def _pixels(name: str) -> QSpinBox:
    box = QSpinBox()
    box.setRange(SMALLEST_SIDE, LARGEST_SIDE)
    box.setAccessibleName(name)
    box.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    return box


assert set(_SizedPage.choices) | set(AnimationPage.choices) <= set(PANES_OF)
