"""One state of the mesh on the screen: made once for a mesh, its arrays written in place for each new state.

Invariants, each with what happens when it is broken:

- Nothing is made anew for a snapshot. New actors for each would take ten times as long, and memory that comes back late.
- Smooth shading gets its normals from here. VTK would keep those of the first positions.
- The split between two actors in one pane is decided for each pixel in the shader; both are there as a whole, so that
  turning the view costs nothing more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkLookupTable, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

from dmp.mesh import FloatArray, IntArray
from dmp_viewer.colors import Values

_CUT = """//VTK::Color::Impl
  if (cutMode == 1 && (gl_FragCoord.x < cutPlace.x) == (cutSide == 0)) discard;
  if (cutMode == 2 && (distance(gl_FragCoord.xy, cutPlace.xy) < cutPlace.z) == (cutSide == 0)) discard;
"""
CUT_NONE, CUT_LINE, CUT_CIRCLE = range(3)


class Pane:
    """A mesh that can be moved, coloured, shaded and cut.

    Args:
        cells: its faces.
        n_vertices: number of vertices V.
        table: the colours of its values, shared by all panes.
        is_inner: which side of a cut it is on: left of the line and inside the circle, or the rest.
    """

    def __init__(self, cells: vtkCellArray, n_vertices: int, table: vtkLookupTable, *, is_inner: bool = False) -> None:
        self.coordinates: NDArray[np.float32] = np.zeros((n_vertices, 3), dtype=np.float32)
        self._values: NDArray[np.float32] = np.zeros(n_vertices, dtype=np.float32)
        self._directions: NDArray[np.uint8] | None = None
        self._normals: NDArray[np.float32] | None = None
        self._n_vertices = n_vertices
        self.points = vtkPoints()
        self.points.SetData(numpy_to_vtk(self.coordinates))
        self._data = vtkPolyData()
        self._data.SetPoints(self.points)
        self._data.SetPolys(cells)
        self._add_array("values", self._values)
        self._mapper = vtkPolyDataMapper()
        self._mapper.SetInputData(self._data)
        self._mapper.SetLookupTable(table)
        self._mapper.UseLookupTableScalarRangeOn()
        # Colours are looked up for each pixel, not mixed between vertices: mixing leaves the colour map.
        self._mapper.InterpolateScalarsBeforeMappingOn()
        self._mapper.SetScalarModeToUsePointFieldData()
        self._mapper.SelectColorArray("values")
        self._mapper.ScalarVisibilityOff()
        self.actor = vtkActor()
        self.actor.SetMapper(self._mapper)
        shading = self.actor.GetProperty()
        shading.SetInterpolationToFlat()
        shading.SetAmbient(0.18)
        shading.SetDiffuse(0.88)
        shading.SetSpecular(0.08)
        shading.SetSpecularPower(20)
        # On fine meshes full lines would cover the surface.
        shading.SetEdgeOpacity(0.5)
        self.actor.SetVisibility(False)
        program = self.actor.GetShaderProperty()
        program.AddFragmentShaderReplacement("//VTK::Color::Impl", True, _CUT, False)
        self._cut = program.GetFragmentCustomUniforms()
        self._cut.SetUniformi("cutSide", 1 if is_inner else 0)
        self.cut(CUT_NONE)

    @property
    def data(self) -> vtkPolyData:
        """The mesh as VTK has it, to be picked from."""
        return self._data

    @property
    def is_visible(self) -> bool:
        """Whether it is drawn."""
        return bool(self.actor.GetVisibility())

    def set_positions(self, coordinates: FloatArray) -> None:
        """Move the vertices, (V, 3), units of the view."""
        self.coordinates[:] = coordinates
        self.points.Modified()
        self.points.GetData().Modified()

    def set_values(self, values: Values | None) -> None:
        """Colour it by values, (V,); None shows the bare surface."""
        if values is not None:
            self._values[:] = values
            self._data.GetPointData().GetArray("values").Modified()
            self._mapper.SelectColorArray("values")
            self._mapper.SetColorModeToMapScalars()
        self._mapper.SetScalarVisibility(values is not None)

    def set_colors(self, colors: NDArray[np.uint8]) -> None:
        """Give each vertex a colour of its own, (V, 3)."""
        if self._directions is None:
            self._directions = np.zeros((self._n_vertices, 3), dtype=np.uint8)
            self._add_array("directions", self._directions)
        self._directions[:] = colors
        self._data.GetPointData().GetArray("directions").Modified()
        self._mapper.SelectColorArray("directions")
        self._mapper.SetColorModeToDirectScalars()
        self._mapper.ScalarVisibilityOn()

    def set_normals(self, normals: FloatArray | None) -> None:
        """Shade it smoothly with unit normals, (V, 3); None shades each face by itself."""
        if normals is None:
            self.actor.GetProperty().SetInterpolationToFlat()
            return
        if self._normals is None:
            self._normals = np.zeros((self._n_vertices, 3), dtype=np.float32)
            array = numpy_to_vtk(self._normals)
            array.SetName("normals")
            self._data.GetPointData().SetNormals(array)
        self._normals[:] = normals
        self._data.GetPointData().GetNormals().Modified()
        self.actor.GetProperty().SetInterpolationToPhong()

    def cut(self, mode: int, x: float = 0.0, y: float = 0.0, radius: float = 0.0) -> None:
        """Leave away what lies on the other side of a cut, in pixels of the frame buffer from its lower left corner."""
        self._cut.SetUniformi("cutMode", mode)
        self._cut.SetUniform3f("cutPlace", (x, y, radius))

    def _add_array(self, name: str, content: NDArray) -> None:
        array = numpy_to_vtk(content)
        array.SetName(name)
        self._data.GetPointData().AddArray(array)


def cells_of(faces: IntArray) -> vtkCellArray:
    """Return faces, (F, 3), as VTK wants them."""
    cells = vtkCellArray()
    cells.SetData(3, numpy_to_vtkIdTypeArray(np.ascontiguousarray(faces, dtype=np.int64).ravel(), deep=True))
    return cells
