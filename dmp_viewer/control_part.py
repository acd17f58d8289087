"""What the parts of the controller share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import QObject

if TYPE_CHECKING:
    from dmp_viewer.controller import Controller


class ControlPart(QObject):
    """A part of the controller; its method ``_do_NAME`` does what the action ``NAME`` says.

    Args:
        controller: whose window and workspace it works on.
    """

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self._controller = controller
        self._workspace = controller.workspace
        self._window = controller.window

    def do(self, name: str) -> bool:
        """Do what an action of this part says; tells whether it is one."""
        handler = getattr(self, f"_do_{name}", None)
        if handler is None:
            return False
        handler()
        return True
