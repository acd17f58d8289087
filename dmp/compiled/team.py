"""How many threads share a launch whose parts wait for each other."""

from __future__ import annotations

import statistics
from collections import deque

# What may be missing of the processor's time for all threads, in threads; more means that others want the cores.
_UNDISTURBED = 0.3
# Launches whose median counts; and launches before a trial: the very first, one after another that was kept, and at most.
_LOOKS, _FIRST_PAUSE, _PAUSE, _LONGEST_PAUSE = 3, 4, 16, 512
# What a trial must win to be kept, and what it may take before it is broken off.
_WORTH, _TOO_LONG = 0.95, 1.5


class Team:
    """Chooses the number of threads by what launches have taken.

    Where other programs want the cores, threads that wait for each other a hundred times a launch are slower than one by far,
    because at each time one of them may have to wait until it is given a core again. So when the processor is shared, half the
    threads are tried, and when it seems to be free again, twice as many; what is quicker stays. The parts of the work are the
    same, so this changes no digit.

    Attributes:
        size: threads for the next launch.
    """

    def __init__(self, most: int) -> None:
        """Begin with ``most`` threads, of which there are never more."""
        self._most = self.size = most
        self._recent: deque[float] = deque(maxlen=_LOOKS)
        # The size before a trial, and what a launch took with it.
        self._before: tuple[int, float] | None = None
        self._pause, self._since = _FIRST_PAUSE, 0

    def took(self, seconds: float, processor_seconds: float) -> None:
        """Take note of a launch: its time on the clock, and what the processor spent on this process meanwhile."""
        self._recent.append(seconds)
        self._since += 1
        if self._before is not None and seconds > _TOO_LONG * self._before[1]:
            self._go_back(self._before[0])
        if len(self._recent) < _LOOKS:
            return
        typical = statistics.median(self._recent)
        is_disturbed = processor_seconds < (self.size - _UNDISTURBED) * seconds
        if self._before is not None:
            if typical < _WORTH * self._before[1]:
                self._before, self._pause, self._since = None, _PAUSE, 0
            elif is_disturbed and 1 < self.size < self._before[0]:
                # Still too many, it may be.
                self.size //= 2
                self._recent.clear()
            else:
                self._go_back(self._before[0])
        elif self._since >= self._pause and is_disturbed and self.size > 1:
            self._try(self.size // 2, typical)
        elif self._since >= self._pause and not is_disturbed and self.size < self._most:
            self._try(min(self._most, 2 * self.size), typical)

    def _try(self, size: int, typical: float) -> None:
        self._before = self.size, typical
        self.size = size
        self._recent.clear()

    def _go_back(self, size: int) -> None:
        self._before, self.size, self._since = None, size, 0
        self._pause = min(_LONGEST_PAUSE, max(_PAUSE, 2 * self._pause))
        self._recent.clear()
