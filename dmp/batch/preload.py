"""Loaded by worker processes before they take any work, so that none of it waits for torch, and Ctrl-C does not reach them.

``dask worker`` takes it as ``--preload dmp.batch.preload``.
"""

from __future__ import annotations

import importlib
from contextlib import suppress
from typing import Any

from dmp.batch.versions import sources_digest
from dmp.interruption import overlook_terminal
from dmp.waiting import spin_only_briefly


def dask_setup(_worker: Any) -> None:
    """Overlook what a terminal sends to all its processes, at Ctrl-C or when it is closed, and load what any work needs."""
    with suppress(ValueError):
        overlook_terminal()
    spin_only_briefly()
    # The digest is that of the sources as they are now, when they are loaded.
    sources_digest()
    for name in ("dmp.batch.doing", "dmp.completion", "dmp.runs"):
        importlib.import_module(name)
