"""Trainings on another computer, as sessions like those here. Called off the GUI thread."""

from __future__ import annotations

from dataclasses import dataclass
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
    from dmp.batch.remote import Link, RemoteTraining, check
    from dmp.runs import Run
    from dmp_viewer.tasks import waiting_run

    link = Link(full_address(address), source.name)
    remarks = check(link)
    run = Run.open(waiting_run(source, settings, runs_folder, loops).folder)
    training = RemoteTraining(run, link)
    training.connect()
    training.warnings += remarks
    training.begin()
    return _session(training)


def continue_session(run: Run, address: str, steps: int | None = None) -> RemoteSession:
    """Go on with a run elsewhere: where it is trained already, or else at ``address``, until ``steps`` if given.

    Raises:
        DmpError: when nobody answers there, or versions differ.
    """
    from dmp.batch.cluster import full_address
    from dmp.batch.remote import Link, RemoteTraining, read_link

    link = read_link(run.folder)
    is_there = link is not None
    if link is None:
        path = run.input_path
        link = Link(full_address(address), path.stem if path is not None else "mesh")
    training = RemoteTraining(Run.open(run.folder), link, steps=steps)
    training.warnings += training.connect()
    if is_there:
        training.attach()
    else:
        training.begin()
    return _session(training)


def _session(training: RemoteTraining) -> RemoteSession:
    return RemoteSession(training.run, training.run.problem(), training.link.address, training.records(), training)
