"""The files of one folder, read and written so that nothing outside of it is ever touched.

A run folder may come from anybody. Links, pipes and devices in it are not followed or opened; a file is opened only after
its size was compared with what it can honestly have; arrays are taken in only when their header is, word for word, what this
program writes for the shape that is expected. Nothing that a file says is ever run, and nothing is allocated on its word.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import re
import stat
from pathlib import Path
from typing import Any
from unicodedata import category

import numpy as np
from numpy.typing import NDArray

from dmp.errors import MeshError, RunError
from dmp.files import TEMPORARY_SUFFIX, atomic_write_bytes, in_words
from dmp.mesh import FloatArray, TriangleMesh

_LARGEST_TEXT = 1 << 20
_LARGEST_ARRAY_HEADER = 512
_ARRAY_HEADER = re.compile(rb"\{'descr': '<(f4|f8)', 'fortran_order': False, 'shape': \(([0-9]{1,12}), ([0-9]{1,4})\), \} *\n")
# Behind the array, where readers of the format no longer look: a flipped bit must not pass for a mesh.
_DIGEST_MARK = b"\nsha256 "
_LEFTOVER = re.compile(r"\.[0-9a-f]{12}" + re.escape(TEMPORARY_SUFFIX))


class RunFolder:
    """One folder, whose files are named by paths relative to it such as ``snapshots/000050.npy``.

    Attributes:
        path: where it lies.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def __truediv__(self, name: str) -> Path:
        return self.path / name

    # -- reading ----------------------------------------------------------------------------------------------------

    def size(self, name: str) -> int | None:
        """Return the size of a regular file in bytes, None when there is none of that name.

        Raises:
            RunError: when there is something else of that name, such as a link or a pipe.
        """
        parts = Path(name).parts
        for depth in range(1, len(parts) + 1):
            path = self.path.joinpath(*parts[:depth])
            try:
                status = path.lstat()
            except FileNotFoundError:
                return None
            except OSError as error:
                raise RunError(f"{path} cannot be read: {in_words(error)}.") from error
            is_last = depth == len(parts)
            if not (stat.S_ISREG(status.st_mode) if is_last else stat.S_ISDIR(status.st_mode)):
                kind = "a link, which may lead anywhere," if stat.S_ISLNK(status.st_mode) else "something else"
                raise RunError(f"{path} is {kind} where a run has a {'file' if is_last else 'folder'}. It is not opened.")
        return status.st_size

    def read(self, name: str, most_bytes: int) -> bytes:
        """Return the content of a file.

        Raises:
            RunError: when it is missing, no regular file, larger than ``most_bytes``, or cannot be read.
        """
        path = self.path / name
        size = self.size(name)
        if size is None:
            raise RunError(f"{path} is missing from the run.")
        if size > most_bytes:
            raise RunError(f"{path} has {size:,} bytes, more than this program ever writes there. It is not read.")
        try:
            with os.fdopen(os.open(path, os.O_RDONLY | _no_surprises()), "rb") as file:
                if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                    raise RunError(f"{path} is no regular file. It is not opened.")
                content = file.read(most_bytes + 1)
        except OSError as error:
            raise RunError(f"{path} cannot be read: {in_words(error)}.") from error
        if len(content) > most_bytes:
            raise RunError(f"{path} grows while it is read.")
        return content

    def read_json(self, name: str) -> dict[str, Any]:
        """Return the object in a JSON file (raises :class:`RunError` when there is none, or no object in it)."""
        content = self.read(name, _LARGEST_TEXT)
        try:
            value = json.loads(content.decode("utf-8"))
        # Deep nesting exhausts the parser's stack, and a number of thousands of digits its patience.
        except (ValueError, RecursionError) as error:
            raise RunError(f"{self.path / name} is damaged ({_short(error)}).") from error
        if not isinstance(value, dict):
            raise RunError(f"{self.path / name} is damaged (it holds no object).")
        return value

    def read_array(self, name: str, shape: tuple[int, int]) -> FloatArray:
        """Return an array of single or double precision, read-only.

        Raises:
            RunError: when the file is missing or damaged, or the array has another shape or holds values that are not finite.
        """
        path = self.path / name
        # Version, header, the array in double precision at most, and the digest.
        content = self.read(name, 1024 + 8 * shape[0] * shape[1])
        if len(content) < 10 or content[:8] != b"\x93NUMPY\x01\x00":
            raise RunError(f"{path} is damaged: this is no array.")
        end = 10 + int.from_bytes(content[8:10], "little")
        header = _ARRAY_HEADER.fullmatch(content[10:end]) if end <= _LARGEST_ARRAY_HEADER else None
        if header is None:
            raise RunError(f"{path} is damaged: this program writes no array of that kind.")
        if (int(header[2]), int(header[3])) != shape:
            raise RunError(f"{path} does not belong to this run: {shape[0]} rows of {shape[1]} numbers are needed.")
        item = np.dtype("<" + header[1].decode())
        end_of_array = end + item.itemsize * shape[0] * shape[1]
        body, rest = content[end:end_of_array], content[end_of_array:]
        is_whole = len(content) >= end_of_array and (not rest or rest == _digest_line(name, content[:end_of_array]))
        if not is_whole:
            raise RunError(f"{path} is damaged: it does not hold what was written.")
        values: FloatArray = np.frombuffer(body, dtype=item).reshape(shape)
        if not np.isfinite(values).all():
            raise RunError(f"{path} is damaged: it holds numbers that are not finite.")
        return values

    def read_mesh(self, name: str) -> TriangleMesh:
        """Return a mesh exactly as it was written: nothing is dropped, joined or reordered.

        Raises:
            RunError: when the file is missing or damaged.
        """
        from dmp.formats.ply import read_ply
        from dmp.formats.recognise import recognise
        from dmp.formats.source import SourceFile

        path = self.path / name
        if self.size(name) is None:
            raise RunError(f"{path} is missing from the run.")
        try:
            with SourceFile(path) as source, np.errstate(all="ignore"):
                if recognise(source)[0] != "ply":
                    raise RunError(f"{path} is damaged: this is no PLY file.")
                found = read_ply(source)
            if (found.counts != 3).any():
                raise RunError(f"{path} is damaged: it holds faces that are no triangles.")
            return TriangleMesh(found.vertices, found.corners.reshape(-1, 3), found.attributes)
        except RunError:
            raise
        except MeshError as error:
            raise RunError(f"{path} is damaged: {_short(error)}.") from error
        except Exception as error:
            # No content of a file may end the program; what arrives here is a fault of a reader all the same.
            raise RunError(f"{path} is damaged ({type(error).__name__}: {_short(error)}).") from error

    def digest(self, name: str) -> str | None:
        """Return the sha256 of a file, None when there is none (raises :class:`RunError` as :meth:`size` does)."""
        if self.size(name) is None:
            return None
        try:
            with os.fdopen(os.open(self.path / name, os.O_RDONLY | _no_surprises()), "rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise RunError(f"{self.path / name} cannot be read: {in_words(error)}.") from error

    def names(self, folder: str) -> list[str]:
        """Return the names in a subfolder, in no order; none when it is missing, a link, or cannot be read."""
        path = self.path / folder
        try:
            return [] if path.is_symlink() else [item.name for item in os.scandir(path)]
        except OSError:
            return []

    # -- writing ----------------------------------------------------------------------------------------------------

    def make(self) -> None:
        """Make the folder with its subfolder (raises OSError)."""
        (self.path / "snapshots").mkdir(parents=True, exist_ok=True)

    def write(self, name: str, content: bytes) -> None:
        """Write a file whole or not at all; a link of that name is replaced, never followed (raises OSError)."""
        path = self.path / name
        if path.parent != self.path and path.parent.is_symlink():
            raise OSError(errno.EINVAL, f"{path.parent.name} is a link, which is not followed", str(path.parent))
        atomic_write_bytes(path, content, follow_link=False)

    def write_json(self, name: str, value: dict[str, Any]) -> None:
        """Write an object as JSON (raises OSError)."""
        self.write(name, json.dumps(value, indent=2).encode())

    def write_array(self, name: str, array: NDArray) -> None:
        """Write an array of single or double precision, (n, k), and its digest behind it (raises OSError)."""
        buffer = io.BytesIO()
        np.save(buffer, np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")), allow_pickle=False)
        content = buffer.getvalue()
        self.write(name, content + _digest_line(name, content))

    def append(self, name: str, content: bytes) -> None:
        """Add to the end of a file that this program made (raises OSError; then a part of it may have been written)."""
        descriptor = os.open(self.path / name, os.O_WRONLY | os.O_APPEND | _no_surprises())
        try:
            status = os.fstat(descriptor)
            # With a second name the file may be anybody's.
            if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
                raise OSError(errno.EINVAL, f"{name} is not a file of this run alone", str(self.path / name))
            if os.write(descriptor, content) != len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path / name))
        finally:
            os.close(descriptor)

    def synchronise(self, name: str) -> None:
        """Have the system put a file on the disk (raises OSError)."""
        descriptor = os.open(self.path / name, os.O_RDWR | _no_surprises())
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)

    def clear_leftovers(self) -> None:
        """Remove the parts of files that a killed process left behind."""
        for folder in (".", "snapshots"):
            for name in self.names(folder):
                path = self.path / folder / name
                if _LEFTOVER.fullmatch(name) and not path.is_symlink():
                    try:
                        path.unlink()
                    except OSError:
                        continue


def plain_text(value: Any, most: int = 200) -> str:
    """Return a text of a file as it may be shown: one line, without anything invisible; empty when it is no text."""
    if not isinstance(value, str):
        return ""
    return "".join(letter for letter in value[: 4 * most] if letter.isprintable() or category(letter) == "Zs")[:most]


def _digest_line(name: str, content: bytes) -> bytes:
    # With the name, so that the snapshot of another step does not pass either.
    return _DIGEST_MARK + hashlib.sha256(name.encode() + b"\0" + content).hexdigest().encode() + b"\n"


def _no_surprises() -> int:
    """Return the flags that keep an opening from following a link or waiting for a pipe."""
    names = ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY")
    flags = 0
    for name in names:
        flags |= getattr(os, name, 0)
    return flags


def _short(error: BaseException) -> str:
    text = " ".join(str(error).split()).rstrip(".")
    return (text if len(text) < 200 else text[:197] + "…") or type(error).__name__
