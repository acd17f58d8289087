"""How far a long export is, and whether it is still wanted."""

from __future__ import annotations

from collections.abc import Callable

from dmp.errors import DmpError


class CancelledError(DmpError):
    """An export that was given up; nothing was written."""


class Watch:
    """Follows an export. One thread works and tells, any other may cancel.

    Args:
        tell: called in the working thread with what is being done, how many parts are done, and of how many.
    """

    def __init__(self, tell: Callable[[str, int, int], None] | None = None) -> None:
        self._tell = tell
        self._is_cancelled = False
        self._at_cancel: Callable[[], None] | None = None

    def tell(self, text: str, done: int = 0, total: int = 0) -> None:
        """Tell how far it is; a total of 0 means that nobody knows (raises :class:`CancelledError`)."""
        self.check()
        if self._tell is not None:
            self._tell(text, done, total)

    def check(self) -> None:
        """Raise :class:`CancelledError` when it is no longer wanted."""
        if self._is_cancelled:
            raise CancelledError("The export was cancelled; nothing was written.")

    @property
    def is_cancelled(self) -> bool:
        """Whether it is no longer wanted."""
        return self._is_cancelled

    def cancel(self) -> None:
        """Give it up as soon as possible."""
        self._is_cancelled = True
        interrupt = self._at_cancel
        if interrupt is not None:
            interrupt()

    def interrupt_with(self, interrupt: Callable[[], None] | None) -> None:
        """Have this called at once when it is cancelled, because the work itself waits for something; None for nothing."""
        self._at_cancel = interrupt
        if interrupt is not None and self._is_cancelled:
            interrupt()
