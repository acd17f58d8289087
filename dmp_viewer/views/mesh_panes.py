"""Input, smoothed and predicted mesh side by side, with their titles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from qtpy.QtCore import Qt, Signal
from qtpy.QtGui import QColor, QFont, QFontMetrics, QPalette, QResizeEvent
from qtpy.QtWidgets import QFrame, QGridLayout, QLabel, QSizePolicy, QVBoxLayout, QWidget
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkLookupTable, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

from dmp.mesh import FloatArray, IntArray
from dmp_viewer.colors import ColorTable, Limits, UpAxis, Values
from dmp_viewer.theme import Theme, rgb
from dmp_viewer.views.interactor import N_PANES, Interactor
from dmp_viewer.views.outlines import Outline, dashed, whole

INPUT, SMOOTHED, PREDICTED = range(N_PANES)
PANE_NAMES = ("Input", "Smoothed", "Predicted")
# Where the camera stands at first, for each axis that can point up: in front, a little to the right and above.
_FRONT = {"y": (0.45, 0.35, 1.0), "z": (0.75, -0.8, 0.4)}
_UP = {"y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_VIEW_ANGLE = 30.0
_MARGIN = 1.06
_SEPARATOR = "  ·  "
# A hole that is looked at takes this share of the height of its pane, and the camera comes no nearer than this.
_HOLE_SHARE = 0.36
_NEAREST = 0.01


@dataclass(eq=False)
class _Pane:
    """One mesh on the screen: made once, its arrays written in place."""

    points: vtkPoints
    coordinates: NDArray[np.float32]
    values: NDArray[np.float32]
    data: vtkPolyData
    mapper: vtkPolyDataMapper
    actor: vtkActor

    @classmethod
    def make(cls, cells: vtkCellArray, n_vertices: int, table: vtkLookupTable) -> _Pane:
        coordinates = np.zeros((n_vertices, 3), dtype=np.float32)
        values = np.zeros(n_vertices, dtype=np.float32)
        points = vtkPoints()
        points.SetData(numpy_to_vtk(coordinates))
        data = vtkPolyData()
        data.SetPoints(points)
        data.SetPolys(cells)
        data.GetPointData().SetScalars(numpy_to_vtk(values))
        mapper = vtkPolyDataMapper()
        mapper.SetInputData(data)
        mapper.SetLookupTable(table)
        mapper.UseLookupTableScalarRangeOn()
        # Colours are looked up for each pixel, not mixed between vertices: mixing leaves the colour map.
        mapper.InterpolateScalarsBeforeMappingOn()
        mapper.ScalarVisibilityOff()
        actor = vtkActor()
        actor.SetMapper(mapper)
        shading = actor.GetProperty()
        # Flat shading shows noise as it is, and needs no normals that would be stale after each snapshot.
        shading.SetInterpolationToFlat()
        shading.SetAmbient(0.18)
        shading.SetDiffuse(0.88)
        shading.SetSpecular(0.08)
        shading.SetSpecularPower(20)
        # On fine meshes full lines would cover the surface.
        shading.SetEdgeOpacity(0.5)
        return cls(points, coordinates, values, data, mapper, actor)


class PaneTitle(QWidget):
    """Name of a pane in bold, facts about it in a quieter line below."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._title = QLabel(self)
        self._facts = QLabel(self)
        font = QFont(self._title.font())
        font.setBold(True)
        self._title.setFont(font)
        for label in (self._title, self._facts):
            label.setAlignment(Qt.AlignmentFlag.AlignHCenter)
            label.setTextFormat(Qt.TextFormat.PlainText)
            label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(8, 5, 8, 5)
        layout.setSpacing(1)
        layout.addWidget(self._title)
        layout.addWidget(self._facts)
        self._all_facts: tuple[str, ...] = ()

    def set_texts(self, title: str, facts: Sequence[str], details: str = "") -> None:
        """Say what the pane shows; details are in the tool tip.

        Args:
            title: name of the pane.
            facts: the most important first. Those that do not fit any more are left out.
            details: what the tool tip says, by default all the facts.
        """
        self._title.setText(title)
        self._all_facts = tuple(facts)
        self.setToolTip(details or _SEPARATOR.join(facts))
        self._elide()

    @property
    def texts(self) -> tuple[str, str]:
        """Title and facts."""
        return self._title.text(), _SEPARATOR.join(self._all_facts)

    def set_subtle_color(self, color: str) -> None:
        """Colour the line of facts."""
        palette = self._facts.palette()
        palette.setColor(self._facts.foregroundRole(), color)
        self._facts.setPalette(palette)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Cut the facts to the new width."""
        super().resizeEvent(event)
        self._elide()

    def _elide(self) -> None:
        width = max(20, self.width() - 16)
        metrics = QFontMetrics(self._facts.font())
        count = len(self._all_facts)
        while count > 1 and metrics.horizontalAdvance(_SEPARATOR.join(self._all_facts[:count])) > width:
            count -= 1
        text = _SEPARATOR.join(self._all_facts[:count])
        self._facts.setText(metrics.elidedText(text, Qt.TextElideMode.ElideRight, width))


class MeshPanes(QWidget):
    """Three panes with linked cameras.

    Signals:
        painted: after each paint of the 3-D view.
    """

    painted = Signal()

    def __init__(self, parent: QWidget | None = None, *, multi_samples: int = 0) -> None:
        super().__init__(parent)
        self.titles = tuple(PaneTitle(self) for _ in range(N_PANES))
        self.interactor = Interactor(self, multi_samples=multi_samples)
        self.interactor.setAccessibleName("Meshes: input, smoothed, predicted")
        self.interactor.painted.connect(lambda _drawn: self.painted.emit())
        self.interactor.setMinimumHeight(140)
        self._lines = [QFrame(self.interactor) for _ in range(N_PANES - 1)]
        self.interactor.resized.connect(self._on_resized)
        layout = QGridLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        for column, title in enumerate(self.titles):
            layout.addWidget(title, 0, column)
            layout.setColumnStretch(column, 1)
        layout.addWidget(self.interactor, 1, 0, 1, N_PANES)
        layout.setRowStretch(1, 1)
        self._panes: list[_Pane] = []
        self._visible = [False] * N_PANES
        self._table = vtkLookupTable()
        self._table.SetNumberOfTableValues(256)
        self._centre = np.zeros(3)
        self._scale = 1.0
        self._theme: Theme | None = None
        self._fitted_state: tuple[tuple[float, ...], ...] = ()
        self._up: UpAxis = "y"
        self._linked = True
        self._edges = False
        self._make_outlines()
        self.interactor.link_views()

    # -- what is shown ------------------------------------------------------------------------------------------------

    def set_mesh(self, vertices: FloatArray, faces: IntArray, input_faces: IntArray | None = None) -> None:
        """Make the actors for another mesh; all panes are empty until they get positions.

        Args:
            vertices: input positions, (V, 3); they say where the mesh lies and how large it is.
            faces: (F, 3).
            input_faces: (n, 3), when the input pane shows fewer, because its holes are still open.
        """
        for renderer, pane in zip(self.interactor.renderers, self._panes, strict=False):
            renderer.RemoveActor(pane.actor)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        # VTK draws in single precision: around the origin and about 1 large, any mesh keeps its shape.
        self._centre = (low + high) / 2
        self._scale = 1.0 / max(float(np.linalg.norm(high - low)) / 2, 1e-300)
        cells = _cells(faces)
        input_cells = cells if input_faces is None or len(input_faces) == len(faces) else _cells(input_faces)
        self._panes = [_Pane.make(own, len(vertices), self._table) for own in (input_cells, cells, cells)]
        self._visible = [False] * N_PANES
        for pane in self._panes:
            pane.actor.SetVisibility(False)
        for renderer, pane in zip(self.interactor.renderers, self._panes, strict=True):
            renderer.AddActor(pane.actor)
        self._apply_edges()
        self._apply_mesh_colors()
        for outline in self.outlines.values():
            outline.set_visible(False)
        self.interactor.mark()

    def set_positions(self, index: int, positions: FloatArray | None) -> None:
        """Show positions, (V, 3) in file units, in a pane; None empties it."""
        pane = self._panes[index]
        self._visible[index] = positions is not None
        pane.actor.SetVisibility(positions is not None)
        if positions is not None:
            pane.coordinates[:] = (positions - self._centre) * self._scale
            pane.points.Modified()
            pane.points.GetData().Modified()
        if index == PREDICTED:
            self.outlines["seam"].set_visible(positions is not None)
        self.interactor.mark([index])

    def set_values(self, index: int, values: Values | None) -> None:
        """Colour a pane by values, (V,); None shows the bare surface."""
        pane = self._panes[index]
        pane.mapper.SetScalarVisibility(values is not None)
        if values is not None:
            pane.values[:] = values
            pane.data.GetPointData().GetScalars().Modified()
        self.interactor.mark([index])

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
            self.outlines["seam"].set_visible(self._visible[PREDICTED])
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
            camera = renderer.GetActiveCamera()
            camera.SetFocalPoint(0, 0, 0)
            camera.SetPosition(*_FRONT[self._up])
            camera.SetViewUp(*_UP[self._up])
            camera.SetViewAngle(_VIEW_ANGLE)
        self.fit_view()

    def set_up(self, axis: UpAxis) -> None:
        """Let another axis point up, and look from the front again."""
        if axis != self._up:
            self._up = axis
            self.reset_view()

    def fit_view(self) -> None:
        """Bring the whole mesh into all panes without turning it."""
        visible = [pane.coordinates for pane, shown in zip(self._panes, self._visible, strict=False) if shown]
        for renderer in self.interactor.renderers:
            if visible:
                width, height = max(1, self.interactor.width() / N_PANES), max(1, self.interactor.height())
                _fit_camera(renderer.GetActiveCamera(), visible[0], width / height)
            # Wide enough for every snapshot, so that none is cut when the mesh changes under a resting camera.
            renderer.ResetCameraClippingRange(-2, 2, -2, 2, -2, 2)
        self._fitted_state = self.camera_state()
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
            camera = renderer.GetActiveCamera()
            if direction is None:
                offset = np.array(camera.GetPosition()) - np.array(camera.GetFocalPoint())
                towards = offset / np.linalg.norm(offset)
            else:
                towards = direction
            distance = max(size * self._scale / (2 * _HOLE_SHARE * np.tan(np.radians(_VIEW_ANGLE / 2))), _NEAREST)
            up = np.array(_UP[self._up])
            if abs(up @ towards) > 0.95:
                up = np.roll(up, 1)
            camera.SetFocalPoint(*place)
            camera.SetPosition(*(place + towards * distance))
            camera.SetViewUp(*up)
            camera.SetViewAngle(_VIEW_ANGLE)
            renderer.ResetCameraClippingRange(-2, 2, -2, 2, -2, 2)
        self.interactor.mark()

    def _on_resized(self) -> None:
        self._place_lines()
        # A view that nobody has turned since it was fitted stays fitted.
        if self._panes and self.camera_state() == self._fitted_state:
            self.fit_view()

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
                camera = renderer.GetActiveCamera().NewInstance()
                camera.DeepCopy(renderer.GetActiveCamera())
                renderer.SetActiveCamera(camera)
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
        self._apply_mesh_colors()
        for name, color in (("chosen", theme.hole), ("seam", theme.hole), ("open", theme.text), ("pointed", theme.pointed)):
            self.outlines[name].set_colors(rgb(color), rgb(theme.halo))
        self.interactor.mark()

    def camera_state(self) -> tuple[tuple[float, ...], ...]:
        """Return position, focal point and up direction of the first pane's camera."""
        camera = self.interactor.renderers[0].GetActiveCamera()
        return camera.GetPosition(), camera.GetFocalPoint(), camera.GetViewUp()

    def shut_down(self) -> None:
        """Give the OpenGL resources back while their context is still alive."""
        self.interactor.close()

    def _place_lines(self) -> None:
        for number, line in enumerate(self._lines, start=1):
            line.setGeometry(round(self.interactor.width() * number / N_PANES), 0, 1, self.interactor.height())

    def _apply_edges(self) -> None:
        for pane in self._panes:
            pane.actor.GetProperty().SetEdgeVisibility(self._edges)

    def _apply_mesh_colors(self) -> None:
        if self._theme is not None:
            for pane in self._panes:
                pane.actor.GetProperty().SetColor(*rgb(self._theme.mesh))
                pane.actor.GetProperty().SetEdgeColor(*rgb(self._theme.mesh_edges))


def _cells(faces: IntArray) -> vtkCellArray:
    cells = vtkCellArray()
    cells.SetData(3, numpy_to_vtkIdTypeArray(np.ascontiguousarray(faces, dtype=np.int64).ravel(), deep=True))
    return cells


def _fit_camera(camera: Any, points: NDArray[np.float32], aspect: float) -> None:
    """Move a camera along its line of sight until all points, (V, 3), are in view of a pane ``aspect`` times as wide as high.

    VTK itself fits the surrounding sphere, which leaves wide margins around most shapes.
    """
    backward = np.array(camera.GetPosition()) - np.array(camera.GetFocalPoint())
    backward /= np.linalg.norm(backward)
    right = np.cross(camera.GetViewUp(), backward)
    right /= np.linalg.norm(right)
    up = np.cross(backward, right)
    tangent = np.tan(np.radians(camera.GetViewAngle() / 2.0))
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    distance = 1.0
    # Perspective makes what is near larger, so the middle of the picture is found in a few rounds.
    for _ in range(4):
        across, above, towards = (points - middle) @ right, (points - middle) @ up, (points - middle) @ backward
        distance = float(np.max(towards + _MARGIN * np.maximum(np.abs(above), np.abs(across) / aspect) / tangent))
        x, y = across / (distance - towards), above / (distance - towards)
        middle = middle + distance * ((x.min() + x.max()) / 2 * right + (y.min() + y.max()) / 2 * up)
    camera.SetFocalPoint(*middle)
    camera.SetPosition(*(middle + backward * distance))
    camera.SetViewUp(*up)
