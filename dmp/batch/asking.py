"""Questions to the workers of a cluster, each of which may be halted: whoever does not answer in time holds nobody up.

dask's own ``Client.run`` waits for the last worker, however long. A process that the system has halted (SIGSTOP, a machine
that swaps or was cut off) keeps its connections, so that would be for ever.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from distributed import Client

ANSWER_SECONDS = 15.0
# A worker that did not answer is not asked again for so long while there are others; each question costs its whole patience.
_MUTE_SECONDS = 60.0
# So much longer than their own limit the answers as a whole are waited for.
_MARGIN_SECONDS = 5.0
_RESTART_SECONDS = 30.0


def ask(
    client: Client,
    function: Callable[..., Any],
    *arguments: Any,
    workers: Iterable[str] | None = None,
    seconds: float | None = None,
) -> dict[str, Any]:
    """Call a function on workers, and return their answers by address.

    Args:
        client: of their cluster.
        function: found over there by its name; it may be a coroutine function.
        arguments: of it.
        workers: addresses; by default all.
        seconds: how long each one is waited for; by default a quarter of a minute.

    Returns:
        What the function returned, or the exception that it raised; nothing of a worker that did not answer, or was gone.

    Raises:
        OSError: when the scheduler does not answer (:class:`TimeoutError` included).
    """
    patience = ANSWER_SECONDS if seconds is None else seconds

    async def ask_one(address: str) -> tuple[str, Any] | None:
        with suppress(OSError, KeyError):
            question = client._run(function, *arguments, workers=[address], on_error="return")
            found: Any = (await asyncio.wait_for(question, patience))[address]
            # A broken connection comes as an answer as well.
            return None if isinstance(found, OSError) else (address, found)
        return None

    async def ask_all() -> dict[str, Any]:
        addresses = await _addresses(client) if workers is None else list(workers)
        return dict(found for found in await asyncio.gather(*map(ask_one, addresses)) if found is not None)

    answers: dict[str, Any] = client.sync(ask_all, callback_timeout=patience + _MARGIN_SECONDS)
    return answers


async def _addresses(client: Client) -> list[str]:
    return list((await client.scheduler.identity(n_workers=-1))["workers"])


class Workers:
    """The workers of a cluster that are asked again and again, those that did not answer of late less often."""

    def __init__(self) -> None:
        self._mute: dict[str, float] = {}

    def present(self, client: Client) -> list[str]:
        """Return the addresses of all workers (raises :class:`OSError` when the scheduler does not answer)."""
        found: list[str] = client.sync(_addresses, client, callback_timeout=_MARGIN_SECONDS)
        return found

    def ask(
        self,
        client: Client,
        function: Callable[..., Any],
        *arguments: Any,
        workers: Iterable[str] | None = None,
        seconds: float | None = None,
        everybody: bool = False,
    ) -> dict[str, Any]:
        """Ask as :func:`ask` does; without ``workers`` those that answered of late, or ``everybody``."""
        now = time.monotonic()
        if workers is None:
            present = self.present(client)
            of_late = [item for item in present if now - self._mute.get(item, -_MUTE_SECONDS) >= _MUTE_SECONDS]
            workers = present if everybody or not of_late else of_late
        workers = list(workers)
        answers = ask(client, function, *arguments, workers=workers, seconds=seconds)
        self._mute |= dict.fromkeys(set(workers) - set(answers), now)
        return answers


def start_anew(client: Client, address: str) -> None:
    """Have a worker's process ended, by force if need be, and started again by its keeper, without waiting for it.

    A worker without a keeper is struck off the scheduler's list; what it had to do is given to another one.
    """

    async def restart() -> None:
        with suppress(Exception):
            await client.scheduler.restart_workers(
                workers=[address], timeout=_RESTART_SECONDS, wait_for_workers=False, on_error="return",
                stimulus_id=f"dmp-restart-{time.time()}",
            )  # fmt: skip

    asyncio.run_coroutine_threadsafe(restart(), client.loop.asyncio_loop)
