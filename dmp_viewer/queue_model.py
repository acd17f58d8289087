"""The trainings that wait for their turn: an ordered list of run folders, kept in a file. No widgets.

What waits is a run already, made when it was put here and not begun, or one that is to go on. So nothing is lost with the
list: its runs are among all others, and each can be opened and continued by hand.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from psygnal import Signal

from dmp.files import atomic_write_bytes

_LOG = logging.getLogger(__name__)
_FILE, _MOST_BYTES, _MOST_WAITING = "queue.json", 1 << 20, 1000


@dataclass(frozen=True)
class Waiting:
    """A training that waits.

    Attributes:
        folder: of its run.
        title: what its run is called.
        text: how it is to be trained, in one line.
        is_new: whether its run was made for the queue and has learnt nothing yet.
        problem: why it could not be trained; empty while it may be.
    """

    folder: Path
    title: str
    text: str
    is_new: bool = True
    problem: str = ""


class Queue:
    """What waits, in order, and whether it goes on by itself.

    Signals:
        changed: something of it is different.

    Attributes:
        items: what waits, the next one first.
        is_on: whether the next one begins as soon as a training ends.
    """

    changed = Signal()

    def __init__(self) -> None:
        self.items: list[Waiting] = []
        self.is_on = False

    @property
    def next(self) -> Waiting | None:
        """The first that may be trained."""
        return next((item for item in self.items if not item.problem), None)

    def add(self, item: Waiting) -> bool:
        """Put a training at the end; False when its run waits already."""
        if any(other.folder == item.folder for other in self.items):
            return False
        self.items.append(item)
        self.changed.emit()
        return True

    def restore(self, items: Sequence[Waiting]) -> None:
        """Bring back what waited before, in front of what waits already."""
        known = {item.folder for item in self.items}
        found = [item for item in items if item.folder not in known]
        if found:
            self.items = [*found, *self.items]
            self.changed.emit()

    def remove(self, *folders: Path) -> None:
        """Let trainings wait no longer."""
        kept = [item for item in self.items if item.folder not in folders]
        if len(kept) != len(self.items):
            self.items = kept
            self.changed.emit()

    def arrange(self, folders: Sequence[Path]) -> None:
        """Put them into another order; what is not named stays behind those that are."""
        places = {folder: place for place, folder in enumerate(folders)}
        self.items.sort(key=lambda item: places.get(item.folder, len(places)))
        self.changed.emit()

    def move(self, folder: Path, places: int) -> None:
        """Move one by so many places, negative ones towards the front."""
        order = [item.folder for item in self.items]
        if folder in order:
            before = order.index(folder)
            order.insert(min(max(before + places, 0), len(order) - 1), order.pop(before))
            self.arrange(order)

    def set_problem(self, folder: Path, problem: str) -> None:
        """Say why one could not be trained; it stays in sight, and is passed over."""
        self.items = [replace(item, problem=problem) if item.folder == folder else item for item in self.items]
        self.changed.emit()

    def set_on(self, is_on: bool) -> None:
        """Go on by itself, or not."""
        if is_on != self.is_on:
            self.is_on = is_on
            self.changed.emit()


def save_queue(folder: Path, items: Sequence[Waiting]) -> None:
    """Keep which runs wait, in the folder of all runs; a failure is logged, because the runs themselves are safe."""
    path = folder / _FILE
    try:
        if items:
            folder.mkdir(parents=True, exist_ok=True)
            names = [item.folder.name if item.folder.parent == folder else str(item.folder) for item in items]
            atomic_write_bytes(path, json.dumps({"waiting": names}, indent=2).encode())
        else:
            path.unlink(missing_ok=True)
    except OSError as error:
        _LOG.warning("%s cannot be written: %s", path, error)


def saved_queue(folder: Path) -> list[Path]:
    """Return the run folders that waited when the window was closed, in order; none when nothing usable is kept."""
    path = folder / _FILE
    try:
        if path.stat().st_size > _MOST_BYTES:
            return []
        names = json.loads(path.read_text(encoding="utf-8")).get("waiting")
    except (OSError, ValueError, AttributeError, RecursionError):
        return []
    if not isinstance(names, list):
        return []
    return [folder / name for name in names[:_MOST_WAITING] if isinstance(name, str) and name and "\0" not in name]
