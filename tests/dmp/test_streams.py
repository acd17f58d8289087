"""Outputs that cannot be written to, closed streams, folders that are gone: the work is done, and the rest is a sentence."""

from __future__ import annotations

import errno
import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dmp.cli import main
from dmp.commands import streams
from dmp.commands.refusals import of_the_system
from dmp.commands.streams import ForgivingStream, OutputError, forgiving_streams
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh, write_mesh


class Faulty(io.StringIO):
    """A stream that takes a few characters before it fails."""

    def __init__(self, number: int, room: int = 0) -> None:
        super().__init__()
        self.number, self.room = number, room

    def write(self, text: str) -> int:
        if self.tell() + len(text) > self.room:
            raise OSError(self.number, os.strerror(self.number))
        return super().write(text)


@pytest.fixture
def scan(noisy_sphere: TriangleMesh, tmp_path: Path) -> Path:
    write_mesh(tmp_path / "scan.ply", noisy_sphere)
    return tmp_path / "scan.ply"


def run_dmp(shell: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command line of bash in which ``$dmp`` stands for the program."""
    environment = {**os.environ, "dmp": f"{sys.executable} -m dmp", "PYTHONPATH": str(Path(__file__).parents[2])}
    return subprocess.run(
        ["bash", "-c", shell], cwd=folder, env=environment, capture_output=True, text=True, timeout=60, check=False
    )


def test_faults_are_noted_and_not_raised() -> None:
    full = Faulty(errno.ENOSPC, room=3)
    stream = ForgivingStream(full)
    assert [stream.write("abc"), stream.write("def"), stream.write("g")] == [3, 3, 1]
    assert stream.fault is not None
    assert stream.fault.errno == errno.ENOSPC
    gone = ForgivingStream(Faulty(errno.EPIPE))
    gone.write("abc")
    gone.flush()
    assert gone.fault is None


def test_characters_that_the_stream_does_not_have_are_escaped() -> None:
    kept = io.BytesIO()
    stream = ForgivingStream(io.TextIOWrapper(kept, encoding="ascii"))
    assert stream.write("größer \udcff\n") == 9
    stream.flush()
    assert kept.getvalue() == b"gr\\xf6\\xdfer \\udcff\n"
    assert stream.encoding == "ascii"


def test_what_could_not_be_printed_is_told_after_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    done = []
    for number, is_told in ((errno.ENOSPC, True), (errno.EPIPE, False)):
        faulty = Faulty(number)
        monkeypatch.setattr(sys, "stdout", faulty)
        monkeypatch.setattr(sys, "stderr", Faulty(errno.EIO))
        try:
            with forgiving_streams():
                print("something")
                print("said", file=sys.stderr)
                done.append(number)
        except OutputError as error:
            assert is_told
            assert "the disk is full" in str(error)
        else:
            assert not is_told
        assert sys.stdout is faulty
    assert done == [errno.ENOSPC, errno.EPIPE]


def test_closed_streams_are_replaced_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    monkeypatch.setattr(streams, "_open_standard_descriptors", lambda: None)
    with forgiving_streams():
        print("something")
        print("said", file=sys.stderr)
    assert sys.stdout is None
    assert sys.stderr is None


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full here")
def test_a_full_disk_behind_the_standard_streams(scan: Path) -> None:
    printed = run_dmp("$dmp info scan.ply > /dev/full", scan.parent)
    assert printed.returncode == 2
    assert printed.stderr == (
        "dmp: What this command prints cannot be written, because the disk is full. Everything else was done.\n"
    )
    options = "--steps 4 --snapshot-every 2 --threads 1 --width-divisor 16"
    trained = run_dmp(f"$dmp denoise scan.ply -o out.ply --run run {options} 2> /dev/full", scan.parent)
    assert trained.returncode == 0
    assert read_mesh(scan.parent / "out.ply").n_vertices == read_mesh(scan).n_vertices


def test_closed_descriptors_are_not_those_of_our_files(scan: Path) -> None:
    done = run_dmp("$dmp noise scan.ply -o out.ply <&- >&- 2>&-", scan.parent)
    assert done.returncode == 0
    assert read_mesh(scan.parent / "out.ply").n_vertices == read_mesh(scan).n_vertices
    unanswered = run_dmp("$dmp denoise scan.ply -o b.ply --run run --steps 2 --threads 1 2>&1 | head -n 1", scan.parent)
    assert unanswered.stdout.startswith("Run: ")
    assert (scan.parent / "b.ply").exists()


def test_a_folder_that_is_gone_is_told(
    scan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()
    with pytest.raises(SystemExit) as end:
        main(["noise", str(scan), "-o", "out.ply"])
    assert end.value.code == 2
    assert capsys.readouterr().err.startswith("dmp: The folder you are in was deleted")


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (OSError(errno.ENAMETOOLONG, "File name too long", "a.ply"), "a.ply: its name is too long. Choose"),
        (OSError(errno.EMFILE, "Too many open files"), "Too many files are open."),
        (MemoryError(), "There is not enough memory."),
        (ImportError("libtorch_cpu.so: failed to map segment from shared object"), "There is not enough memory."),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried"), "There is not enough memory."),
        (ImportError("No module named 'torch'"), ""),
        (RuntimeError("mat1 and mat2 shapes cannot be multiplied"), ""),
        (KeyError("a"), ""),
    ],
)
def test_what_the_system_refuses_is_no_fault_of_the_program(error: Exception, expected: str) -> None:
    told = of_the_system(error)
    assert told.startswith(expected)
    assert bool(told) == bool(expected)


def test_ctrl_c_while_modules_are_loaded_leaves_no_traceback(tmp_path: Path) -> None:
    slow = tmp_path / "cyclopts.py"
    slow.write_text("import time\nprint('loading', flush=True)\ntime.sleep(30)\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(__file__).parents[2])])}
    command = [sys.executable, "-m", "dmp", "--help"]
    # In the background of a shell, where tests may run, the signal is ignored, and so it would be in the child.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        child = subprocess.Popen(
            command, env=environment, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
    finally:
        signal.signal(signal.SIGINT, before)
    with child:
        assert child.stdout is not None
        assert child.stdout.readline() == "loading\n"
        started = time.monotonic()
        child.send_signal(signal.SIGINT)
        _, errors = child.communicate(timeout=20)
    assert time.monotonic() - started < 10
    assert child.returncode == -signal.SIGINT
    assert errors == ""
