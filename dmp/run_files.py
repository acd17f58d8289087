"""The single files of a run folder: the curve, the checkpoint, and the lock that tells a live run from a dead one."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import torch

from dmp.errors import RunError
from dmp.files import atomic_write_bytes

CURVE_COLUMNS = (
    "step", "seconds",
    "total_loss", "data_loss", "laplacian_loss", "position_loss", "normal_loss",
    "displacement", "input_distance", "held_out_error", "held_out_normal_error", "inserted_movement", "made_up_error",
    "mad", "vertex_error", "hole_distance", "hole_normal_error",
)  # fmt: skip
_CHECKPOINT_MAGIC = b"dmp-checkpoint 1 sha256 "
_LARGEST_CHECKPOINT = 2 * 1024**3


def curve_line(row: Mapping[str, float]) -> str:
    """Return one line of ``curve.csv``; a value that was not measured is left empty."""
    return ",".join(repr(row[name]) if name in row else "" for name in CURVE_COLUMNS) + "\n"


def curve_text(rows: Iterable[Mapping[str, float]]) -> str:
    """Return the whole text of ``curve.csv``."""
    return ",".join(CURVE_COLUMNS) + "\n" + "".join(curve_line(row) for row in rows)


def read_curve(path: Path) -> list[dict[str, float]]:
    """Read ``curve.csv``; a last line that was cut by a crash is left out, and so is any line that is not numbers."""
    try:
        lines = path.read_text(encoding="ascii", errors="replace").splitlines(keepends=True)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise RunError(f"{path}: the curve cannot be read ({error.strerror}).") from error
    if not lines:
        return []
    names = lines[0].strip().split(",")
    rows: dict[int, dict[str, float]] = {}
    for line in lines[1:]:
        cells = line.rstrip("\n").split(",")
        if not line.endswith("\n") or len(cells) != len(names):
            continue
        try:
            row: dict[str, float] = {name: float(cell) for name, cell in zip(names, cells, strict=True) if cell}
            row["step"] = int(row["step"])
        except (ValueError, KeyError, OverflowError):
            continue
        rows[int(row["step"])] = row
    return [rows[step] for step in sorted(rows)]


class CurveFile:
    """``curve.csv`` as it is now, read again only when it has changed."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._version: tuple[int, int] | None = None
        self._rows: list[dict[str, float]] = []

    def rows(self) -> list[dict[str, float]]:
        """Return the rows, see :func:`read_curve`; they are not to be changed."""
        try:
            status = self._path.stat()
        except OSError:
            return read_curve(self._path)
        version = (status.st_mtime_ns, status.st_size)
        if version != self._version:
            self._rows, self._version = read_curve(self._path), version
        return self._rows


def write_checkpoint(path: Path, state: Mapping[str, Any]) -> None:
    """Write a training state whole or not at all, behind a line with its digest (raises OSError)."""
    buffer = io.BytesIO()
    torch.save(dict(state), buffer)
    content = buffer.getvalue()
    atomic_write_bytes(path, _CHECKPOINT_MAGIC + hashlib.sha256(content).hexdigest().encode() + b"\n" + content)


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Read a training state, without running any code that the file may carry.

    Raises:
        RunError: when it is missing, damaged, or not written by this program.
    """
    try:
        if path.stat().st_size > _LARGEST_CHECKPOINT:
            raise RunError(f"{path}: the checkpoint is larger than any that this program writes.")
        content = path.read_bytes()
    except OSError as error:
        raise RunError(f"{path}: there is no checkpoint to go on from ({error.strerror}).") from error
    head, _, body = content.partition(b"\n")
    if not head.startswith(_CHECKPOINT_MAGIC):
        raise RunError(f"{path}: this is not a checkpoint of this program.")
    if hashlib.sha256(body).hexdigest().encode() != head[len(_CHECKPOINT_MAGIC) :]:
        raise RunError(f"{path}: the checkpoint is damaged. The snapshots of the run can still be opened and exported.")
    try:
        # The digest tells damage from health, not friend from foe: weights_only keeps a hostile pickle from running.
        state = torch.load(io.BytesIO(body), map_location="cpu", weights_only=True)
    except Exception as error:
        raise RunError(f"{path}: the checkpoint cannot be read ({type(error).__name__}).") from error
    if not isinstance(state, dict):
        raise RunError(f"{path}: the checkpoint does not hold a training state.")
    return state


class RunLock:
    """Held while a training writes into a run folder; the system drops it when the process ends in whatever way."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._handle: Any = None

    def acquire(self) -> bool:
        """Take the lock; False when another training holds it. A folder that cannot be written counts as taken."""
        try:
            handle = self._path.open("a+b")
        except OSError:
            return False
        try:
            if os.name == "nt":
                import msvcrt

                msvcrt.locking(handle.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
            else:
                import fcntl

                fcntl.flock(handle.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            handle.close()
            return False
        self._handle = handle
        return True

    def release(self) -> None:
        """Give the lock back."""
        if self._handle is not None:
            self._handle.close()
            self._handle = None

    def is_held_by_anyone(self) -> bool:
        """Tell whether some process, this one included, holds the lock."""
        if self._handle is not None:
            return True
        if not self._path.exists():
            return False
        probe = RunLock(self._path)
        if probe.acquire():
            probe.release()
            return False
        return True
