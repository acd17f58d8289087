"""Where the camera stands: in front of the mesh, near enough to fill the pane, or close to one place."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dmp.mesh import FloatArray
from dmp_viewer.colors import UpAxis

# Where the camera stands at first, for each axis that can point up: in front, a little to the right and above.
_FRONT: dict[UpAxis, tuple[float, float, float]] = {"y": (0.45, 0.35, 1.0), "z": (0.75, -0.8, 0.4)}
_UP: dict[UpAxis, tuple[float, float, float]] = {"y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_VIEW_ANGLE = 30.0
_MARGIN = 1.06
# A place that is looked at takes this share of the height of its pane, and the camera comes no nearer than this.
_SHARE = 0.36
_NEAREST = 0.01


def stand_in_front(camera: Any, up: UpAxis) -> None:
    """Look from the front, a little from above and from the right."""
    camera.SetFocalPoint(0, 0, 0)
    camera.SetPosition(*_FRONT[up])
    camera.SetViewUp(*_UP[up])
    camera.SetViewAngle(_VIEW_ANGLE)


def come_near(camera: Any, place: FloatArray, direction: FloatArray | None, size: float, up: UpAxis) -> None:
    """Look at something of a size at a place, (3,), from a direction, (3,) of length 1; None keeps the direction."""
    if direction is None:
        offset = np.array(camera.GetPosition()) - np.array(camera.GetFocalPoint())
        towards = offset / np.linalg.norm(offset)
    else:
        towards = direction
    distance = max(size / (2 * _SHARE * np.tan(np.radians(_VIEW_ANGLE / 2))), _NEAREST)
    above = np.array(_UP[up])
    if abs(above @ towards) > 0.95:
        above = np.roll(above, 1)
    camera.SetFocalPoint(*place)
    camera.SetPosition(*(place + towards * distance))
    camera.SetViewUp(*above)
    camera.SetViewAngle(_VIEW_ANGLE)


def fit(camera: Any, points: NDArray[np.float32], aspect: float) -> None:
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
