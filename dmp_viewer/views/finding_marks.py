"""Marks on the input mesh where something is odd: dots at vertices and lines along edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray

from dmp.mesh import FloatArray, IntArray
from dmp_viewer.theme import Theme, rgb
from dmp_viewer.views.mesh_panes import INPUT, MeshPanes
from dmp_viewer.views.outlines import Outline
from dmp_viewer.views.point_mark import RimmedDots


class FindingMarks:
    """Draws in the input pane, on top of the outlines of holes.

    Args:
        panes: whose input pane it is.
    """

    def __init__(self, panes: MeshPanes) -> None:
        self._panes = panes
        renderer = panes.interactor.renderers[INPUT]
        self._outline = Outline(renderer, 4.0, 3.0, layer=3)
        self._dots = RimmedDots(renderer, 8.0, 4.0, pull=64.0)

    def show(self, shown: FloatArray, vertices: FloatArray, edges: FloatArray) -> None:
        """Mark places on the mesh on show; empty arrays mark nothing.

        Args:
            shown: positions of the mesh on show, (V, 3), file units; they say where the view has its middle.
            vertices: where to draw dots, (n, 3), file units.
            edges: ends of the lines to draw, (m, 2, 3), file units.
        """
        low, high = shown.min(axis=0), shown.max(axis=0)
        # As the panes place the mesh: around the middle and about 1 large.
        middle, scale = (low + high) / 2, 1.0 / max(float(np.linalg.norm(high - low)) / 2, 1e-300)
        self._outline.set_segments(((edges - middle) * scale).astype(np.float32))
        self._set_dots(((vertices - middle) * scale).astype(np.float32))
        self._panes.interactor.mark([INPUT])

    def clear(self) -> None:
        """Mark nothing any more."""
        if self.n_dots or self.n_lines:
            self._outline.set_visible(False)
            self._dots.set_visible(False)
            self._panes.interactor.mark([INPUT])

    @property
    def n_dots(self) -> int:
        """Number of dots that are drawn now."""
        return self._dots.count

    @property
    def n_lines(self) -> int:
        """Number of lines that are drawn now."""
        return self._outline.n_segments

    @property
    def places(self) -> NDArray[np.float32]:
        """Where the dots are, (n, 3), in the units of the view."""
        return self._dots.places

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._outline.set_colors(rgb(theme.hole), rgb(theme.halo))
        self._dots.set_colors(rgb(theme.hole), rgb(theme.halo))

    def _set_dots(self, places: NDArray[np.float32]) -> None:
        points, cells = vtkPoints(), vtkCellArray()
        points.SetData(numpy_to_vtk(np.ascontiguousarray(places), deep=True))
        indices: IntArray = np.arange(len(places), dtype=np.int64)
        cells.SetData(1, numpy_to_vtkIdTypeArray(indices, deep=True))
        self._dots.set_points(points, cells)
