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
# Without perspective the distance of the camera changes nothing, as long as it stands in front of everything.
_FAR_AWAY = 5.0
# A picture is drawn with perspective always; through an angle as narrow as this, degrees, it cannot be seen.
_NARROW = 1.0


def stand_in_front(camera: Any, up: UpAxis) -> None:
    """Look from the front, a little from above and from the right."""
    camera.SetFocalPoint(0, 0, 0)
    camera.SetPosition(*FRONT[up])
    camera.SetViewUp(*UP[up])
    camera.SetViewAngle(VIEW_ANGLE)


def come_near(camera: Any, place: FloatArray, direction: FloatArray | None, size: float, up: UpAxis) -> None:
    """Look at something of a size at a place, (3,), from a direction, (3,) of length 1; None keeps the direction."""
    towards = _towards(camera) if direction is None else direction
    distance = max(size / (2 * _SHARE * _tangent(VIEW_ANGLE)), _NEAREST)
    above = np.array(UP[up])
    if abs(above @ towards) > 0.95:
        above = np.roll(above, 1)
    camera.SetFocalPoint(*place)
    camera.SetPosition(*(place + towards * distance))
    camera.SetViewUp(*above)
    camera.SetViewAngle(VIEW_ANGLE)
    if camera.GetParallelProjection():
        _stand_far_away(camera, distance * _tangent(VIEW_ANGLE))


def set_orthographic(camera: Any, orthographic: bool) -> None:
    """Draw without perspective, or with it; what the camera looks at keeps its size."""
    height = half_height(camera)
    camera.SetParallelProjection(orthographic)
    if orthographic:
        _stand_far_away(camera, height)
    else:
        focus, towards = np.array(camera.GetFocalPoint()), _towards(camera)
        camera.SetPosition(*(focus + towards * height / _tangent(camera.GetViewAngle())))


def half_height(camera: Any) -> float:
    """Return half the height that is seen where the camera looks, in units of the view."""
    if camera.GetParallelProjection():
        return float(camera.GetParallelScale())
    return float(camera.GetDistance() * _tangent(camera.GetViewAngle()))


def viewpoint_of(camera: Any) -> Viewpoint:
    """Return from where a camera looks; one without perspective looks from far away through a narrow angle."""
    position, focus, up = camera.GetPosition(), camera.GetFocalPoint(), camera.GetViewUp()
    if not camera.GetParallelProjection():
        return Viewpoint(position, focus, up, camera.GetViewAngle())
    x, y, z = np.array(focus) + _towards(camera) * half_height(camera) / _tangent(_NARROW)
    return Viewpoint((float(x), float(y), float(z)), focus, up, _NARROW)


def _stand_far_away(camera: Any, height: float) -> None:
    camera.SetPosition(*(np.array(camera.GetFocalPoint()) + _towards(camera) * _FAR_AWAY))
    camera.SetParallelScale(height)


def _towards(camera: Any) -> FloatArray:
    """Return the direction to the eye, (3,) of length 1."""
    offset = np.array(camera.GetPosition()) - np.array(camera.GetFocalPoint())
    return offset / np.linalg.norm(offset)


def _tangent(angle: float) -> float:
    return float(np.tan(np.radians(angle / 2)))


def fit(camera: Any, points: NDArray[np.float32], aspect: float) -> None:
    """Move a camera along its line of sight until all points, (V, 3), are in view of a pane ``aspect`` times as wide as high.

    VTK itself fits the surrounding sphere, which leaves wide margins around most shapes.
    """
    found = viewpoint_of(camera).fitted(points, aspect)
    camera.SetFocalPoint(*found.focal_point)
    camera.SetPosition(*found.position)
    camera.SetViewUp(*found.up)
    if camera.GetParallelProjection():
        _stand_far_away(camera, float(np.linalg.norm(np.subtract(found.position, found.focal_point))) * _tangent(found.angle))
