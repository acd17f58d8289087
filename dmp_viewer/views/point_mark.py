"""Dots with a rim, and the mark at a picked vertex: one such dot, which moves with the mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkRenderer


class RimmedDots:
    """Dots with a rim in one pane, which are drawn on top of what lies behind them.

    Args:
        renderer: of the pane to draw in.
        size: pixels.
        rim: how much wider the rim is, pixels.
        pull: how far the dots are pulled towards the eye, in units of the depth buffer.
    """

    def __init__(self, renderer: vtkRenderer, size: float, rim: float, pull: float) -> None:
        self._data = vtkPolyData()
        self._sizes = (size + rim, size)
        self._actors: list[vtkActor] = []
        # Pulled towards the eye by the depth buffer only; the rim less, so that the dot lies on top of it.
        for width, offset in ((size + rim, 8.0 - pull), (size, -pull)):
            mapper = vtkPolyDataMapper()
            mapper.SetInputData(self._data)
            mapper.ScalarVisibilityOff()
            mapper.SetResolveCoincidentTopologyToPolygonOffset()
            mapper.SetRelativeCoincidentTopologyPointOffsetParameter(offset)
            actor = vtkActor()
            actor.SetMapper(mapper)
            actor.GetProperty().SetPointSize(width)
            actor.GetProperty().RenderPointsAsSpheresOn()
            actor.GetProperty().LightingOff()
            actor.SetVisibility(False)
            actor.PickableOff()
            renderer.AddActor(actor)
            self._actors.append(actor)

    def set_points(self, points: vtkPoints | None, cells: vtkCellArray | None) -> None:
        """Draw the ``cells`` of some points, which may move later; None draws nothing."""
        self._data.Initialize()
        if points is not None and cells is not None:
            self._data.SetPoints(points)
            self._data.SetVerts(cells)
        self._data.Modified()
        self.set_visible(True)

    @property
    def count(self) -> int:
        """Number of dots that are drawn now."""
        return int(self._data.GetNumberOfVerts()) if self.is_visible else 0

    @property
    def places(self) -> NDArray[np.float32]:
        """The points, (n, 3), in the units of the view."""
        return np.array([self._data.GetPoint(index) for index in range(self._data.GetNumberOfPoints())], dtype=np.float32)

    def set_ratio(self, ratio: float) -> None:
        """Draw it for a screen with so many device pixels for each pixel."""
        for actor, size in zip(self._actors, self._sizes, strict=True):
            actor.GetProperty().SetPointSize(size * ratio)

    @property
    def is_visible(self) -> bool:
        """Whether it is drawn."""
        return bool(self._actors[-1].GetVisibility())

    def set_visible(self, visible: bool) -> None:
        """Draw it, or not."""
        for actor in self._actors:
            actor.SetVisibility(visible and self._data.GetNumberOfVerts() > 0)

    def set_colors(self, dot: tuple[float, float, float], rim: tuple[float, float, float]) -> None:
        """Take colours, three numbers from 0 to 1 each."""
        self._actors[0].GetProperty().SetColor(*rim)
        self._actors[-1].GetProperty().SetColor(*dot)


class PointMark(RimmedDots):
    """A dot in one pane.

    Args:
        renderer: of the pane to draw in.
        size: pixels.
        rim: how much wider the rim is, pixels.
    """

    def __init__(self, renderer: vtkRenderer, size: float = 9.0, rim: float = 5.0) -> None:
        super().__init__(renderer, size, rim, pull=48.0)

    def set_vertex(self, points: vtkPoints | None, index: int | None) -> None:
        """Mark one of some points, which may move later; None marks nothing."""
        cells: vtkCellArray | None = None
        if index is not None:
            cells = vtkCellArray()
            cells.InsertNextCell(1)
            cells.InsertCellPoint(index)
        self.set_points(points, cells)
