"""Signals as wishes: noted once, obeyed at once when repeated, and not heard where the system has them ignored."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from dmp.interruption import interruption

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="this system has no SIGHUP")
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture(autouse=True)
def ordinary_handlers() -> Iterator[None]:
    """Whatever the tests were started from: nothing is ignored, and everything is as before in the end."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in SIGNALS}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS)
def test_the_first_is_noted_and_the_handlers_are_given_back(number: signal.Signals) -> None:
    before = [signal.getsignal(item) for item in SIGNALS]
    with interruption() as stop:
        assert not stop.is_set()
        signal.raise_signal(number)
        assert stop.is_set()
    assert [signal.getsignal(item) for item in SIGNALS] == before


@pytest.mark.parametrize("second", [signal.SIGINT, signal.SIGTERM])
def test_the_second_ends_it(second: signal.Signals) -> None:
    with pytest.raises(KeyboardInterrupt), interruption():
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(second)
    assert signal.getsignal(second) is not signal.SIG_IGN


def test_a_terminal_that_is_closed_says_so_twice() -> None:
    with interruption() as stop:
        signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGHUP)
        assert stop.is_set()


def test_what_is_ignored_stays_so() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with interruption() as stop:
        signal.raise_signal(signal.SIGHUP)
        assert not stop.is_set()
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def test_another_thread_hears_nothing() -> None:
    found: list[object] = []

    def look() -> None:
        with interruption() as stop:
            found.extend([stop.is_set(), signal.getsignal(signal.SIGHUP)])

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert found == [False, signal.SIG_DFL]


CHILD = """
import sys, time
from dmp.interruption import interruption
with interruption() as stop:
    print("ready", flush=True)
    while not stop.wait(0.05):
        pass
    for _ in range(3):
        print("said to nobody", flush=True)
        print("likewise", file=sys.stderr, flush=True)
    open(sys.argv[1], "w").write("saved")
sys.exit(130)
"""


def test_what_is_said_to_a_terminal_that_is_gone_is_no_error(tmp_path: Path) -> None:
    try:
        ours, theirs = os.openpty()
    except OSError:
        pytest.skip("this system gives no terminal")
    command = [sys.executable, "-c", CHILD, str(tmp_path / "kept")]
    child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=theirs, stderr=theirs)
    os.close(theirs)
    try:
        said = b""
        while b"ready" not in said:
            said += os.read(ours, 100)
        child.send_signal(signal.SIGHUP)
        os.close(ours)
        ours = -1
        assert child.wait(20) == 130
        assert (tmp_path / "kept").read_text() == "saved"
    finally:
        child.kill()
        child.wait()
        if ours >= 0:
            os.close(ours)
