"""A server for tests: ``dmp serve`` in a process of its own, and a cable to it that can be cut."""

from __future__ import annotations

import os
import selectors
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dmp.batch.versions import sources_digest


@contextmanager
def served(folder: Path, *, workers: int = 1, port: int = 0) -> Iterator[int]:
    """Start ``dmp serve`` with its own data folder; yield the port of its scheduler, any free one unless it is named."""
    # Sources may have been edited since the tests began; the server reads them now.
    sources_digest.cache_clear()
    environment = {**os.environ, "XDG_DATA_HOME": str(folder / "data"), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "dmp", "serve", "--port", str(port), "--workers", str(workers), "--no-gpus"]
    with (folder / "serve.log").open("wb") as log:
        process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=log, start_new_session=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline().decode()
        assert "tcp://127.0.0.1:" in line, (folder / "serve.log").read_text()
        yield int(line.rsplit(":", 1)[1])
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait(5)
        process.stdout.close()  # type: ignore[union-attr]


class Cable:
    """Passes on what comes to a port of its own, as an SSH tunnel does, until it is cut.

    Args:
        port: where it leads.
    """

    def __init__(self, port: int) -> None:
        self._target = port
        self._selector = selectors.DefaultSelector()
        self._pairs: dict[socket.socket, socket.socket] = {}
        self._is_whole = True
        self._ends = False
        self._lock = threading.Lock()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._pass_on, daemon=True)
        self._thread.start()

    def cut(self) -> None:
        """Break all connections, and let none be made."""
        with self._lock:
            self._is_whole = False
            for end in list(self._pairs):
                self._drop(end)

    def mend(self) -> None:
        """Let connections be made again."""
        self._is_whole = True

    def close(self) -> None:
        """End it."""
        self.cut()
        self._ends = True
        self._thread.join(5)
        self._listener.close()
        self._selector.close()

    def _pass_on(self) -> None:
        while not self._ends:
            for key, _ in self._selector.select(0.1):
                with self._lock:
                    end = key.fileobj
                    assert isinstance(end, socket.socket)
                    if end is self._listener:
                        self._join(*self._listener.accept())
                    elif end in self._pairs:
                        self._copy(end)

    def _join(self, near: socket.socket, _address: object) -> None:
        if not self._is_whole:
            near.close()
            return
        far = socket.create_connection(("127.0.0.1", self._target))
        self._pairs |= {near: far, far: near}
        for end in (near, far):
            self._selector.register(end, selectors.EVENT_READ)

    def _copy(self, end: socket.socket) -> None:
        try:
            content = end.recv(1 << 16)
            if content:
                self._pairs[end].sendall(content)
                return
        except OSError:
            pass
        self._drop(end)

    def _drop(self, end: socket.socket) -> None:
        for one in (end, self._pairs.get(end)):
            if one is not None and self._pairs.pop(one, None) is not None:
                self._selector.unregister(one)
                one.close()
