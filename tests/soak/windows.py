"""Starts what needs a display in a process of its own, with settings and runs of its own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parents[2]
WITHOUT_DISPLAY = "a window needs a display, or xvfb-run"


def has_display() -> bool:
    """Tell whether a window can be shown, on a display that is there or one that is made for it."""
    return bool(os.environ.get("DISPLAY")) or shutil.which("Xvfb") is not None


@contextmanager
def display() -> Iterator[dict[str, str]]:
    """Yield an environment with a display, made for the time being where there is none."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    if environment.get("DISPLAY"):
        yield environment
        return
    reading, writing = os.pipe()
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "1600x1000x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[writing], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(writing)
    try:
        with os.fdopen(reading) as told:
            environment["DISPLAY"] = f":{told.readline().strip()}"
        yield environment
    finally:
        server.terminate()
        server.wait()


def at_home_in(folder: Path, environment: dict[str, str]) -> dict[str, str]:
    """Return the environment with settings, runs and log in a folder, so that nothing of the user is touched."""
    names = ("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "XDG_CACHE_HOME")
    return {**environment, **{name: str(folder / name.lower()) for name in names}}


def told_by_child(module: str, *arguments: object, folder: Path, seconds: float) -> tuple[list[dict[str, Any]], str]:
    """Run a module as a program that prints lines of JSON.

    Args:
        module: its name in this package.
        arguments: of its command line.
        folder: where settings, runs and log go.
        seconds: after which it is killed.

    Returns:
        What it told, and a sentence when it did not end well.
    """
    with display() as environment:
        command = [sys.executable, "-X", "faulthandler", "-m", f"tests.soak.{module}", *map(str, arguments)]
        lines, wrong = "", ""
        with (folder / "errors.txt").open("w+", encoding="utf-8") as errors:
            child = subprocess.Popen(
                command, cwd=_ROOT, env=at_home_in(folder, environment), stdout=subprocess.PIPE, stderr=errors, text=True
            )
            try:
                lines = child.communicate(timeout=seconds)[0]
            except subprocess.TimeoutExpired:
                child.kill()
                lines = child.communicate()[0]
                wrong = f"killed after {seconds:.0f} seconds"
            errors.seek(0)
            said = errors.read().partition("Extension modules:")[0].strip()
        if not wrong and child.returncode:
            wrong = f"ended with {child.returncode}"
        told = [json.loads(line) for line in lines.splitlines() if line.startswith("{")]
        return told, f"{wrong}: {said[-3000:]}" if wrong else ""
