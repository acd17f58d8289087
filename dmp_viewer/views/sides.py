"""From which sides a mesh can be looked at with one key, whatever axis points up."""

from __future__ import annotations

from typing import Any, Literal

from dmp_viewer.colors import UpAxis

Side = Literal["front", "side", "top"]
_Direction = tuple[float, float, float]

# Towards the eye, and upwards in the picture.
SIDES: dict[UpAxis, dict[Side, tuple[_Direction, _Direction]]] = {
    "y": {
        "front": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
        "side": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        "top": ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    },
    "z": {
        "front": ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
        "side": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        "top": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    },
}


def stand_at(camera: Any, side: Side, up: UpAxis) -> None:
    """Look straight from a side at the middle."""
    eye, above = SIDES[up][side]
    camera.SetFocalPoint(0, 0, 0)
    camera.SetPosition(*eye)
    camera.SetViewUp(*above)
