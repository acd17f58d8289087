"""How the meshes are drawn, apart from their colours: shading, edges, cameras. No widgets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from psygnal import Signal

from dmp_viewer.colors import UpAxis

Shading = Literal["flat", "smooth"]


@dataclass(frozen=True)
class LookPolicy:
    """How the meshes are drawn.

    Attributes:
        shading: ``flat`` shows each face and its noise as it is, ``smooth`` hides the faces.
        edges: whether the edges of the triangles are drawn.
        linked: whether all panes turn together.
        up: the axis that points up.
        orthographic: whether the meshes are drawn without perspective.
    """

    shading: Shading = "flat"
    edges: bool = False
    linked: bool = True
    up: UpAxis = "y"
    orthographic: bool = False


class Look:
    """The policy in force.

    Attributes:
        policy: the choices.
    """

    changed = Signal()

    def __init__(self) -> None:
        self.policy = LookPolicy()

    def set(self, **changes: Any) -> None:
        """Change some of the choices, named as in :class:`LookPolicy`."""
        policy = replace(self.policy, **changes)
        if policy != self.policy:
            self.policy = policy
            self.changed.emit()
