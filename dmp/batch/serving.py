"""A scheduler with workers on this computer, for others to use: ``dmp serve``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from dmp.batch.cluster import DEFAULT_PORT, LOOPBACK, Certificates, ClusterError, dask_config, quiet_logs, worker_options
from dmp.batch.upkeep import kept_up

_WORKER_TTL = "60 s"


@dataclass(frozen=True)
class Service:
    """What is offered, and where.

    Attributes:
        host: the address to listen on; only this computer reaches the loopback address.
        port: 0 for any free one.
        n_workers: worker processes without a GPU; 0 for one for each core, or none where there are GPUs.
        gpus: whether each GPU gets a worker of its own.
        tls: files for encrypted connections.
    """

    host: str = LOOPBACK
    port: int = DEFAULT_PORT
    n_workers: int = 0
    gpus: bool = True
    tls: Certificates | None = None


@contextmanager
def serving(service: Service) -> Iterator[tuple[str, list[str]]]:
    """Start a scheduler and workers, for as long as the block lasts.

    Yields:
        The address of the scheduler, and what each worker is, in words.

    Raises:
        ClusterError: when it cannot be started, for instance because the port is taken.
    """
    import dask
    from distributed import Nanny, Scheduler, SpecCluster

    quiet_logs()
    security = None if service.tls is None else service.tls.security()
    with dask.config.set(dask_config(_WORKER_TTL)):
        options: dict[str, Any] = {"host": service.host}
        if security is not None:
            options |= {"security": security, "protocol": "tls"}
        workers, words = {}, []
        for number, gpu in enumerate(_what_to_start(service)):
            workers[number] = {"cls": Nanny, "options": {**worker_options(gpu=gpu), **options}}
            words.append("processor" if gpu is None else f"GPU {gpu}")
        scheduler = {"cls": Scheduler, "options": {**options, "port": service.port, "dashboard_address": f"{LOOPBACK}:0"}}
        try:
            cluster = SpecCluster(workers=workers, scheduler=scheduler, security=security, silence_logs=False)
        except (OSError, RuntimeError, ValueError) as error:
            cause = " ".join(str(error).split())[:200]
            raise ClusterError(
                f"No scheduler can be started at {service.host}:{service.port} ({cause}). Is one running already? Name another "
                "--port."
            ) from error
        try:
            with kept_up(cluster):
                yield cluster.scheduler_address, words
        finally:
            with suppress(Exception):
                cluster.close(timeout=15)


def _what_to_start(service: Service) -> list[int | None]:
    """Return the number of a GPU for each worker that gets one, and None for each other."""
    gpus: list[int | None] = list(range(_gpu_count())) if service.gpus else []
    if service.n_workers or gpus:
        return gpus + [None] * service.n_workers
    from dmp.devices import available_cores

    return [None] * available_cores()


def _gpu_count() -> int:
    import torch

    return torch.cuda.device_count() if torch.cuda.is_available() else 0
