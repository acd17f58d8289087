"""Work for workers of the tests: they find it by its name."""

from __future__ import annotations

import os
import signal
import time
from collections import deque
from typing import Any

from dmp.batch.engine import Work, _Attempt, _State


def answer(value: int, **_: object) -> int:
    return value


def die(**_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def fail(text: str, **_: object) -> None:
    raise RuntimeError(text)


def use_up(**_: object) -> None:
    raise MemoryError


def state_of(todo: list[Work]) -> _State:
    return _State(deque(todo))


def begin(state: _State, work: Work) -> None:
    future: Any = None
    state.under_way[work.name] = _Attempt(work, future, [], time.monotonic())
