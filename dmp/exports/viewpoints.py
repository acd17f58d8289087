"""Where the eye is: in front of a mesh, near enough to fill the picture, or on its way around it.

Everything is in units of the view: the middle of the bounding box is 0, and half its diagonal is 1, so that a mesh of any
size and place keeps its shape in single precision.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dmp.mesh import FloatArray

UpAxis = Literal["y", "z"]

# Where the eye is at first, for each axis that can point up: in front, a little to the right and above.
FRONT: dict[UpAxis, tuple[float, float, float]] = {"y": (0.45, 0.35, 1.0), "z": (0.75, -0.8, 0.4)}
UP: dict[UpAxis, tuple[float, float, float]] = {"y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
VIEW_ANGLE = 30.0
_MARGIN = 1.06
# A turning mesh is fitted at so many of its sides.
_SIDES = 24

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Viewpoint:
    """A camera.

    Attributes:
        position: of the eye, units of the view.
        focal_point: what it looks at, units of the view.
        up: the direction that points up in the picture.
        angle: between the upper and the lower edge of the picture, degrees.
    """

    position: Triple
    focal_point: Triple = (0.0, 0.0, 0.0)
    up: Triple = UP["y"]
    angle: float = VIEW_ANGLE

    def fitted(self, points: NDArray[Any], aspect: float) -> Viewpoint:
        """Return the viewpoint moved along its line of sight until all points are seen, as large as possible.

        Args:
            points: (N, 3), units of the view.
            aspect: width of the picture divided by its height.
        """
        right, up, backward = self._axes()
        tangent = np.tan(np.radians(self.angle / 2.0))
        middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        distance = 1.0
        # Perspective makes what is near larger, so the middle of the picture is found in a few rounds.
        for _ in range(4):
            across, above, towards = (points - middle) @ right, (points - middle) @ up, (points - middle) @ backward
            distance = float(np.max(towards + _MARGIN * np.maximum(np.abs(above), np.abs(across) / aspect) / tangent))
            x, y = across / (distance - towards), above / (distance - towards)
            middle = middle + distance * ((x.min() + x.max()) / 2 * right + (y.min() + y.max()) / 2 * up)
        return replace(self, position=_triple(middle + backward * distance), focal_point=_triple(middle), up=_triple(up))

    def _axes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the directions to the right of the picture, to its top, and to the eye."""
        backward = np.subtract(self.position, self.focal_point)
        backward = backward / np.linalg.norm(backward)
        right = np.cross(self.up, backward)
        right = right / np.linalg.norm(right)
        return right, np.cross(backward, right), backward

    def turned(self, degrees: float, axis: Triple) -> Viewpoint:
        """Return the viewpoint turned around what it looks at; a mesh seen from it seems to turn the other way."""
        turn = _rotation(degrees, axis)
        towards = np.subtract(self.position, self.focal_point)
        return replace(self, position=_triple(self.focal_point + turn @ towards), up=_triple(turn @ np.asarray(self.up)))

    def fitted_all_around(self, points: NDArray[Any], aspect: float, axis: Triple) -> Viewpoint:
        """Return a viewpoint from which a mesh, (N, 3), stays in the picture while it is turned around ``axis``."""
        middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        middled = replace(
            self, focal_point=_triple(middle), position=_triple(middle + np.subtract(self.position, self.focal_point))
        )
        tangent = np.tan(np.radians(self.angle / 2.0))
        furthest = 0.0
        for side in range(_SIDES):
            turned = middled.turned(360.0 * side / _SIDES, axis)
            right, up, backward = turned._axes()
            across, above, towards = (points - middle) @ right, (points - middle) @ up, (points - middle) @ backward
            distance = towards + _MARGIN * np.maximum(np.abs(above), np.abs(across) / aspect) / tangent
            furthest = max(furthest, float(np.max(distance)))
        return replace(middled, position=_triple(middle + middled._axes()[2] * furthest))

    def for_picture(self, seen_aspect: float, aspect: float) -> Viewpoint:
        """Return the viewpoint for a picture of another aspect that shows at least what was seen."""
        if aspect >= seen_aspect:
            return self
        tangent = np.tan(np.radians(self.angle / 2.0)) * seen_aspect / aspect
        return replace(self, angle=float(np.degrees(2.0 * np.arctan(tangent))))


def front(up: UpAxis = "y", eye: Triple | None = None) -> Viewpoint:
    """Return a viewpoint in front of the mesh, or in the direction ``eye``; it still has to be fitted."""
    direction = FRONT[up] if eye is None else eye
    above = np.array(UP[up])
    towards = np.array(direction) / np.linalg.norm(direction)
    # Seen along the upward direction itself, something else has to be up.
    if abs(above @ towards) > 0.95:
        above = np.roll(above, 1)
    return Viewpoint(_triple(towards), up=_triple(above))


@dataclass(frozen=True, eq=False)
class Place:
    """Where a mesh lies and how large it is: what brings it into units of the view.

    Attributes:
        centre: middle of its bounding box, (3,), file units.
        scale: units of the view for each unit of the file.
    """

    centre: FloatArray
    scale: float

    @classmethod
    def of(cls, vertices: FloatArray) -> Place:
        """Return the place of vertices, (V, 3), file units."""
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        return cls((low + high) / 2, 1.0 / max(float(np.linalg.norm(high - low)) / 2, 1e-300))

    def seen(self, positions: FloatArray) -> NDArray[np.float32]:
        """Return positions (..., 3) in file units in units of the view."""
        return np.asarray((positions - self.centre) * self.scale, dtype=np.float32)


def _rotation(degrees: float, axis: Triple) -> FloatArray:
    """Return the matrix of a rotation about ``axis`` (Rodrigues' formula)."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def _triple(values: NDArray[Any]) -> Triple:
    x, y, z = (float(value) for value in values)
    return x, y, z
