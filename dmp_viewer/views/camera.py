"""Where the camera stands: in front of the mesh, near enough to fill the pane, or close to one place."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dmp.exports.viewpoints import FRONT, UP, VIEW_ANGLE, Viewpoint
from dmp.mesh import FloatArray
from dmp_viewer.colors import UpAxis

# A place that is looked at takes this share of the height of its pane, and the camera comes no nearer than this.
_SHARE = 0.36
_NEAREST = 0.01


def stand_in_front(camera: Any, up: UpAxis) -> None:
    """Look from the front, a little from above and from the right."""
    camera.SetFocalPoint(0, 0, 0)
    camera.SetPosition(*FRONT[up])
    camera.SetViewUp(*UP[up])
    camera.SetViewAngle(VIEW_ANGLE)


def come_near(camera: Any, place: FloatArray, direction: FloatArray | None, size: float, up: UpAxis) -> None:
    """Look at something of a size at a place, (3,), from a direction, (3,) of length 1; None keeps the direction."""
    if direction is None:
        offset = np.array(camera.GetPosition()) - np.array(camera.GetFocalPoint())
        towards = offset / np.linalg.norm(offset)
    else:
        towards = direction
    distance = max(size / (2 * _SHARE * np.tan(np.radians(VIEW_ANGLE / 2))), _NEAREST)
    above = np.array(UP[up])
    if abs(above @ towards) > 0.95:
        above = np.roll(above, 1)
    camera.SetFocalPoint(*place)
    camera.SetPosition(*(place + towards * distance))
    camera.SetViewUp(*above)
    camera.SetViewAngle(VIEW_ANGLE)


def fit(camera: Any, points: NDArray[np.float32], aspect: float) -> None:
    """Move a camera along its line of sight until all points, (V, 3), are in view of a pane ``aspect`` times as wide as high.

    VTK itself fits the surrounding sphere, which leaves wide margins around most shapes.
    """
    seen = Viewpoint(camera.GetPosition(), camera.GetFocalPoint(), camera.GetViewUp(), camera.GetViewAngle())
    found = seen.fitted(points, aspect)
    camera.SetFocalPoint(*found.focal_point)
    camera.SetPosition(*found.position)
    camera.SetViewUp(*found.up)
