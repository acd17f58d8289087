"""Lines drawn upon a mesh: the rims of holes, and the seam around what was inserted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkRenderer

from dmp.mesh import FloatArray, IntArray

# A dash and the gap behind it are this many pieces of a rim each.
_PIECES = 4
_FEWEST_DASHES, _MOST_DASHES = 10, 120
# Of more loops than this, each edge is drawn by half: even dashes cost too much, and nobody sees them.
_MOST_EVEN = 300


class Outline:
    """A set of line segments with a rim of another colour, so that it stands out from every colour map.

    Args:
        renderer: of the pane to draw in.
        width: pixels.
        halo: how much wider the rim is, pixels.
        layer: outlines of a higher layer lie on top of those of a lower one.
    """

    def __init__(self, renderer: vtkRenderer, width: float, halo: float, layer: int = 1) -> None:
        self._data = vtkPolyData()
        self._widths = (width + halo, width)
        self._actors: list[vtkActor] = []
        # Pulled towards the eye by the depth buffer only; the halo less, so that the line lies on top of it.
        for size, pull in ((width + halo, -16.0 * layer + 8.0), (width, -16.0 * layer)):
            mapper = vtkPolyDataMapper()
            mapper.SetInputData(self._data)
            mapper.ScalarVisibilityOff()
            mapper.SetResolveCoincidentTopologyToPolygonOffset()
            mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, pull)
            actor = vtkActor()
            actor.SetMapper(mapper)
            actor.GetProperty().SetLineWidth(size)
            actor.GetProperty().LightingOff()
            actor.SetVisibility(False)
            actor.PickableOff()
            renderer.AddActor(actor)
            self._actors.append(actor)

    def set_segments(self, segments: NDArray[np.float32]) -> None:
        """Draw segments given by their ends, (n, 2, 3), in the units of the view; none hides the outline."""
        points = vtkPoints()
        points.SetData(numpy_to_vtk(np.ascontiguousarray(segments, dtype=np.float32).reshape(-1, 3), deep=True))
        self.set_edges(points, np.arange(2 * len(segments), dtype=np.int64).reshape(-1, 2))

    def set_edges(self, points: vtkPoints, edges: IntArray) -> None:
        """Draw edges, (n, 2), between points that may move later; none hides the outline."""
        cells = vtkCellArray()
        cells.SetData(2, numpy_to_vtkIdTypeArray(np.ascontiguousarray(edges, dtype=np.int64).ravel(), deep=True))
        self._data.Initialize()
        self._data.SetPoints(points)
        self._data.SetLines(cells)
        self._data.Modified()
        self.set_visible(bool(len(edges)))

    def set_ratio(self, ratio: float) -> None:
        """Draw it for a screen with so many device pixels for each pixel."""
        for actor, width in zip(self._actors, self._widths, strict=True):
            actor.GetProperty().SetLineWidth(width * ratio)

    @property
    def n_segments(self) -> int:
        """Number of segments that are drawn now."""
        return int(self._data.GetNumberOfLines()) if self.is_visible else 0

    @property
    def is_visible(self) -> bool:
        """Whether it is drawn."""
        return bool(self._actors[-1].GetVisibility())

    def set_visible(self, visible: bool) -> None:
        """Draw it, or not."""
        for actor in self._actors:
            actor.SetVisibility(visible and self._data.GetNumberOfLines() > 0)

    def set_colors(self, line: tuple[float, float, float], halo: tuple[float, float, float]) -> None:
        """Take colours, three numbers from 0 to 1 each."""
        self._actors[0].GetProperty().SetColor(*halo)
        self._actors[-1].GetProperty().SetColor(*line)


def whole(vertices: FloatArray, loops: Sequence[IntArray]) -> FloatArray:
    """Return the segments of loops given by their edges, each (n, 2): all segments, (m, 2, 3)."""
    return vertices[np.concatenate(loops)] if loops else np.zeros((0, 2, 3))


def dashed(vertices: FloatArray, loops: Sequence[IntArray]) -> FloatArray:
    """Return the dashes along loops, (m, 2, 3); only loops whose edges follow one another can be dashed evenly."""
    if len(loops) > _MOST_EVEN:
        return _halves(whole(vertices, loops))
    return np.concatenate([_dashes(vertices[loop]) for loop in loops]) if loops else np.zeros((0, 2, 3))


def _halves(segments: FloatArray) -> FloatArray:
    return np.stack([segments[:, 0], segments.mean(axis=1)], axis=1)


def _dashes(segments: FloatArray) -> FloatArray:
    if not np.array_equal(segments[:, 1], np.roll(segments[:, 0], -1, axis=0)):
        return _halves(segments)
    corners = np.concatenate([segments[:, 0], segments[:1, 0]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    count = int(np.clip(len(segments), _FEWEST_DASHES, _MOST_DASHES))
    places = np.linspace(0.0, along[-1], 2 * _PIECES * count + 1)
    points = np.column_stack([np.interp(places, along, corners[:, axis]) for axis in range(3)])
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    return pieces[(np.arange(len(pieces)) // _PIECES) % 2 == 0]
