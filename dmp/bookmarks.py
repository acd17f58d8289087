"""Steps of a run that a person marked to come back to, kept in ``bookmarks.json`` of the run folder."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dmp.errors import RunError
from dmp.files import in_words
from dmp.run_folder import RunFolder

_NAME = "bookmarks.json"
# Steps have at most seven digits; a list much longer than this was not made by hand.
_MOST_BOOKMARKS = 1000


def read_bookmarks(folder: Path) -> list[int]:
    """Return the marked steps of a run folder, ascending; none when nothing is marked or the file is damaged."""
    files = RunFolder(folder)
    try:
        steps = files.read_json(_NAME).get("steps") if files.size(_NAME) is not None else None
    except RunError:
        return []
    if not isinstance(steps, list):
        return []
    return sorted({step for step in steps[:_MOST_BOOKMARKS] if type(step) is int and step >= 0})


def write_bookmarks(folder: Path, steps: Iterable[int]) -> None:
    """Write the marked steps into a run folder, whole or not at all; without any the file is removed.

    Raises:
        RunError: when they cannot be written.
    """
    files, marked = RunFolder(folder), sorted(set(steps))
    try:
        if marked:
            files.write_json(_NAME, {"steps": marked})
        else:
            (files / _NAME).unlink(missing_ok=True)
    except OSError as error:
        reason = in_words(error)
        raise RunError(f"The bookmarks cannot be written to {folder}: {reason}. They last until the window closes.") from error
