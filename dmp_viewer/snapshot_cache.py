"""Snapshots kept in memory within a limit."""

from __future__ import annotations

from collections import OrderedDict

from dmp.snapshot import Snapshot


class SnapshotCache:
    """The snapshots looked at lately, bounded in bytes; others come from the run folder again."""

    def __init__(self, most_bytes: int = 192 * 1024**2) -> None:
        self._most_bytes = most_bytes
        self._bytes = 0
        self._snapshots: OrderedDict[int, Snapshot] = OrderedDict()

    def put(self, snapshot: Snapshot) -> None:
        """Add or refresh a snapshot, dropping the oldest ones when it becomes too much."""
        previous = self._snapshots.pop(snapshot.step, None)
        self._bytes += snapshot.vertices.nbytes - (previous.vertices.nbytes if previous is not None else 0)
        self._snapshots[snapshot.step] = snapshot
        while self._bytes > self._most_bytes and len(self._snapshots) > 1:
            _, dropped = self._snapshots.popitem(last=False)
            self._bytes -= dropped.vertices.nbytes

    def get(self, step: int) -> Snapshot | None:
        """Return the snapshot of a step when it is here."""
        return self._snapshots.get(step)

    def clear(self) -> None:
        """Forget everything."""
        self._snapshots.clear()
        self._bytes = 0
