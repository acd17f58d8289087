"""Pictures of meshes as arrays, drawn off screen: no window is opened, and none is needed.

The only module of this package that loads pyvista. VTK may end the whole process where it finds no way to draw, so
:func:`can_render` asks a child process first.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dmp.mesh import FloatArray, TriangleMesh

# From the middle of the picture towards the eye, and upwards.
EYE, UP = (0.45, 0.35, 1.0), (0.0, 1.0, 0.0)
_SURFACE = (0.74, 0.76, 0.80)
_PATIENCE_SECONDS = 120


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
    # Nothing may look for a screen or a notebook.
    os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
    import pyvista
    from vtkmodules.vtkCommonCore import vtkLogger

    # Without a display VTK goes on by other means, after a warning on stderr that would worry people for nothing.
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
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


@cache
def can_render() -> bool:
    """Tell whether this machine can draw pictures, by trying it in a child process."""
    command = [sys.executable, "-m", "dmp.rendering"]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_PATIENCE_SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0 and done.stdout.strip().endswith(b"drawn")


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
