"""Trainings on another computer, as sessions like those here. Called off the GUI thread."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from dmp_viewer.runner import Session

if TYPE_CHECKING:
    from dmp.batch.remote import RemoteTraining
    from dmp.boundary import BoundaryLoop
    from dmp.runs import Run
    from dmp.settings import Settings
    from dmp_viewer.model import Source


@dataclass(frozen=True, eq=False)
class RemoteSession(Session):
    """A training that another computer does.

    Attributes:
        training: the connection to it.
    """

    training: RemoteTraining

    def hold(self, paused: bool) -> None:
        """Pause or resume over there."""
        self.training.hold(paused)


def start_session(
    source: Source, settings: Settings, runs_folder: Path | None, loops: tuple[BoundaryLoop, ...] | None, address: str
) -> RemoteSession:
    """Begin a new training at ``address``; nothing is made here before both ends were found to have the same versions.

    Raises:
        DmpError: when nobody answers there, versions differ, or the settings cannot work.
    """
    from dmp.batch.cluster import full_address
    from dmp.batch.remote import Link, RemoteTraining, reach
    from dmp.runs import Run
    from dmp_viewer.tasks import waiting_run

    link = Link(full_address(address), source.name)
    client, remarks = reach(link)
    if settings.device.startswith("cuda:"):
        # Over there each worker has one GPU, and its numbers mean nothing here.
        settings = replace(settings, device="cuda")
    try:
        run = Run.open(waiting_run(source, settings, runs_folder, loops).folder)
        training = RemoteTraining(run, link, client)
        training.warnings += remarks
        training.begin()
        return _session(training)
    except BaseException:
        client.close(timeout=2)
        raise


def continue_session(run: Run, address: str, steps: int | None = None) -> RemoteSession:
    """Go on with a run elsewhere: where it is trained already, or else at ``address``, until ``steps`` if given.

    Raises:
        DmpError: when nobody answers there, or versions differ.
    """
    from dmp.batch.cluster import full_address
    from dmp.batch.remote import Link, RemoteTraining, reach, read_link
    from dmp.runs import Run

    link = read_link(run.folder)
    is_there = link is not None
    if link is None:
        path = run.input_path
        link = Link(full_address(address), path.stem if path is not None else "mesh")
    client, remarks = reach(link)
    try:
        training = RemoteTraining(Run.open(run.folder), link, client, steps=steps)
        training.warnings += remarks
        if is_there:
            training.attach()
        else:
            training.begin()
        return _session(training)
    except BaseException:
        client.close(timeout=2)
        raise


def _session(training: RemoteTraining) -> RemoteSession:
    return RemoteSession(training.run, training.run.problem(), training.link.address, training.records(), training)
