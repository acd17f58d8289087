"""Has pictures and animations drawn by a process of its own, so that nothing waits and nothing can be taken down with it."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

from dmp.errors import DmpError, MeshFileError
from dmp.exports.scenes import LARGEST_SIDE, SMALLEST_SIDE, Frame, Sheet, Shown
from dmp.exports.watching import Watch
from dmp.files import atomic_write, in_words

PICTURE_SUFFIXES = (".png", ".jpg")
ANIMATION_SUFFIXES = (".gif", ".mp4")
_CANNOT_DRAW = (
    "No picture can be drawn on this machine: OpenGL does not work here{}. Install Mesa's software OpenGL "
    "(on Debian and Ubuntu: apt install libgl1 libegl1), or export the mesh and draw it elsewhere."
)
_COPIED_BYTES = 1 << 20
# All frames of a GIF are in memory when it is written, a byte for each pixel.
_MOST_GIF_PIXELS = 500_000_000


class DrawingError(DmpError):
    """Pictures that could not be drawn."""


def write_drawing(path: Path, sheet: Sheet, frames: Iterable[Frame], n_frames: int, watch: Watch | None = None) -> None:
    """Draw frames into one file: a picture when there is one, an animation of all of them otherwise.

    Args:
        path: where to; its suffix must be that of ``sheet.kind``.
        sheet: size and kind.
        frames: made one by one as they are needed.
        n_frames: how many there are.
        watch: is told how far it is, and may cancel.

    Raises:
        DrawingError: when nothing can be drawn or encoded here.
        MeshFileError: when the file cannot be written; one that was there before is as it was then.
        CancelledError: when it was cancelled; nothing is written then.
    """
    watch = watch or Watch()
    check_target(path, (f".{sheet.kind}", ".jpeg") if sheet.kind == "jpg" else (f".{sheet.kind}",))
    with drawn(sheet, frames, n_frames, watch) as files:
        put_in_place(files[0], path)


@contextmanager
def drawn(sheet: Sheet, frames: Iterable[Frame], n_frames: int, watch: Watch) -> Iterator[list[Path]]:
    """Yield the files drawn for some frames; they go when the block ends. See :func:`write_drawing` for what is raised."""
    for side in (sheet.width, sheet.height):
        if not SMALLEST_SIDE <= side <= LARGEST_SIDE:
            raise DrawingError(
                f"A picture of {sheet.width} x {sheet.height} pixels cannot be drawn: both sides must be {SMALLEST_SIDE} to "
                f"{LARGEST_SIDE:,} pixels."
            )
    if sheet.kind == "gif" and n_frames * sheet.width * sheet.height > _MOST_GIF_PIXELS:
        raise DrawingError(
            f"A GIF of {n_frames:,} frames of {sheet.width} x {sheet.height} pixels would fill the memory. Choose a smaller "
            "size, a shorter time or fewer frames per second, or MP4."
        )
    try:
        with tempfile.TemporaryDirectory(prefix="dmp-drawing-", ignore_cleanup_errors=True) as name:
            yield _draw_into(Path(name), sheet, frames, n_frames, watch)
    except OSError as error:
        raise DrawingError(f"The picture could not be drawn, because {in_words(error)} ({tempfile.gettempdir()}).") from error


def check_target(path: Path, suffixes: tuple[str, ...]) -> None:
    """Refuse a file that could not be written after the work is done (raises :class:`MeshFileError`)."""
    if path.suffix.lower() not in suffixes:
        raise MeshFileError(path, "the name does not say a format that can be written", f"End it in {' or '.join(suffixes)}.")
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except OSError as error:
        raise MeshFileError(path, in_words(error), "Choose another name or folder.") from error
    if path.is_dir() or not path.absolute().parent.is_dir():
        cause = "this is a folder" if path.is_dir() else f"the folder {path.parent} does not exist"
        raise MeshFileError(path, cause, "Name a file in a folder that exists.")
    if not os.access(path.absolute().parent, os.W_OK):
        raise MeshFileError(path, f"the folder {path.parent} cannot be written to", "Choose another folder.")


def put_in_place(source: Path, target: Path) -> None:
    """Copy a finished file to where it belongs, whole or not at all (raises :class:`MeshFileError`)."""
    try:
        with source.open("rb") as read, atomic_write(target) as written:
            shutil.copyfileobj(read, written, _COPIED_BYTES)
    except (OSError, ValueError) as error:
        cause = in_words(error) if isinstance(error, OSError) else "the name cannot be one of a file"
        raise MeshFileError(
            target, f"the file cannot be written because {cause}", "Nothing was changed. Choose another place."
        ) from error


def _draw_into(folder: Path, sheet: Sheet, frames: Iterable[Frame], n_frames: int, watch: Watch) -> list[Path]:
    watch.tell("Preparing to draw…", 0, n_frames)
    said = folder / "said.txt"
    with said.open("wb") as errors:
        child = subprocess.Popen(
            [sys.executable, "-P", "-m", "dmp.exports.worker", str(folder)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, env=_environment(),
        )  # fmt: skip
    watch.interrupt_with(child.kill)
    try:
        return [folder / name for name in _converse(child, sheet, frames, n_frames, watch)]
    except (BrokenPipeError, EOFError) as error:
        # Whether it was killed by us is what matters most.
        watch.check()
        raise DrawingError(_why(child, said)) from error
    finally:
        watch.interrupt_with(None)
        child.kill()
        for pipe in (child.stdin, child.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        child.wait()


def _converse(child: subprocess.Popen[bytes], sheet: Sheet, frames: Iterable[Frame], n_frames: int, watch: Watch) -> list[str]:
    assert child.stdin is not None
    assert child.stdout is not None
    _send(child.stdin, sheet)
    before: tuple[Shown | None, ...] = ()
    for number, frame in enumerate(frames, start=1):
        # What stays is neither sent nor drawn again.
        same = len(before) == len(frame.panes)
        panes = tuple(None if same and shown is before[index] else shown for index, shown in enumerate(frame.panes))
        before = frame.panes
        _send(child.stdin, replace(frame, panes=panes))
        _expect(child.stdout, "drawn")
        watch.tell("Drawing…", number, n_frames)
    _send(child.stdin, None)
    _expect(child.stdout, "encoding")
    watch.tell("Writing…", n_frames, n_frames)
    files = []
    while (line := _line(child.stdout)) != "done":
        files.append(Path(line.removeprefix("file ")).name)
    watch.check()
    return files


def _send(pipe: IO[bytes], content: Any) -> None:
    pickle.dump(content, pipe, protocol=5)
    pipe.flush()


def _expect(pipe: IO[bytes], word: str) -> None:
    if (line := _line(pipe)) != word:
        raise DrawingError(f"The picture could not be drawn: the drawing process said '{line}'.")


def _line(pipe: IO[bytes]) -> str:
    """Return the next answer of the child (raises EOFError when it has ended, DrawingError with what it told)."""
    line = pipe.readline().decode("utf-8", errors="replace").rstrip("\r\n")
    if not line:
        raise EOFError
    if line.startswith("error "):
        raise DrawingError(line.removeprefix("error "))
    return line


def _environment() -> dict[str, str]:
    """Return the environment of the child: it finds this very package."""
    package = str(Path(__file__).resolve().parents[2])
    known = os.environ.get("PYTHONPATH", "")
    return {**os.environ, "PYTHONPATH": os.pathsep.join([package, known] if known else [package]), "OMP_NUM_THREADS": "1"}


def _why(child: subprocess.Popen[bytes], said: Path) -> str:
    """Return what a child that has ended told before, or what its end means."""
    assert child.stdout is not None
    for line in child.stdout.read().decode("utf-8", errors="replace").splitlines():
        if line.startswith("error "):
            return line.removeprefix("error ")
    child.wait()
    return _CANNOT_DRAW.format(_last_words(said))


def _last_words(path: Path) -> str:
    try:
        lines = path.read_bytes()[-4096:].decode("utf-8", errors="replace").strip().splitlines()
    except OSError:
        return ""
    return f" ({lines[-1].strip().rstrip('.')})" if lines else ""
