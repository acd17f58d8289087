"""The queue belongs to one window at a time: a lock beside its file, which the system drops when a window ends in whatever way.

Two windows that both wrote the file would forget each other's trainings. Whoever holds the lock reads and writes it, everybody
else only looks.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from pathlib import Path

from dmp.run_files import RunLock
from dmp.run_folder import RunFolder
from dmp_viewer.queue_model import Waiting, save_queue, saved_queue

_LOG = logging.getLogger(__name__)
# A folder, because it is the lock of a folder; without a run.json nobody takes it for a run.
_LOCKED = ".queue"


class QueueFile:
    """What waits, as it is kept in the folder of all runs.

    Args:
        folder: of all runs.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = RunLock(RunFolder(folder / _LOCKED))
        self._is_ours = False

    @property
    def is_ours(self) -> bool:
        """Whether this window may change the queue."""
        return self._is_ours

    @property
    def is_anothers(self) -> bool:
        """Whether another window holds the queue."""
        return not self._is_ours and self._lock.is_held_by_anyone()

    def take(self) -> bool:
        """Make the queue that of this window; False when it is that of another one."""
        if not self._is_ours:
            try:
                (self._folder / _LOCKED).mkdir(parents=True, exist_ok=True)
                # Another window that only looks holds the lock for an instant.
                for pause in (0.0, 0.02, 0.04):
                    time.sleep(pause)
                    self._is_ours = self._lock.acquire()
                    if self._is_ours:
                        break
            except OSError as error:
                # Where nothing can be written, no other window can write either.
                _LOG.warning("The queue cannot be locked: %s", error)
                self._is_ours = True
        return self._is_ours

    def release(self) -> None:
        """Leave the queue to whoever wants it."""
        self._lock.release()
        self._is_ours = False

    def folders(self) -> list[Path]:
        """Return the run folders that wait, in order, whoever put them there."""
        return saved_queue(self._folder)

    def save(self, items: Sequence[Waiting]) -> None:
        """Keep what waits; only the window that holds the queue does."""
        assert self._is_ours
        save_queue(self._folder, items)
