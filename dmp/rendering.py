"""Pictures of meshes as arrays, drawn off screen: no window is opened, and none is needed.

The only module of this package that loads pyvista. VTK may end the whole process where it finds no way to draw, so
:func:`can_render` asks a child process first.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dmp.exports.viewpoints import Viewpoint
from dmp.mesh import FloatArray, IntArray, TriangleMesh

# From the middle of the picture towards the eye, and upwards.
EYE, UP = (0.45, 0.35, 1.0), (0.0, 1.0, 0.0)
_SURFACE = (0.74, 0.76, 0.80)
_PATIENCE_SECONDS = 120
# How many times finer pictures of so many pixels are drawn. In the largest the steps at edges are not seen.
_FINER = ((3, 1_500_000), (2, 9_000_000))


def picture(
    mesh: TriangleMesh,
    face_values: FloatArray | None = None,
    *,
    limits: tuple[float, float] = (0.0, 1.0),
    size: int = 480,
    like: TriangleMesh | None = None,
    centre: FloatArray | None = None,
    radius: float | None = None,
    eye: FloatArray | None = None,
) -> NDArray[np.uint8]:
    """Draw a mesh, flat shaded, on a white ground.

    Args:
        mesh: what to draw.
        face_values: one number for each face, (F,), shown as colours; None draws a plain surface.
        limits: numbers of the first and the last colour.
        size: width and height in pixels.
        like: whose extent fills the picture; by default ``mesh`` itself. Pictures to be compared need the same.
        centre: a point to look at closely, (3,), instead of the middle.
        radius: how far around ``centre`` the picture reaches.
        eye: direction from the mesh to the eye, (3,); by default :data:`EYE`.

    Returns:
        (size, size, 3) RGB.
    """
    pyvista = _pyvista()
    plotter = pyvista.Plotter(off_screen=True, window_size=[size, size])
    try:
        plotter.set_background("white")
        surface = pyvista.PolyData.from_regular_faces(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        look = {"smooth_shading": False, "show_scalar_bar": False, "ambient": 0.15, "diffuse": 0.85}
        if face_values is None:
            plotter.add_mesh(surface, color=_SURFACE, **look)
        else:
            surface.cell_data["value"] = np.asarray(face_values)
            plotter.add_mesh(surface, scalars="value", cmap="viridis", clim=list(limits), **look)
        frame = (like or mesh).vertices
        middle = (frame.min(axis=0) + frame.max(axis=0)) / 2 if centre is None else np.asarray(centre)
        reach = radius or float(np.linalg.norm(frame - middle, axis=1).max())
        towards = np.asarray(EYE if eye is None else eye, dtype=np.float64)
        towards = towards / np.linalg.norm(towards)
        # Seen along the upward direction itself, something else has to be up.
        up = UP if abs(towards @ UP) < 0.95 else (0.0, 0.0, -1.0)
        plotter.enable_parallel_projection()
        plotter.camera_position = [tuple(middle + 4 * max(reach, 1e-300) * towards), tuple(middle), up]
        plotter.camera.parallel_scale = reach
        plotter.reset_camera_clipping_range()
        return np.asarray(plotter.screenshot(return_img=True))[..., :3].astype(np.uint8)
    finally:
        plotter.close()


# Lines upon a surface, and what makes them stand out, are drawn nearer to the eye by this much; a mesh is about 1 large.
_HALO_NEARER, _LINE_NEARER = 0.004, 0.008


class Studio:
    """Draws one mesh after the other on a ground that can be seen through, lit as in the window.

    Args:
        width: of the pictures, pixels.
        height: of the pictures, pixels.
        has_edges: whether the edges of the triangles are drawn.
    """

    def __init__(self, width: int, height: int, *, has_edges: bool = False) -> None:
        self._pyvista = _pyvista()
        self._has_edges = has_edges
        # Edges are made smooth by averaging finer pictures. What drivers do by themselves differs: some average light
        # instead of numbers, and then opacity and colour at the edges do not belong together.
        self._finer = next((finer for finer, most in _FINER if width * height <= most), 1)
        self._ratio = max(1.0, min(width, height) / 500) * self._finer
        size = [width * self._finer, height * self._finer]
        self._plotter = self._pyvista.Plotter(off_screen=True, window_size=size, lighting="light kit")
        self._plotter.disable_anti_aliasing()
        # Upon black, what is half covered is the colour times its opacity, which can be laid over any ground.
        self._plotter.set_background("black")

    def close(self) -> None:
        """Give the resources back."""
        self._plotter.close()

    def draw(
        self,
        vertices: NDArray[np.float32],
        faces: IntArray,
        viewpoint: Viewpoint,
        *,
        color: str,
        edge_color: str = "#30363d",
        values: NDArray[np.float32] | None = None,
        table: NDArray[np.uint8] | None = None,
        limits: tuple[float, float] = (0.0, 1.0),
        colors: NDArray[np.uint8] | None = None,
        normals: NDArray[np.float32] | None = None,
        lines: NDArray[np.float32] | None = None,
        line_color: str = "#e6007e",
        halo_color: str = "#ffffff",
    ) -> NDArray[np.uint8]:
        """Draw a mesh.

        Args:
            vertices: (V, 3), about 1 large and around 0.
            faces: (F, 3).
            viewpoint: where the eye is.
            color: of the surface where it has no value.
            edge_color: of the edges of the triangles.
            values: (V,), shown by ``table`` between ``limits``; NaN is bare.
            table: (n, 4) RGBA.
            limits: numbers of the first and the last colour.
            colors: (V, 3), a colour for each vertex in place of values.
            normals: (V, 3) unit normals for smooth shading; None shades each face by itself.
            lines: (n, 2, 3), ends of segments drawn upon the surface.
            line_color: of these.
            halo_color: what surrounds them.

        Returns:
            (height, width, 4) RGBA, colours multiplied by their opacity.
        """
        pyvista, plotter = self._pyvista, self._plotter
        plotter.clear_actors()
        surface = pyvista.PolyData.from_regular_faces(vertices, faces)
        look = {
            "show_scalar_bar": False, "ambient": 0.18, "diffuse": 0.88, "specular": 0.08, "specular_power": 20, "color": color,
            "show_edges": self._has_edges, "edge_color": edge_color, "edge_opacity": 0.5, "reset_camera": False,
            "line_width": 1.0 * self._ratio,
        }  # fmt: skip
        if values is not None and table is not None:
            surface.point_data["values"] = values
            shown = pyvista.LookupTable(values=np.asarray(table), scalar_range=limits, nan_color=color)
            look |= {"scalars": "values", "cmap": shown, "clim": list(limits), "nan_color": color}
        elif colors is not None:
            surface.point_data["colors"] = colors
            look |= {"scalars": "colors", "rgb": True}
        if normals is not None:
            surface.point_data.active_normals = normals
        actor = plotter.add_mesh(surface, **look)
        actor.prop.interpolation = "Phong" if normals is not None else "Flat"
        if lines is not None and len(lines):
            self._add_lines(lines, viewpoint.position, line_color, halo_color)
        plotter.camera.position = viewpoint.position
        plotter.camera.focal_point = viewpoint.focal_point
        plotter.camera.up = viewpoint.up
        plotter.camera.view_angle = viewpoint.angle
        # Deep enough for whatever comes near, as in the window.
        plotter.renderer.ResetCameraClippingRange(-2, 2, -2, 2, -2, 2)
        return _averaged(plotter.screenshot(return_img=True, transparent_background=True), self._finer)

    def _add_lines(self, segments: NDArray[np.float32], eye: tuple[float, float, float], color: str, halo: str) -> None:
        drawn = self._pyvista.PolyData(np.ascontiguousarray(segments.reshape(-1, 3)))
        ends = np.arange(2 * len(segments)).reshape(-1, 2)
        drawn.lines = np.column_stack([np.full(len(ends), 2), ends]).ravel()
        to_eye = np.asarray(eye) - drawn.points
        to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
        for width, shade, nearer in ((5.5, halo, _HALO_NEARER), (3.0, color, _LINE_NEARER)):
            # Along its own line of sight a point stays where it is in the picture. (What VTK has for lines upon surfaces
            # does not hold: which of two lines is seen then depends on the order in which it happens to draw them.)
            line = drawn.copy()
            line.points = drawn.points + nearer * to_eye
            self._plotter.add_mesh(line, color=shade, line_width=width * self._ratio, lighting=False, reset_camera=False)


@cache
def can_render() -> bool:
    """Tell whether this machine can draw pictures, by trying it in a child process."""
    command = [sys.executable, "-m", "dmp.rendering"]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_PATIENCE_SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0 and done.stdout.strip().endswith(b"drawn")


def _averaged(picture: NDArray[np.uint8], times: int) -> NDArray[np.uint8]:
    """Return a picture, (h, w, 4), made so many times smaller by averaging squares of pixels."""
    if times == 1:
        return np.ascontiguousarray(picture)
    total = np.zeros((picture.shape[0] // times, picture.shape[1] // times, 4), dtype=np.uint16)
    for row in range(times):
        for column in range(times):
            total += picture[row::times, column::times]
    return ((total + times**2 // 2) // times**2).astype(np.uint8)


def _pyvista() -> Any:
    """Return pyvista, told to look for no screen and no notebook."""
    os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
    import pyvista
    from vtkmodules.vtkCommonCore import vtkLogger

    # Without a display VTK goes on by other means, after a warning on stderr that would worry people for nothing.
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    return pyvista


def _try() -> int:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    drawn = picture(TriangleMesh(corners, np.array([[0, 1, 2]])), size=32)
    # A context that draws nothing leaves a white picture.
    if drawn.min() == 255:
        return 1
    sys.stdout.write("drawn\n")
    return 0


if __name__ == "__main__":
    sys.exit(_try())
