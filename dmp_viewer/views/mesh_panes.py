"""Input, smoothed and predicted mesh side by side, with their titles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from qtpy.QtCore import QPoint, QPointF, QRect, Signal
from qtpy.QtGui import QColor, QPalette
from qtpy.QtWidgets import QFrame, QGridLayout, QWidget
from vtkmodules.vtkCommonCore import vtkLookupTable
from vtkmodules.vtkRenderingCore import vtkCellPicker

from dmp.exports.viewpoints import Viewpoint
from dmp.mesh import FloatArray, IntArray
from dmp_viewer.colors import ColorTable, Limits, UpAxis, Values
from dmp_viewer.theme import Theme, rgb
from dmp_viewer.views import camera
from dmp_viewer.views.cut_handle import CutHandle
from dmp_viewer.views.interactor import N_PANES, Interactor
from dmp_viewer.views.outlines import Outline, dashed, whole
from dmp_viewer.views.pane import CUT_CIRCLE, CUT_LINE, CUT_NONE, Pane, cells_of
from dmp_viewer.views.pane_title import PaneTitle
from dmp_viewer.views.point_mark import PointMark
from dmp_viewer.views.sides import Side, stand_at

INPUT, SMOOTHED, PREDICTED = range(N_PANES)
MIDDLE = SMOOTHED
# What the prediction is compared with in its own pane: a fourth mesh in the third pane.
COMPARED = N_PANES
PANE_NAMES = ("Input", "Smoothed", "Predicted")
_CUTS = {"off": CUT_NONE, "swipe": CUT_LINE, "lens": CUT_CIRCLE}


class MeshPanes(QWidget):
    """Three panes with linked cameras.

    Signals:
        painted: after each paint of the 3-D view.
        vertexClicked: index of the vertex nearest to a click on a mesh; None for a click beside it.
    """

    painted = Signal()
    vertexClicked = Signal(object)

    def __init__(self, parent: QWidget | None = None, *, multi_samples: int = 0) -> None:
        super().__init__(parent)
        self.titles = tuple(PaneTitle(self) for _ in range(N_PANES))
        self.interactor = Interactor(self, multi_samples=multi_samples)
        self.interactor.setAccessibleName("Meshes: input, smoothed, predicted")
        self.interactor.painted.connect(lambda _drawn: self.painted.emit())
        self.interactor.clicked.connect(self._on_clicked)
        self.interactor.hovered.connect(self._on_hovered)
        self.interactor.setMinimumHeight(140)
        self._lines = [QFrame(self.interactor) for _ in range(N_PANES - 1)]
        self.handle = CutHandle(self.interactor)
        self.handle.moved.connect(self._apply_cut)
        self.interactor.resized.connect(self._on_resized)
        layout = QGridLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        for column, title in enumerate(self.titles):
            layout.addWidget(title, 0, column)
            layout.setColumnStretch(column, 1)
        layout.addWidget(self.interactor, 1, 0, 1, N_PANES)
        layout.setRowStretch(1, 1)
        self._panes: list[Pane] = []
        self._has_positions = [False] * (N_PANES + 1)
        self._flipped = False
        self._marked_vertex: int | None = None
        self._marked_in_input = True
        self._table = vtkLookupTable()
        self._table.SetNumberOfTableValues(256)
        self._centre = np.zeros(3)
        self._scale = 1.0
        self._theme: Theme | None = None
        self._fitted_state: tuple[tuple[float, ...], ...] = ()
        self._up: UpAxis = "y"
        self._linked = True
        self._orthographic = False
        self._edges = False
        self._make_outlines()
        self._marks = [PointMark(renderer) for renderer in self.interactor.renderers]
        self.interactor.link_views()

    # -- what is shown ------------------------------------------------------------------------------------------------

    def set_mesh(self, vertices: FloatArray, faces: IntArray, input_faces: IntArray | None = None) -> None:
        """Make the actors for another mesh; all panes are empty until they get positions.

        Args:
            vertices: input positions, (V, 3); they say where the mesh lies and how large it is.
            faces: (F, 3).
            input_faces: (n, 3), when the input pane shows fewer, because its holes are still open.
        """
        renderers = self.interactor.renderers
        for index, pane in enumerate(self._panes):
            renderers[min(index, PREDICTED)].RemoveActor(pane.actor)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        # VTK draws in single precision: around the origin and about 1 large, any mesh keeps its shape.
        self._centre = (low + high) / 2
        self._scale = 1.0 / max(float(np.linalg.norm(high - low)) / 2, 1e-300)
        cells = cells_of(faces)
        input_cells = cells if input_faces is None or len(input_faces) == len(faces) else cells_of(input_faces)
        self._panes = [Pane(own, len(vertices), self._table) for own in (input_cells, cells, cells)]
        self._panes.append(Pane(input_cells, len(vertices), self._table, is_inner=True))
        self._has_positions = [False] * (N_PANES + 1)
        for index, pane in enumerate(self._panes):
            renderers[min(index, PREDICTED)].AddActor(pane.actor)
        self._apply_edges()
        self._apply_mesh_colors()
        self._apply_cut()
        for outline in self.outlines.values():
            outline.set_visible(False)
        self._marked_vertex = None
        self._apply_marks()
        self.interactor.mark()

    def set_positions(self, index: int, positions: FloatArray | None) -> None:
        """Show positions, (V, 3) in file units, in a pane; None empties it."""
        self._has_positions[index] = positions is not None
        if positions is not None:
            self._panes[index].set_positions((positions - self._centre) * self._scale)
        self._apply_visibility()
        self._mark(index)

    def set_values(self, index: int, values: Values | None) -> None:
        """Colour a pane by values, (V,); None shows the bare surface."""
        self._panes[index].set_values(values)
        self._mark(index)

    def set_colors(self, index: int, colors: NDArray[np.uint8]) -> None:
        """Give each vertex of a pane a colour of its own, (V, 3)."""
        self._panes[index].set_colors(colors)
        self._mark(index)

    def set_normals(self, index: int, normals: FloatArray | None) -> None:
        """Shade a pane smoothly with unit normals, (V, 3); None shades each face by itself."""
        self._panes[index].set_normals(normals)
        self._mark(index)

    def set_compared_faces(self, *, as_input: bool) -> None:
        """Say whether what the prediction is compared with has the faces of the input or those of the prediction."""
        self._panes[COMPARED].data.SetPolys(self._panes[INPUT if as_input else PREDICTED].data.GetPolys())

    def set_cut(self, mode: str, *, flipped: bool) -> None:
        """Show in the predicted pane what it is compared with: at the left of a line, in a lens, or all of it.

        Args:
            mode: ``off``, ``swipe`` or ``lens``.
            flipped: show nothing else.
        """
        self._flipped = flipped
        self.handle.set_mode(CUT_NONE if flipped else _CUTS[mode])
        self._apply_cut()
        self._apply_marks()

    def set_color_table(self, table: ColorTable) -> None:
        """Use another colour map, (256, 4) RGBA."""
        for index, (red, green, blue, alpha) in enumerate(table / 255.0):
            self._table.SetTableValue(index, red, green, blue, alpha)
        self._table.Modified()
        self.interactor.mark()

    def set_limits(self, limits: Limits) -> None:
        """Use another range of values, the same in all panes."""
        if self._table.GetTableRange() != (limits.low, limits.high):
            self._table.SetTableRange(limits.low, limits.high)
            self._table.Modified()
            self.interactor.mark()

    def set_title(self, index: int, title: str, facts: Sequence[str], details: str = "") -> None:
        """Say above a pane what it shows, the most important facts first; details are in its tool tip."""
        self.titles[index].set_texts(title, facts, details)

    def set_marked_vertex(self, index: int | None, *, in_input: bool = True) -> None:
        """Mark a vertex in all panes, or in all but that of the input; None marks nothing."""
        if (index, in_input) != (self._marked_vertex, self._marked_in_input):
            self._marked_vertex, self._marked_in_input = index, in_input
            self._apply_marks()
            self.interactor.mark()

    @property
    def marked_panes(self) -> list[int]:
        """The panes in which a vertex is marked."""
        return [index for index, mark in enumerate(self._marks) if mark.is_visible]

    # -- lines on the meshes ------------------------------------------------------------------------------------------

    def set_holes(
        self, vertices: FloatArray, chosen: Sequence[IntArray], others: Sequence[IntArray], pointed: Sequence[IntArray]
    ) -> None:
        """Draw the rims of holes in the input pane.

        Args:
            vertices: positions of the mesh with the holes, (V, 3), file units.
            chosen: edges, each (n, 2), of the holes that are to be filled: full lines.
            others: likewise of those that stay open: dashed lines.
            pointed: likewise of the one that is looked at: a wide line around the other.
        """
        placed = (vertices - self._centre) * self._scale
        for name, segments in (("chosen", whole(placed, chosen)), ("open", dashed(placed, others)),
                               ("pointed", whole(placed, pointed))):  # fmt: skip
            self.outlines[name].set_segments(segments.astype(np.float32))
        self.interactor.mark([INPUT])

    def set_seam(self, edges: IntArray) -> None:
        """Draw edges, (n, 2), of the predicted mesh that part what was inserted from what was there."""
        if self._panes:
            self.outlines["seam"].set_edges(self._panes[PREDICTED].points, edges)
            self._apply_visibility()
            self.interactor.mark([PREDICTED])

    def _make_outlines(self) -> None:
        renderers = self.interactor.renderers
        self.outlines = {
            "pointed": Outline(renderers[INPUT], 11.0, 3.0),
            "open": Outline(renderers[INPUT], 2.0, 2.0, layer=2),
            "chosen": Outline(renderers[INPUT], 3.5, 2.5, layer=2),
            "seam": Outline(renderers[PREDICTED], 2.0, 1.5),
        }

    # -- how it is looked at ------------------------------------------------------------------------------------------

    def reset_view(self) -> None:
        """Look at the whole mesh from the front, a little from above and from the right, in all panes."""
        for renderer in self.interactor.renderers:
            camera.stand_in_front(renderer.GetActiveCamera(), self._up)
        self.fit_view()

    def look_from(self, side: Side) -> None:
        """Look at the whole mesh straight from a side, in all panes."""
        for renderer in self.interactor.renderers:
            stand_at(renderer.GetActiveCamera(), side, self._up)
        self.fit_view()

    def set_up(self, axis: UpAxis) -> None:
        """Let another axis point up, and look from the front again."""
        if axis != self._up:
            self._up = axis
            self.reset_view()

    def set_orthographic(self, orthographic: bool) -> None:
        """Draw without perspective, or with it; what is looked at keeps its place and size."""
        if orthographic == self._orthographic:
            return
        self._orthographic = orthographic
        was_fitted = self._is_as_fitted()
        for item in self._cameras():
            camera.set_orthographic(item, orthographic)
        for renderer in self.interactor.renderers:
            _never_clip(renderer)
        if was_fitted:
            self.fit_view()
        self.interactor.mark()

    def fit_view(self) -> None:
        """Bring the whole mesh into all panes without turning it."""
        visible = [pane.coordinates for pane, there in zip(self._panes, self._has_positions, strict=False) if there]
        for renderer in self.interactor.renderers:
            if visible:
                width, height = max(1, self.interactor.width() / N_PANES), max(1, self.interactor.height())
                camera.fit(renderer.GetActiveCamera(), visible[0], width / height)
            _never_clip(renderer)
        height = camera.half_height(self.interactor.renderers[0].GetActiveCamera())
        self._fitted_state = (*self.camera_state(), (height,))
        self.interactor.mark()

    def look_at(self, centre: FloatArray, direction: FloatArray | None, size: float) -> None:
        """Turn to a place on the mesh and come near; all panes do when they are linked, otherwise the input pane.

        Args:
            centre: what to look at, (3,), file units.
            direction: from where, (3,) of length 1; None keeps the direction.
            size: of what is there, file units.
        """
        renderers = list(self.interactor.renderers)
        place = (centre - self._centre) * self._scale
        for renderer in renderers[:1] if not self._linked else renderers:
            camera.come_near(renderer.GetActiveCamera(), place, direction, size * self._scale, self._up)
            _never_clip(renderer)
        self.interactor.mark()

    def set_linked(self, linked: bool) -> None:
        """Turn all panes together, or each by itself."""
        if linked == self._linked:
            return
        self._linked = linked
        if linked:
            self.interactor.link_views()
        else:
            # unlink_views() would give each pane a camera that looks from elsewhere; each keeps the present view instead.
            for renderer in list(self.interactor.renderers)[1:]:
                own = renderer.GetActiveCamera().NewInstance()
                own.DeepCopy(renderer.GetActiveCamera())
                renderer.SetActiveCamera(own)
        self.interactor.mark()

    def set_edges(self, edges: bool) -> None:
        """Draw the edges of the triangles, or not."""
        self._edges = edges
        self._apply_edges()
        self.interactor.mark()

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._theme = theme
        for renderer in self.interactor.renderers:
            renderer.SetBackground(*rgb(theme.view_bottom))
            renderer.SetBackground2(*rgb(theme.view_top))
            renderer.GradientBackgroundOn()
        for title in self.titles:
            title.set_subtle_color(theme.subtle)
        for line in self._lines:
            palette = line.palette()
            palette.setColor(QPalette.ColorRole.Window, QColor(theme.line))
            line.setPalette(palette)
            line.setAutoFillBackground(True)
        self.handle.set_theme(theme)
        # Where there is no value, as at a rim for the curvature, the surface is bare.
        self._table.SetNanColor(*rgb(theme.mesh), 1.0)
        self._table.Modified()
        self._apply_mesh_colors()
        for name, color in (("chosen", theme.hole), ("seam", theme.hole), ("open", theme.text), ("pointed", theme.pointed)):
            self.outlines[name].set_colors(rgb(color), rgb(theme.halo))
        for mark in self._marks:
            mark.set_colors(rgb(theme.hole), rgb(theme.halo))
        self.interactor.mark()

    def camera_state(self) -> tuple[tuple[float, ...], ...]:
        """Return position, focal point and up direction of the first pane's camera."""
        first = self.interactor.renderers[0].GetActiveCamera()
        return first.GetPosition(), first.GetFocalPoint(), first.GetViewUp()

    def _is_as_fitted(self) -> bool:
        """Tell whether nobody has turned, moved or zoomed the view since it was fitted."""
        height = camera.half_height(self.interactor.renderers[0].GetActiveCamera())
        return bool(self._panes) and (*self.camera_state(), (height,)) == self._fitted_state

    def viewpoints(self) -> tuple[Viewpoint, ...]:
        """Return from where each pane is seen, in units of the view."""
        return tuple(camera.viewpoint_of(renderer.GetActiveCamera()) for renderer in self.interactor.renderers)

    def _cameras(self) -> list[Any]:
        """Return the cameras, each once: linked panes share one."""
        found: list[Any] = []
        for renderer in self.interactor.renderers:
            if renderer.GetActiveCamera() not in found:
                found.append(renderer.GetActiveCamera())
        return found

    @property
    def pane_aspect(self) -> float:
        """Width of a pane divided by its height."""
        return max(1, self.interactor.width()) / N_PANES / max(1, self.interactor.height())

    def cut_share(self) -> tuple[float, float, float]:
        """Return where the cut is: x and y as shares of the predicted pane, and the radius in heights of the pane."""
        area, centre = self._pane_area(), self.handle.centre
        height = max(1, area.height())
        return (centre.x() - area.left()) / max(1, area.width()), centre.y() / height, self.handle.radius / height

    def shut_down(self) -> None:
        """Give the OpenGL resources back while their context is still alive."""
        self.interactor.close()

    # -- mouse --------------------------------------------------------------------------------------------------------

    def vertex_at(self, place: QPoint) -> int | None:
        """Return the vertex nearest to what is seen at a place of the 3-D view, or None beside the meshes."""
        index = min(max(N_PANES * place.x() // max(1, self.interactor.width()), 0), N_PANES - 1)
        if not self._panes:
            return None
        pane = self._panes[index]
        if index == PREDICTED and self._is_compared_at(place):
            pane = self._panes[COMPARED]
        if not pane.is_visible:
            return None
        picker = vtkCellPicker()
        picker.SetTolerance(0.0)
        picker.PickFromListOn()
        picker.AddPickList(pane.actor)
        x, y = self._buffer_place(QPointF(place))
        if not picker.Pick(x, y, 0.0, self.interactor.renderers[index]) or picker.GetCellId() < 0:
            return None
        corners = pane.data.GetCell(picker.GetCellId()).GetPointIds()
        indices = [corners.GetId(k) for k in range(3)]
        distances = np.linalg.norm(pane.coordinates[indices] - np.array(picker.GetPickPosition()), axis=1)
        return indices[int(np.argmin(distances))]

    def _is_compared_at(self, place: QPoint) -> bool:
        offset = QPointF(place) - self.handle.centre
        match self.handle.mode:
            case _ if self._flipped:
                return True
            case mode if mode == CUT_LINE:
                return offset.x() < 0
            case mode if mode == CUT_CIRCLE:
                return float(np.hypot(offset.x(), offset.y())) < self.handle.radius
        return False

    def _on_clicked(self, place: QPoint) -> None:
        if self._panes:
            self.vertexClicked.emit(self.vertex_at(place))

    def _on_hovered(self, place: QPoint) -> None:
        if self.handle.mode == CUT_CIRCLE and self._pane_area().contains(place):
            self.handle.move_to(QPointF(place))

    # -- helpers ------------------------------------------------------------------------------------------------------

    def _on_resized(self) -> None:
        for number, line in enumerate(self._lines, start=1):
            line.setGeometry(round(self.interactor.width() * number / N_PANES), 0, 1, self.interactor.height())
        drawn: list[PointMark | Outline] = [*self._marks, *self.outlines.values()]
        for mark in drawn:
            mark.set_ratio(self.interactor.devicePixelRatioF())
        self.handle.set_area(self._pane_area())
        self._apply_cut()
        # A view that nobody has turned since it was fitted stays fitted.
        if self._is_as_fitted():
            self.fit_view()

    def _pane_area(self) -> QRect:
        left = round(self.interactor.width() * PREDICTED / N_PANES)
        return QRect(left, 0, self.interactor.width() - left, self.interactor.height())

    def _buffer_place(self, place: QPointF) -> tuple[float, float]:
        """Return a place of the widget in pixels of the frame buffer, from its lower left corner."""
        ratio = self.interactor.devicePixelRatioF()
        return place.x() * ratio, (self.interactor.height() - place.y()) * ratio

    def _apply_cut(self) -> None:
        if not self._panes:
            return
        x, y = self._buffer_place(self.handle.centre)
        for index in (PREDICTED, COMPARED):
            self._panes[index].cut(self.handle.mode, x, y, self.handle.radius * self.interactor.devicePixelRatioF())
        self.interactor.mark([PREDICTED])

    def _apply_visibility(self) -> None:
        if not self._panes:
            return
        compared = self._has_positions[COMPARED] and (self._flipped or self.handle.mode != CUT_NONE)
        alone = compared and self._flipped
        for index, pane in enumerate(self._panes[:N_PANES]):
            pane.actor.SetVisibility(self._has_positions[index] and not (index == PREDICTED and alone))
            self._marks[index].set_visible(self._has_positions[index] and (index != INPUT or self._marked_in_input))
        self._panes[COMPARED].actor.SetVisibility(compared)
        self.outlines["seam"].set_visible(self._has_positions[PREDICTED] and not alone)

    def _apply_marks(self) -> None:
        shown = [*self._panes[:PREDICTED], self._panes[COMPARED if self._flipped else PREDICTED]] if self._panes else []
        for pane, mark in zip(shown, self._marks, strict=False):
            mark.set_vertex(pane.points, self._marked_vertex)
        self._apply_visibility()

    def _mark(self, index: int) -> None:
        self.interactor.mark([min(index, PREDICTED)])

    def _apply_edges(self) -> None:
        for pane in self._panes:
            pane.actor.GetProperty().SetEdgeVisibility(self._edges)

    def _apply_mesh_colors(self) -> None:
        if self._theme is not None:
            for pane in self._panes:
                pane.actor.GetProperty().SetColor(*rgb(self._theme.mesh))
                pane.actor.GetProperty().SetEdgeColor(*rgb(self._theme.mesh_edges))


def _never_clip(renderer: object) -> None:
    """Make the view deep enough for every snapshot, so that none is cut when the mesh changes under a resting camera."""
    renderer.ResetCameraClippingRange(-2, 2, -2, 2, -2, 2)  # type: ignore[attr-defined]
