"""The marked steps of the run on show. No widgets."""

from __future__ import annotations

from pathlib import Path

from psygnal import Signal

from dmp.bookmarks import read_bookmarks, write_bookmarks


class Bookmarks:
    """Steps to come back to; they are kept in the run folder.

    Signals:
        changed: other steps are marked.

    Attributes:
        steps: the marked steps, ascending.
    """

    changed = Signal()

    def __init__(self) -> None:
        self.steps: list[int] = []
        self._folder: Path | None = None

    def open(self, folder: Path | None) -> None:
        """Take in the marks of another run; None is a run that has no folder."""
        self._folder = folder
        self.steps = read_bookmarks(folder) if folder is not None else []
        self.changed.emit()

    def switch(self, step: int) -> None:
        """Mark a step, or take its mark away (raises :class:`dmp.errors.RunError` when that cannot be written)."""
        self.steps = sorted(set(self.steps) ^ {step})
        self.changed.emit()
        if self._folder is not None:
            write_bookmarks(self._folder, self.steps)

    def after(self, step: int) -> int | None:
        """Return the next marked step."""
        return min((marked for marked in self.steps if marked > step), default=None)

    def before(self, step: int) -> int | None:
        """Return the marked step before."""
        return max((marked for marked in self.steps if marked < step), default=None)
