"""Keeps the workers of our own clusters in their number, however they die.

dask starts a worker anew that died at work, but gives up one that dies while it is being started, and closes for good any
that needs longer than a while to come back; a cluster would lose its workers one by one, and the work would wait for ever.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from distributed import SpecCluster

_LOOK_SECONDS = 1.0
# Longer than a worker is down in the ordinary way between its end and its new beginning.
_DOWN_SECONDS = 5.0
# Loading torch takes seconds, on a machine that is very busy perhaps a minute or two.
_STARTING_SECONDS = 300.0
_CLOSING_SECONDS = 30.0


@contextmanager
def kept_up(cluster: SpecCluster) -> Iterator[None]:
    """Replace workers that are gone for good, while the block lasts."""
    done = threading.Event()
    since: dict[Any, float] = {}

    def look_on() -> None:
        while not done.wait(_LOOK_SECONDS):
            # A look that fails, for instance because no process can be made, is repeated.
            with suppress(Exception):
                cluster.sync(_look, cluster, since, callback_timeout=2 * _CLOSING_SECONDS)

    thread = threading.Thread(target=look_on, name="dmp-upkeep", daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join(2 * _CLOSING_SECONDS)


async def _look(cluster: SpecCluster, since: dict[Any, float]) -> None:
    """Take away the keepers that keep no process, and let the cluster make those anew that are missing."""
    import asyncio

    now = time.monotonic()
    for name, keeper in list(cluster.workers.items()):
        patience = _patience(keeper)
        if patience is None:
            since.pop(keeper, None)
        elif now - since.setdefault(keeper, now) >= patience:
            del since[keeper]
            cluster.workers.pop(name, None)
            with suppress(Exception):
                await asyncio.wait_for(keeper.close(timeout=_DOWN_SECONDS), _CLOSING_SECONDS)
    if set(cluster.worker_spec) - set(cluster.workers):
        await cluster._correct_state()


def _patience(keeper: Any) -> float | None:
    """Return how many seconds a keeper may stay as it is; None for as long as it likes."""
    if keeper.status.name in ("closing", "closed", "failed"):
        return 0.0
    process = keeper.process
    state = "stopped" if process is None else process.status.name
    return {"stopped": _DOWN_SECONDS, "failed": _DOWN_SECONDS, "init": _STARTING_SECONDS, "starting": _STARTING_SECONDS}.get(
        state
    )
