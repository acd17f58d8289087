"""Work for workers of the tests: they find it by its name."""

from __future__ import annotations

import os
import signal
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from dmp.batch.doing import Interrupted
from dmp.batch.engine import Work, _Attempt, _State


def answer(value: int, **_: object) -> int:
    return value


def die(**_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def fail(text: str, **_: object) -> None:
    raise RuntimeError(text)


def use_up(**_: object) -> None:
    raise MemoryError


def grow(limit: int, **_: object) -> int:
    """Take more and more memory, up to a limit that keeps the machine safe when nobody minds."""
    taken = []
    while len(taken) * 2**24 < limit:
        taken.append(b"x" * 2**24)
        time.sleep(0.02)
    time.sleep(5)
    return len(taken)


def wait(seconds: float, *, stop: Callable[[], bool], told: Callable[[float], object], **_: object) -> float:
    """Do nothing, and tell how far it is."""
    began = time.monotonic()
    while (passed := time.monotonic() - began) < seconds:
        told(passed / seconds)
        if stop():
            raise Interrupted
        time.sleep(0.02)
    return seconds


def tell_often() -> int:
    from dmp.batch import attending

    attending._TOLD_EVERY_SECONDS = 0.1
    return os.getpid()


def send(pid: int, number: int) -> None:
    os.kill(pid, number)


def state_of(todo: list[Work]) -> _State:
    return _State(deque(todo))


def begin(state: _State, work: Work) -> None:
    future: Any = None
    state.under_way[work.name] = _Attempt(work, future, [], time.monotonic())
