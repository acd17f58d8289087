"""Moves runs to the system's trash, and back again. Called off the GUI thread."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from qtpy.QtCore import QFile

from dmp.errors import RunError
from dmp.files import in_words
from dmp.run_upkeep import refuse_removal


@dataclass(frozen=True)
class Trashed:
    """What became of a run that was to go to the trash.

    Attributes:
        folder: where it lay.
        place: where it lies in the trash; None when the system did not say.
        is_gone: whether it is in the trash; otherwise it lies where it did.
        problem: why it must not be removed at all; empty when it is only that there is no trash for it.
    """

    folder: Path
    place: Path | None = None
    is_gone: bool = False
    problem: str = ""


def move_to_trash(folder: Path) -> Trashed:
    """Move a run folder, with all that lies in it, to the trash."""
    try:
        refuse_removal(folder)
    except RunError as error:
        return Trashed(folder, problem=str(error))
    # Of an object, because the function without one returns other things in other versions.
    file = QFile(str(folder))
    # Some systems say yes and leave it where it was, as on a disk that has no trash.
    is_gone = bool(file.moveToTrash()) and not folder.exists()
    place = file.fileName()
    return Trashed(folder, Path(place) if is_gone and place and Path(place) != folder else None, is_gone)


def put_back(trashed: Trashed) -> None:
    """Take a run out of the trash again (raises :class:`dmp.errors.RunError` when that is not possible)."""
    if trashed.place is None or not trashed.place.exists():
        raise RunError(f"{trashed.folder.name} is no longer in the trash.")
    if trashed.folder.exists():
        raise RunError(f"{trashed.folder} is there again; what is in the trash stays there.")
    try:
        trashed.place.rename(trashed.folder)
        # What the trash of free desktops remembers about it.
        (trashed.place.parent.parent / "info" / f"{trashed.place.name}.trashinfo").unlink(missing_ok=True)
    except OSError as error:
        raise RunError(f"{trashed.folder.name} cannot be taken out of the trash: {in_words(error)}.") from error
