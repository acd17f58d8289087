"""A process that ends while a thread of its own is in the middle of torch: quietly, and with its own exit code."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

# A step that never ends: in the backward pass torch's C++ calls Python, which is where unwinding the stack ends a process.
_STEP = """
import atexit, sys, threading, time
import torch

inside = threading.Event()

class Endless(torch.autograd.Function):
    @staticmethod
    def forward(ctx, values):
        return values.clone()

    @staticmethod
    def backward(ctx, gradient):
        inside.set()
        while True:
            time.sleep(0.001)

def step():
    Endless.apply(torch.ones(3, requires_grad=True)).sum().backward()
"""

_THREAD = """
from dmp_viewer.left_behind import LeavableThread, end_process

atexit.register(print, "registered")
end_process(5)
print("nothing was left behind")
LeavableThread("endless", step).start()
inside.wait()
print("said last", end="")
end_process(3)
"""

_WINDOW = """
import dataclasses, os, signal
from dmp_viewer import shutdown, tasks
from dmp_viewer.__main__ import main

def endless(session):
    yield next(session.records)
    step()

def start_session(*arguments, _start=tasks.start_session, **more):
    session = _start(*arguments, **more)
    return dataclasses.replace(session, records=endless(session))

def end():
    inside.wait()
    os.kill(os.getpid(), signal.SIGTERM)

tasks.start_session = start_session
shutdown._SECONDS = 0.2
threading.Thread(target=end, daemon=True).start()
sys.exit(main([*sys.argv[1:], "--start"]))
"""


def _run(code: str, *arguments: object) -> tuple[int, str, str]:
    command = [sys.executable, "-c", _STEP + code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stdout, done.stderr


def test_a_process_that_has_left_a_thread_in_its_work_ends_with_its_own_exit_code() -> None:
    assert _run(_THREAD) == (3, "nothing was left behind\nsaid lastregistered\n", "")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot send these signals to itself")
@pytest.mark.usefixtures("qapp")  # for the display
def test_a_window_closed_during_a_step_that_hangs_ends_quietly(mesh_files: tuple[Path, Path]) -> None:
    assert _run(_WINDOW, mesh_files[0]) == (0, "", "")
