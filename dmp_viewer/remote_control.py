"""Answers "Run on": starts trainings elsewhere, finds them again, and leaves them alone when the window closes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import QObject

from dmp.runs import Run
from dmp.settings import Settings
from dmp_viewer import remote
from dmp_viewer.remote import RemoteSession
from dmp_viewer.runner import Session
from dmp_viewer.views.banner import Message

if TYPE_CHECKING:
    from pathlib import Path

    from dmp.boundary import BoundaryLoop
    from dmp_viewer.controller import Controller
    from dmp_viewer.model import Source


class RemoteControl(QObject):
    """What the window does about trainings on other computers.

    Args:
        controller: whose window and runner it uses.
    """

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self._controller = controller
        self._place = controller.window.panel.place
        self._place.offer(controller.preferences.servers)
        self._session: RemoteSession | None = None
        controller.runner.prepared.connect(self._on_runner_prepared)
        controller.runner.finished.connect(self._on_runner_finished)

    @property
    def address(self) -> str:
        """The address to train at; empty for this computer."""
        return self._place.address

    def start(self, source: Source, settings: Settings, folder: Path | None, loops: tuple[BoundaryLoop, ...] | None) -> bool:
        """Begin a training elsewhere; False when it is to be done here."""
        address = self.address
        if not address:
            return False
        self._controller.runner.start(lambda: remote.start_session(source, settings, folder, loops, address))
        return True

    def proceed(self, run: Run, steps: int | None) -> bool:
        """Go on with a run elsewhere, where it is trained or is to be; False when it is to be done here."""
        from dmp.batch.remote import read_link

        address = self.address
        if not address and read_link(run.folder) is None:
            return False
        self._controller.runner.start(lambda: remote.continue_session(run, address, steps))
        return True

    def tell_about(self, run: Run) -> bool:
        """Offer to find a run again that is trained elsewhere; tell whether it is."""
        from dmp.batch.remote import read_link

        link = read_link(run.folder)
        if link is None:
            return False
        text = f"This run is trained at {link.address}. What is shown is what had arrived until step {run.last_step:,}."
        self._controller.say(Message("info", text, action=("Reconnect", self._reconnect)))
        return True

    def leave(self) -> None:
        """Let a training elsewhere go on when the window closes."""
        if self._session is not None:
            self._session.training.leave()

    def _reconnect(self) -> None:
        run, runner = self._controller.workspace.run, self._controller.runner
        if isinstance(run, Run) and not runner.state.is_active:
            self._controller.window.banners.clear()
            self._controller.forget_told_warnings()
            runner.start(lambda: remote.continue_session(run, self.address))

    def _on_runner_prepared(self, session: Session) -> None:
        self._session = session if isinstance(session, RemoteSession) else None
        if self._session is None:
            return
        preferences, address = self._controller.preferences, self._session.training.link.address
        preferences.add_server(address)
        self._place.offer(preferences.servers)

    def _on_runner_finished(self) -> None:
        self._session = None
