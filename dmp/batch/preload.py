"""Loaded by worker processes before they take any work, so that none of it waits for torch, and Ctrl-C does not reach them.

``dask worker`` takes it as ``--preload dmp.batch.preload``.
"""

from __future__ import annotations

import importlib
import signal
from contextlib import suppress
from typing import Any

from dmp.waiting import spin_only_briefly


def dask_setup(_worker: Any) -> None:
    """Overlook a Ctrl-C, which a terminal sends to all its processes, and load what any work needs."""
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    spin_only_briefly()
    for name in ("dmp.batch.doing", "dmp.completion", "dmp.runs"):
        importlib.import_module(name)
