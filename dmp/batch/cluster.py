"""The dask cluster that does the work: one of our own on this computer, or one that is there already.

Everything listens on the loopback interface unless another host is named: whoever reaches a scheduler can run any program
on its workers.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmp.batch.upkeep import kept_up
from dmp.errors import DmpError

if TYPE_CHECKING:
    from distributed import Client

LOOPBACK = "127.0.0.1"
DEFAULT_PORT = 8786
GPU = "GPU"
_CONNECT_SECONDS = 15.0
# dask remembers the last thousand messages at each end, the meshes in them included.
_LOG_LENGTH, _FEW = "distributed.admin.low-level-log-length", 10
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
# Without these a worker's processor libraries would each take all cores before the first training says how many.
_WORKER_ENVIRONMENT = {"GOMP_SPINCOUNT": "30000", "OMP_NUM_THREADS": "1", "DASK_LOGGING__DISTRIBUTED": "critical"}


class ClusterError(DmpError):
    """A scheduler that cannot be reached or used, in the user's words."""


@dataclass(frozen=True)
class Certificates:
    """The files for a connection that is encrypted and proves who is who (TLS), as dask takes them.

    Attributes:
        ca_file: certificate of the authority that both sides trust, PEM.
        cert: our certificate, PEM.
        key: its key, PEM.
    """

    ca_file: Path
    cert: Path
    key: Path

    def security(self) -> Any:
        """Return what dask wants to be given (raises :class:`ClusterError` when a file is missing)."""
        from distributed import Security

        for path in (self.ca_file, self.cert, self.key):
            if not path.is_file():
                raise ClusterError(f"{path}: there is no such file. A TLS connection needs it.")
        names = {"tls_ca_file": str(self.ca_file)}
        for role in ("client", "scheduler", "worker"):
            names |= {f"tls_{role}_cert": str(self.cert), f"tls_{role}_key": str(self.key)}
        return Security(require_encryption=True, **names)


def certificates(ca_file: Path | None, cert: Path | None, key: Path | None) -> Certificates | None:
    """Return the files that were named, None when none was (raises :class:`ClusterError` when one of three is missing)."""
    if ca_file is None and cert is None and key is None:
        return None
    if ca_file is None or cert is None or key is None:
        raise ClusterError("An encrypted connection needs all three: --tls-ca-file, --tls-cert and --tls-key.")
    return Certificates(ca_file, cert, key)


def quiet_logs() -> None:
    """Keep dask from writing about lost workers into the terminal: who watches is told in our words."""
    for name in (
        "distributed",
        "distributed.nanny",
        "distributed.scheduler",
        "distributed.worker",
        "distributed.client",
        "tornado",
    ):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def connect(address: str, tls: Certificates | None = None, *, timeout: float | None = None) -> Client:
    """Return a client of the scheduler at ``address``.

    Args:
        address: such as ``tcp://127.0.0.1:8786``; without a protocol it is ``tcp``, or ``tls`` with certificates.
        tls: files for an encrypted connection; without them those of dask's own configuration are taken.
        timeout: seconds to wait for an answer; by default a quarter of a minute.

    Raises:
        ClusterError: when nobody answers there, or who answers cannot be understood.
    """
    import dask
    from distributed import Client

    address = full_address(address, encrypted=tls is not None)
    quiet_logs()
    try:
        options = {} if tls is None else {"security": tls.security()}
        with dask.config.set({_LOG_LENGTH: _FEW}):
            return Client(address, timeout=timeout or _CONNECT_SECONDS, set_as_default=False, **options)
    except MemoryError as error:
        # The first bytes of any other protocol are taken for the length of a message.
        raise ClusterError(
            f"What answers at {address} is no scheduler of dask. A scheduler has two addresses: take the one that begins with "
            "tcp or tls, not that of its web page."
        ) from error
    except (OSError, ValueError, TypeError, ImportError, RuntimeError) as error:
        cause = " ".join(str(error).split())[:200] or type(error).__name__
        raise ClusterError(
            f"The scheduler at {address} cannot be reached ({cause}). Is 'dmp serve' running over there, is the address right, "
            "and is the tunnel open?"
        ) from error


def full_address(text: str, *, encrypted: bool = False) -> str:
    """Return an address as dask wants it: ``server`` becomes ``tcp://server:8786`` (raises :class:`ClusterError`)."""
    text = text.strip()
    protocol, separator, rest = text.rpartition("://")
    protocol = protocol if separator else "tls" if encrypted else "tcp"
    host, colon, port = rest.rpartition(":")
    if not colon or rest.endswith("]"):
        host, port = rest, str(DEFAULT_PORT)
    if protocol not in ("tcp", "tls", "ws", "wss") or not host or not port.isdecimal() or any(c.isspace() for c in host):
        raise ClusterError(f"'{text}' is no address of a scheduler. It looks like tcp://127.0.0.1:8786.")
    return f"{protocol}://{host}:{port}"


def worker_options(
    *, gpu: int | None = None, environment: Mapping[str, str] | None = None, memory_limit: int = 0
) -> dict[str, Any]:
    """Return the options of a worker process: one training at a time, and with ``gpu`` that GPU for its own."""
    import dask

    env = {**_WORKER_ENVIRONMENT, **(environment or {})}
    options: dict[str, Any] = {"nthreads": 1, "host": LOOPBACK, "memory_limit": memory_limit, "env": env}
    # The status pages are neither encrypted nor needed: they stay on this computer, whatever the host.
    options["dashboard_address"] = f"{LOOPBACK}:0"
    if gpu is not None:
        env["CUDA_VISIBLE_DEVICES"] = str(gpu)
        options["resources"] = {GPU: 1}
    options["config"] = dask.config.config
    return options


@contextmanager
def local_client(
    n_workers: int,
    *,
    worker_ttl: str = "60 s",
    environment: Mapping[str, str] | None = None,
    memory_limit: int = 0,
) -> Iterator[Client]:
    """Yield a client of a cluster on this computer that lives as long as the block, with one training at a time a worker.

    Args:
        n_workers: worker processes; one that dies is started anew, as often as it takes.
        worker_ttl: after such a silence a worker is given up.
        environment: variables of the worker processes beside those they inherit.
        memory_limit: bytes above which a worker is killed; 0 for no such limit.

    Raises:
        ClusterError: when it cannot be started.
    """
    import dask
    from distributed import Client, LocalCluster

    quiet_logs()
    with dask.config.set(dask_config(worker_ttl)):
        try:
            options = worker_options(environment=environment, memory_limit=memory_limit)
            cluster = LocalCluster(
                n_workers=n_workers,
                threads_per_worker=options["nthreads"],
                host=LOOPBACK,
                memory_limit=options["memory_limit"],
                env=options["env"],
                dashboard_address=f"{LOOPBACK}:0",
                silence_logs=logging.CRITICAL + 1,
            )
        except (OSError, RuntimeError) as error:
            raise ClusterError(f"No worker processes can be started here ({error}).") from error
        try:
            with kept_up(cluster), Client(cluster, set_as_default=False) as client:
                yield client
        finally:
            with suppress(Exception):
                cluster.close(timeout=10)


def dask_config(worker_ttl: str) -> dict[str, Any]:
    """Return what we set otherwise than dask does."""
    return {
        # One training at a time: nothing waits on a worker that could begin on another one.
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.scheduler.worker-ttl": worker_ttl,
        # After that dask would close a worker for good that takes its time to come back; we look after them ourselves.
        "distributed.deploy.lost-worker-timeout": "1000 days",
        # A profile of what our few long tasks do helps nobody and costs time.
        "distributed.worker.profile.enabled": False,
        "distributed.worker.preload": ["dmp.batch.preload"],
        # Not dask's MALLOC_TRIM_THRESHOLD_: memory that each training step gives back and takes again costs a fifth of its
        # time.
        "distributed.nanny.pre-spawn-environ": dict.fromkeys(_THREAD_VARIABLES, "1"),
        # Looking after itself fifty times a second took 1.9 % of a core in each worker; so it is 0.4 %.
        "distributed.admin.tick.interval": "500ms",
        _LOG_LENGTH: _FEW,
        "distributed.admin.system-monitor.interval": "1s",
        "logging": {"distributed": "critical", "distributed.nanny": "critical", "distributed.worker": "critical"},
    }


def wait_for_workers(client: Client, seconds: float) -> int:
    """Wait until at least one worker is there; return how many there are (0 after ``seconds`` without one)."""
    deadline = time.monotonic() + seconds
    while True:
        count = len(client.nthreads())
        if count or time.monotonic() > deadline:
            return count
        time.sleep(0.1)
