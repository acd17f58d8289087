"""Ctrl-C, a request to end and a closed terminal as wishes: noted, so that whatever is under way can end cleanly."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

# Windows has no SIGHUP.
_HANGUP = getattr(signal, "SIGHUP", None)
_SIGNALS = tuple(number for number in (signal.SIGINT, signal.SIGTERM, _HANGUP) if number is not None)


@contextmanager
def interruption() -> Iterator[threading.Event]:
    """Yield an event that the first SIGINT, SIGTERM or SIGHUP sets; a second one ends the process in the ordinary way.

    A SIGHUP that is ignored, as by ``nohup``, stays so. With a SIGHUP the terminal is gone: what is written there
    from then on goes nowhere, so that it cannot become an error that keeps from saving. In another thread than the main one
    nothing is heard: whoever called us handles signals.

    Raises:
        KeyboardInterrupt: inside the block, at a second SIGINT or SIGTERM.
    """
    stop = threading.Event()

    def note(number: int, frame: FrameType | None) -> None:
        if number == _HANGUP:
            while terminals:
                _silence(terminals.pop())
        elif stop.is_set():
            raise KeyboardInterrupt
        # A shell that is closed sends its SIGHUP after that of the system, so a second one is no impatience.
        stop.set()

    terminals = [descriptor for descriptor in (1, 2) if os.isatty(descriptor)]
    before = {}
    if threading.current_thread() is threading.main_thread():
        heard = [number for number in _SIGNALS if number != _HANGUP or signal.getsignal(number) is not signal.SIG_IGN]
        before = {number: signal.signal(number, note) for number in heard}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def overlook_terminal() -> None:
    """Let this process, a helper of one that ends it in good time, outlive what a terminal sends to all its processes."""
    for number in _SIGNALS:
        if number != signal.SIGTERM:
            signal.signal(number, signal.SIG_IGN)


def _silence(descriptor: int) -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, descriptor)
    finally:
        os.close(nowhere)
