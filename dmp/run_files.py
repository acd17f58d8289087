"""The single files of a run folder: the curve, the checkpoint, and the lock that tells a live run from a dead one."""

from __future__ import annotations

import errno
import hashlib
import io
import math
import os
import stat
import time
import zipfile
from collections.abc import Iterable, Mapping
from typing import Any

import torch

from dmp.errors import RunError
from dmp.run_folder import RunFolder
from dmp.training_state import tensor_bytes

CURVE_COLUMNS = (
    "step", "seconds",
    "total_loss", "data_loss", "laplacian_loss", "position_loss", "normal_loss",
    "displacement", "input_distance", "held_out_error", "held_out_normal_error", "inserted_movement", "made_up_error",
    "held_out_risk", "held_out_excess", "held_out_lowest_step",
    "mad", "vertex_error", "hole_distance", "hole_normal_error",
)  # fmt: skip
CURVE, CHECKPOINT, LOCK = "curve.csv", "checkpoint.pt", "run.lock"
# A line of the curve has some 250 bytes, and more than a million logged steps are no curve any more.
_LARGEST_CURVE = 256 * 1024**2
_LARGEST_VALUE = 1e30
_MOST_STEPS = 10**9
_CHECKPOINT_MAGIC = b"dmp-checkpoint 1 sha256 "
# How long a full disk is left alone before the whole curve is tried again.
_RETRY_SECONDS = 1.0


def curve_line(row: Mapping[str, float]) -> str:
    """Return one line of ``curve.csv``; a value that was not measured is left empty."""
    return ",".join(repr(row[name]) if name in row else "" for name in CURVE_COLUMNS) + "\n"


def curve_text(rows: Iterable[Mapping[str, float]]) -> str:
    """Return the whole text of ``curve.csv``."""
    return ",".join(CURVE_COLUMNS) + "\n" + "".join(curve_line(row) for row in rows)


def parse_curve(content: bytes) -> list[dict[str, float]]:
    """Return the rows of a curve, ascending by step.

    A last line that was cut by a crash is left out, and so are lines, columns and values that this program does not write.
    """
    lines = content.decode("ascii", errors="replace").splitlines(keepends=True)
    if not lines:
        return []
    names = [name if name in CURVE_COLUMNS else "" for name in lines[0].strip().split(",", len(CURVE_COLUMNS))]
    rows: dict[int, dict[str, float]] = {}
    for line in lines[1:]:
        cells = line.rstrip("\n").split(",", len(names))
        if not line.endswith("\n") or len(cells) != len(names):
            continue
        try:
            row: dict[str, float] = {name: float(cell) for name, cell in zip(names, cells, strict=True) if cell and name}
            step = int(row["step"])
        except (ValueError, KeyError, OverflowError):
            continue
        if 0 <= step <= _MOST_STEPS and all(abs(value) <= _LARGEST_VALUE for value in row.values()):
            rows[step] = {**row, "step": step}
    return [rows[step] for step in sorted(rows)]


class CurveFile:
    """``curve.csv``: as it is on the disk, or, while a training writes it, as it ought to be there."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._version: tuple[int, int] | None = None
        self._rows: list[dict[str, float]] = []
        self._live: dict[int, dict[str, float]] | None = None
        self._waiting: list[Mapping[str, float]] = []
        self._is_whole = False
        self._tried = 0.0

    def rows(self) -> list[dict[str, float]]:
        """Return the rows, see :func:`parse_curve`; they are not to be changed (raises :class:`RunError`)."""
        if self._live is not None:
            return [self._live[step] for step in sorted(self._live)]
        if self._folder.size(CURVE) is None:
            return []
        try:
            status = (self._folder / CURVE).stat()
        except OSError:
            return []
        version = (status.st_mtime_ns, status.st_size)
        if version != self._version:
            self._rows, self._version = parse_curve(self._folder.read(CURVE, _LARGEST_CURVE)), version
        return self._rows

    def start(self, rows: Iterable[Mapping[str, float]]) -> None:
        """Hold these rows from now on, whatever is in the file; :meth:`finish` brings them there."""
        self._live = {int(row["step"]): dict(row) for row in rows}
        self._is_whole = False

    def hold(self, row: Mapping[str, float]) -> None:
        """Take a row in, adding to what is known of its step; :meth:`write` brings it to the file."""
        assert self._live is not None
        step = int(row["step"])
        # When a training is stopped, the step that it reached is measured once more, with less.
        self._live[step] = {**self._live.get(step, {}), **row}
        self._waiting.append(self._live[step])

    def write(self) -> None:
        """Bring the rows that were taken in to the file.

        Raises:
            OSError: when it cannot be written now. The rows are written with the next ones.
        """
        if not self._is_whole:
            if time.monotonic() - self._tried >= _RETRY_SECONDS:
                self._write_whole()
            return
        try:
            self._folder.append(CURVE, "".join(map(curve_line, self._waiting)).encode())
        except OSError:
            # Half a line may stand there; what follows it would be joined to it.
            self._is_whole = False
            self._tried = time.monotonic()
            raise
        self._waiting.clear()

    def finish(self) -> None:
        """Write what is missing and have the system put it on the disk (raises OSError)."""
        if self._live is not None and not self._is_whole:
            self._write_whole()
        elif self._waiting:
            self.write()
        self._folder.synchronise(CURVE)

    def _write_whole(self) -> None:
        self._tried = time.monotonic()
        self._folder.write(CURVE, curve_text(self.rows()).encode())
        self._waiting.clear()
        self._is_whole = True


def checkpoint_bytes(state: Mapping[str, Any]) -> bytes:
    """Return a training state as it stands in a file, behind a line with its digest."""
    buffer = io.BytesIO()
    torch.save(dict(state), buffer)
    content = buffer.getvalue()
    return _CHECKPOINT_MAGIC + hashlib.sha256(content).hexdigest().encode() + b"\n" + content


def most_checkpoint_bytes(n_parameters: int, n_vertices: int) -> int:
    """Return the size that no honest checkpoint reaches: four numbers a weight, a few a vertex, and names and kinds."""
    return 32 * n_parameters + 128 * n_vertices + 16 * 1024**2


def read_checkpoint(folder: RunFolder, most_bytes: int) -> dict[str, Any]:
    """Read a training state, without running any code that the file may carry.

    Raises:
        RunError: when it is missing, larger than ``most_bytes``, damaged, or not written by this program.
    """
    return parse_checkpoint(folder.read(CHECKPOINT, most_bytes), folder / CHECKPOINT)


def parse_checkpoint(content: bytes, path: object) -> dict[str, Any]:
    """Return the state in the ``content`` of the file ``path``; see :func:`read_checkpoint`."""
    head, _, body = content[:200].partition(b"\n")
    body = content[len(head) + 1 :]
    if not head.startswith(_CHECKPOINT_MAGIC):
        raise RunError(f"{path}: this is not a checkpoint of this program.")
    if hashlib.sha256(body).hexdigest().encode() != head[len(_CHECKPOINT_MAGIC) :]:
        raise RunError(f"{path}: the checkpoint is damaged. The snapshots of the run can still be opened and exported.")
    # The digest tells damage from health, not friend from foe. What follows keeps a foe from running code (weights_only)
    # and from taking all the memory: nothing is compressed, and no tensor is larger than the file.
    try:
        with zipfile.ZipFile(io.BytesIO(body)) as archive:
            entries = archive.infolist()
            if any(item.compress_type != zipfile.ZIP_STORED for item in entries):
                raise ValueError("it is compressed")
            if sum(item.file_size for item in entries) > len(body):
                raise ValueError("it claims more than it holds")
        state = torch.load(io.BytesIO(body), map_location="cpu", weights_only=True)
        if tensor_bytes(state) > len(body):
            raise ValueError("its tensors claim more than it holds")
    except Exception as error:
        raise RunError(f"{path}: the checkpoint cannot be used ({type(error).__name__}).") from error
    if not isinstance(state, dict):
        raise RunError(f"{path}: the checkpoint does not hold a training state.")
    return state


class RunLock:
    """Held while a training writes into a run folder; the system drops it when the process ends in whatever way."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._descriptor: int | None = None

    def acquire(self) -> bool:
        """Take the lock; False when another training holds it.

        Raises:
            OSError: when the folder cannot be written, so that nobody could train into it.
        """
        path = self._folder / LOCK
        # Not without looking: a link or a pipe of that name would be opened by the system.
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise OSError(errno.EINVAL, f"{LOCK} is no regular file", str(path))
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | _flags(), 0o666)
        if not _lock(descriptor):
            os.close(descriptor)
            return False
        self._descriptor = descriptor
        return True

    def release(self) -> None:
        """Give the lock back."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def is_held_by_anyone(self) -> bool:
        """Tell whether some process, this one included, holds the lock."""
        if self._descriptor is not None:
            return True
        try:
            # For reading: a folder on a read-only disk is trained by nobody.
            descriptor = os.open(self._folder / LOCK, os.O_RDONLY | _flags())
        except OSError:
            return False
        try:
            return stat.S_ISREG(os.fstat(descriptor).st_mode) and not _lock(descriptor)
        finally:
            os.close(descriptor)


def _flags() -> int:
    return getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)


def _lock(descriptor: int) -> bool:
    """Lock an open file until it is closed; False when another one holds it. Where there are no locks it is granted."""
    try:
        if os.name == "nt":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK)
    return True


def finite(value: Any, most: float) -> float | None:
    """Return a number of a file when it is one between 0 and ``most``, otherwise None."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    # The comparison first: an integer of thousands of digits is no float.
    return float(value) if 0 <= value <= most and math.isfinite(value) else None
