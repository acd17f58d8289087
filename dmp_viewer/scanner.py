"""Goes through many snapshots in a thread of its own: for the range of a whole run, the history of a vertex, small pictures.

What is asked for under a name takes the place of what was asked for under it before, so that nothing piles up while
somebody moves quickly. Reading a snapshot and working on it both happen in the thread; only results come back.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from qtpy.QtCore import QObject

from dmp.errors import DmpError
from dmp.mesh import FloatArray
from dmp.snapshot import Snapshot
from dmp_viewer.background import Background
from dmp_viewer.model import Workspace

_LOG = logging.getLogger(__name__)
# Results come back in bundles of about this long: often enough to be seen growing, seldom enough to cost nothing.
_BUNDLE_SECONDS = 0.05


@dataclass(eq=False)
class _Scan:
    steps: list[int]
    work: Callable[[FloatArray], Any]
    done: Callable[[int, Any], None]
    is_over: bool = field(default=False)


class SnapshotScanner(QObject):
    """Works on the snapshots of the run on show.

    Args:
        workspace: whose run it is.
        parent: of this object.
    """

    def __init__(self, workspace: Workspace, parent: QObject) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self._background = Background(self)
        self._scans: dict[str, _Scan] = {}
        self._is_working = False
        workspace.problem_changed.connect(self.cancel, check_nargs=False)
        workspace.run_changed.connect(self.cancel, check_nargs=False)

    def scan(
        self, name: str, steps: Sequence[int], work: Callable[[FloatArray], Any], done: Callable[[int, Any], None]
    ) -> None:
        """Call ``work`` with the positions of each step in another thread, and ``done`` with step and result in this one.

        Args:
            name: whose wish it is; an older one of that name is given up.
            steps: in the order of their importance. A snapshot that cannot be read is left out.
            work: gets positions, (V, 3), file units; must change nothing.
            done: gets what ``work`` returned.
        """
        self._end(name)
        if steps:
            self._scans[name] = _Scan(list(steps), work, done)
            self._go_on()

    def cancel(self) -> None:
        """Give up everything."""
        for name in list(self._scans):
            self._end(name)

    def wait(self, seconds: float) -> bool:
        """Pump events until nothing is to be done; tells whether that was reached in time."""
        deadline = time.monotonic() + seconds
        while self._scans and time.monotonic() < deadline:
            self._background.wait(0.1)
        return not self._scans

    def close(self) -> None:
        """Give up everything and end the thread."""
        self.cancel()
        self._background.close()

    def _end(self, name: str) -> None:
        scan = self._scans.pop(name, None)
        if scan is not None:
            scan.is_over = True

    def _go_on(self) -> None:
        if self._is_working or not self._scans:
            return
        name, scan = next(iter(self._scans.items()))
        run = self._workspace.run
        if run is None:
            self._end(name)
            return
        # What is in memory is handed over; the rest is read in the thread.
        known = {step: self._workspace.snapshot_in_memory(step) for step in scan.steps}
        self._is_working = True
        self._background.submit(
            "", lambda: _bundle(scan, known, run.snapshot), lambda found: self._on_done(name, scan, found), self._on_failed
        )

    def _on_done(self, name: str, scan: _Scan, found: list[tuple[int, Any]]) -> None:
        self._is_working = False
        for step, result in found:
            if scan.is_over:
                break
            scan.done(step, result)
        if not scan.steps and self._scans.get(name) is scan:
            self._end(name)
        self._go_on()

    def _on_failed(self, error: Exception) -> None:
        self._is_working = False
        _LOG.error("The snapshots cannot be worked on", exc_info=error)
        self.cancel()


def _bundle(scan: _Scan, known: dict[int, Snapshot | None], read: Callable[[int], Snapshot]) -> list[tuple[int, Any]]:
    """Work on as many steps as fit into a bundle; they are taken from the list."""
    found: list[tuple[int, Any]] = []
    end = time.monotonic() + _BUNDLE_SECONDS
    while scan.steps and not scan.is_over:
        step = scan.steps.pop(0)
        try:
            snapshot = known.get(step) or read(step)
        except DmpError as error:
            _LOG.info("Step %d is left out: %s", step, error)
            continue
        found.append((step, scan.work(snapshot.vertices)))
        if time.monotonic() > end:
            break
    return found
