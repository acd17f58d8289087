"""Sends SIGTERM, SIGINT and SIGHUP to windows and commands that are training, at random moments.

Each time: the end comes within seconds and in order (exit code 0 from a window, 130 from a command), without a traceback,
and the run is kept with the step that it had reached, stopped, whole, and ready to go on.
"""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from os import close
from pathlib import Path

import numpy as np

from dmp.errors import RunError
from dmp.meshio import write_mesh
from dmp.runs import Run
from tests.meshes import sphere_mesh
from tests.soak import Result
from tests.soak.windows import WITHOUT_DISPLAY, at_home_in, display, has_display

FULL_SIZE = 60
# From the signal to the end; a window waits four seconds for a step.
_MOST_SECONDS = 60.0
_STARTING_SECONDS = 120.0
_LONGEST_DELAY = 3.0
_SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_TRAINING = ["--steps", "100000", "--snapshot-every", "20"]


def run(size: int, seed: int) -> Result:
    """Send ``size`` signals, to a window and a command in turn."""
    failures: list[str] = []
    name = "signals of the system that end windows and commands in training"
    if not has_display():
        return Result(name, 0, 0, (WITHOUT_DISPLAY,))
    try:
        for descriptor in pty.openpty():
            os.close(descriptor)
    except OSError as error:
        return Result(name, 0, 0, (f"this system gives no terminal ({error})",))
    with tempfile.TemporaryDirectory(prefix="dmp-signals-") as folder, display() as environment:
        mesh = Path(folder) / "scan.ply"
        ball = sphere_mesh(3)
        noise = np.random.default_rng(0).standard_normal(ball.vertices.shape)
        write_mesh(mesh, ball.with_vertices(ball.vertices + 0.02 * noise))
        for number in range(size):
            generator = np.random.default_rng([seed, number])
            number_of_signal = _SIGNALS[int(generator.integers(len(_SIGNALS)))]
            delay, to_window = float(generator.uniform(0, _LONGEST_DELAY)), number % 2 == 0
            home = Path(folder) / str(number)
            home.mkdir()
            wrong = _one(mesh, home, environment, number_of_signal, delay, to_window=to_window)
            if wrong:
                what = "window" if to_window else "command"
                failures.append(f"{number}: {number_of_signal.name} to a {what} {delay:.1f} s after its first step: {wrong}")
    return Result(name, size - len(failures), size, tuple(failures))


def _one(mesh: Path, home: Path, environment: dict[str, str], number: signal.Signals, delay: float, *, to_window: bool) -> str:
    words = ["dmp_viewer", str(mesh), "--start"] if to_window else ["dmp", "denoise", str(mesh), "-o", str(home / "out.ply")]
    command = [sys.executable, "-m", *words, *_TRAINING]
    # On a terminal of its own, which is gone when it gets a SIGHUP.
    ours, theirs = pty.openpty()
    said = (home / "said.txt").open("wb")
    with _nothing_ignored():
        child = subprocess.Popen(
            command,
            env=at_home_in(home, environment),
            stdin=theirs,
            stdout=theirs,
            stderr=theirs if number is signal.SIGHUP else said,
            start_new_session=True,
        )
    close(theirs)
    try:
        run = _begun(home, child)
        if run is None:
            return f"no training began within {_STARTING_SECONDS:.0f} seconds: {(home / 'said.txt').read_text()}"
        time.sleep(delay)
        if number is signal.SIGHUP:
            close(ours)
            ours = -1
        child.send_signal(number)
        started = time.monotonic()
        try:
            code = child.wait(_MOST_SECONDS)
        except subprocess.TimeoutExpired:
            return f"it still runs after {_MOST_SECONDS:.0f} seconds"
        seconds = time.monotonic() - started
        return _looked_at(run, code, 0 if to_window else 130, (home / "said.txt").read_text(), seconds)
    finally:
        child.kill()
        child.wait()
        said.close()
        if ours >= 0:
            close(ours)


@contextmanager
def _nothing_ignored() -> Iterator[None]:
    """Undo for a child what nohup, or a shell that starts a job in the background, has every process below it ignore."""
    ignored = [number for number in _SIGNALS if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, signal.SIG_DFL)
    try:
        yield
    finally:
        for number in ignored:
            signal.signal(number, signal.SIG_IGN)


def _begun(home: Path, child: subprocess.Popen[bytes]) -> Path | None:
    """Wait until a run has its first snapshot, and return its folder."""
    deadline = time.monotonic() + _STARTING_SECONDS
    while time.monotonic() < deadline and child.poll() is None:
        for folder in (home / "xdg_data_home" / "dmp-viewer" / "runs").glob("*"):
            if any((folder / "snapshots").glob("*.npy")):
                return folder
        time.sleep(0.05)
    return None


def _looked_at(folder: Path, code: int, expected: int, said: str, seconds: float) -> str:
    if code != expected:
        return f"it ended with {code} after {seconds:.1f} seconds: {said}"
    if "Traceback" in said or "Error" in said:
        return f"it said: {said}"
    try:
        run = Run.open(folder)
        last = int(run.curve()[-1]["step"])
        if run.state != "stopped":
            return f"the run counts as {run.state}"
        # Every second step is logged, and the one where it stopped is kept.
        if run.last_step < last:
            return f"step {last} was reached, but {run.last_step} is the last one that is kept"
        for step in run.snapshot_steps():
            run.snapshot(step)
        if run.resume().step != run.last_step:
            return f"it cannot go on from step {run.last_step}"
    except RunError as error:
        return str(error)
    with suppress(StopIteration):
        leftover = next(path for path in folder.rglob("*") if path.name.startswith(".") and path.suffix == ".part")
        return f"{leftover.name} was left behind"
    return ""
