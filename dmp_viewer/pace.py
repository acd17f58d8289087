"""Who comes first where window and training want the processor: what the choice of the user changes, and how it is kept.

======================  ==============================================  ============================================
                        Smooth window                                   Fast training
======================  ==============================================  ============================================
while somebody works    the training rests between two steps            goes on
news of the training    20 times a second                               once a second, so that less is drawn
priority of its thread  lower than that of the window (Linux)           the same
cores of a new run      all but one                                     all
======================  ==============================================  ============================================
"""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Callable
from enum import Enum

_LOG = logging.getLogger(__name__)

# So long after the last movement of a hand the training goes on; two movements of one drag are closer together.
_REST_SECONDS = 0.25
# Whoever turns a mesh for minutes gets a step a second all the same.
_LONGEST_REST = 1.0
_LOOK_SECONDS = 0.01
_NICENESS = 5


class Pace(Enum):
    """Who comes first."""

    SMOOTH = "smooth"
    FAST = "fast"

    @property
    def drain_interval_ms(self) -> int:
        """How often the window looks for news while a training runs."""
        return 50 if self is Pace.SMOOTH else 1000


class Courtesy:
    """What the window asks of the training thread: rest while somebody works, and let the window go first.

    Attributes:
        pace: what the user chose; read by the training thread, a single reference and so never half changed.
    """

    def __init__(self) -> None:
        self.pace = Pace.SMOOTH
        self._until = 0.0
        self._lowered: bool | None = None
        self._thread: int | None = None

    def ask(self) -> None:
        """Somebody works in the window right now. For the window's thread."""
        self._until = time.monotonic() + _REST_SECONDS

    def rest(self, is_over: Callable[[], bool]) -> float:
        """Wait as long as is asked, at most a second; returns the seconds waited. For the training thread, between steps."""
        started = time.monotonic()
        while self.pace is Pace.SMOOTH and not is_over():
            now = time.monotonic()
            if now >= self._until or now - started >= _LONGEST_REST:
                break
            time.sleep(_LOOK_SECONDS)
        return time.monotonic() - started

    def keep_priority(self) -> None:
        """Let the window go first, or not; only on Linux does niceness belong to a single thread. For the training thread."""
        lowered, thread = self.pace is Pace.SMOOTH, threading.get_native_id()
        if thread != self._thread:
            self._thread, self._lowered = thread, False
        if sys.platform != "linux" or lowered is self._lowered:
            return
        self._lowered = lowered
        try:
            os.setpriority(os.PRIO_PROCESS, thread, _NICENESS if lowered else 0)
        except OSError:
            # Most users may lower a priority but not raise it again; the next training begins with the one that is wanted.
            _LOG.debug("The training thread keeps its priority", exc_info=True)
