"""What a run has learnt and could not write yet: it waits in memory until its folder can be written again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from dmp.errors import DmpError
from dmp.files import in_words
from dmp.snapshot import Snapshot


class Outbox:
    """Snapshots, the newest checkpoint and the choice of a person on their way to the disk.

    Attributes:
        snapshots: by step, those that are not written yet.
        checkpoint: content of the newest checkpoint, None when it is written.
        choice: the chosen step or None for no step any more, in a tuple; None when it is written.
        told: sentences about what could not be written, each told once until it could be written again.
    """

    def __init__(self, folder: Path, told: list[str]) -> None:
        """Report in the list ``told`` about ``folder``."""
        self.snapshots: dict[int, Snapshot] = {}
        self.checkpoint: bytes | None = None
        self.choice: tuple[int | None] | None = None
        self.told = told
        self._folder = folder
        self._trouble = ""

    @property
    def is_empty(self) -> bool:
        """Whether everything that was learnt is on the disk."""
        return not self.snapshots and self.checkpoint is None

    @property
    def has_trouble(self) -> bool:
        """Whether the last attempt failed."""
        return bool(self._trouble)

    def attempt(self, write: Callable[[], object]) -> bool:
        """Call ``write``; tell when it fails, and whether it did not."""
        try:
            write()
        except (OSError, DmpError) as error:
            gone = isinstance(error, FileNotFoundError) and not self._folder.is_dir()
            self.tell("it is no longer there" if gone else cause_of(error))
            return False
        return True

    def send(
        self,
        save_snapshot: Callable[[Snapshot], None],
        finish_curve: Callable[[], None],
        save_checkpoint: Callable[[bytes], None],
        save_choice: Callable[[int | None], None],
    ) -> None:
        """Write what waits, the checkpoint after everything that lies before it; stop at the first failure."""
        for step, snapshot in sorted(self.snapshots.items()):
            if not self.attempt(lambda snapshot=snapshot: save_snapshot(snapshot)):  # type: ignore[misc]
                return
            del self.snapshots[step]
        if not self.attempt(finish_curve):
            return
        if (content := self.checkpoint) is not None:
            if not self.attempt(lambda: save_checkpoint(content)):
                return
            self.checkpoint = None
        if (choice := self.choice) is not None:
            if not self.attempt(lambda: save_choice(choice[0])):
                return
            self.choice = None
        if self._trouble:
            self._trouble = ""
            self.told.append(f"The run folder {self._folder} can be written again, and nothing is missing in it.")

    def tell(self, cause: str) -> None:
        """Tell why the folder cannot be written, unless that is known."""
        if cause != self._trouble:
            self._trouble = cause
            self.told.append(
                f"The run folder {self._folder} cannot be written: {cause}. What is missing stays in memory and is written as "
                "soon as that works again. Save the mesh elsewhere before you leave."
            )


def cause_of(error: BaseException) -> str:
    """Return why something could not be written or read, as a clause without a period."""
    if isinstance(error, OSError):
        return in_words(error)
    return str(error).rstrip(".") or type(error).__name__
