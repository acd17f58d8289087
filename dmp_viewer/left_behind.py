"""Threads that nobody waits for at the end of the process, and the end of a process that has left one in its work.

Before CPython 3.14, a thread that asks for the interpreter while the process ends has its stack unwound. In the middle of C++
that calls Python, as the backward pass of torch does, that ends the process with “terminate called without an active
exception” and exit code 134, after everything had gone well.
"""

from __future__ import annotations

import atexit
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any


class LeavableThread(threading.Thread):
    """A thread that may be left behind in its work: it keeps no process alive, and :func:`end_process` does not unwind it."""

    def __init__(self, name: str, target: Callable[..., object] | None = None, arguments: tuple[Any, ...] = ()) -> None:
        super().__init__(name=name, target=target, args=arguments, daemon=True)


def end_process(code: int) -> None:
    """End the process with an exit code if a thread was left behind in its work; otherwise return.

    What is registered for the end of the process is done; only the interpreter is not taken down.
    """
    if not any(isinstance(thread, LeavableThread) for thread in threading.enumerate()):
        return
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:  # there is none where a program of Windows has no console
            with suppress(OSError):  # nobody may read it any more
                stream.flush()
    os._exit(code)
