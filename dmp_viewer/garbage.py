"""Python's search for garbage, moved to where Qt allows its objects to be destroyed."""

from __future__ import annotations

import gc

from qtpy.QtCore import QObject, QTimer

_INTERVAL_MS = 500


class GarbageCollection(QObject):
    """Looks for unreachable cycles of objects in the GUI thread, between two events.

    Python by itself looks wherever a thread has just made enough objects: in the middle of a paint, or in a training thread. A
    closed window found there takes its Qt and OpenGL objects along, which Qt forbids in any other thread, and which ends the
    process now and then.

    Args:
        application: whose event loop it works in, and with which it ends.
    """

    def __init__(self, application: QObject) -> None:
        super().__init__(application)
        # What is loaded by now stays to the end; not looking through it again makes each search short.
        gc.collect()
        gc.freeze()
        gc.disable()
        self._timer = QTimer(self)
        self._timer.setInterval(_INTERVAL_MS)
        self._timer.timeout.connect(self.look)
        self._timer.start()

    def look(self) -> None:
        """Search the generations that are due, by Python's own thresholds."""
        counts, thresholds = gc.get_count(), gc.get_threshold()
        due = [generation for generation in range(3) if counts[generation] > thresholds[generation] > 0]
        if due:
            gc.collect(due[-1])

    def close(self) -> None:
        """Leave it to Python again."""
        self._timer.stop()
        gc.unfreeze()
        gc.enable()
