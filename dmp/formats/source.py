"""Opening a mesh file so that nothing but a regular, unchanging file of a sensible size is ever read."""

from __future__ import annotations

import errno
import os
import stat
import time
import zlib
from pathlib import Path
from types import TracebackType
from typing import Self

from dmp.errors import MeshError
from dmp.files import in_words

MAXIMUM_BYTES = 4 * 1000**3
HEAD_BYTES = 1 << 16
# No mesh holds so many zero bytes in a row; a copy that was broken off does, and a sparse file made to exhaust the memory.
_ZERO_BLOCK_BYTES = 1 << 24
# Times of modification come in steps, up to two seconds on some disks, so that they hide what happens within a step.
_YOUNG = 10 * 10**9


class FormatError(MeshError):
    """Why a file cannot be read, without its name, which :mod:`dmp.meshio` adds.

    Attributes:
        cause: what is wrong and where, without a final period.
        remedy: what to do about it, one or two sentences.
    """

    def __init__(self, cause: str, remedy: str) -> None:
        self.cause = cause
        self.remedy = remedy
        super().__init__(f"{cause}. {remedy}")


class SourceFile:
    """A regular file, opened for reading; use it in a ``with`` statement.

    Attributes:
        path: the file as the user named it.
        size: its size in bytes when it was opened, above 0.
        head: its first bytes, at most 64 KiB; reading starts at the beginning nevertheless.

    Raises:
        FormatError: when there is no such file, it is a folder, a pipe, a device or a socket, it may not be read, it is
            empty, or it is larger than 4 GB. Pipes and devices are told apart without opening them.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._is_young = False
        self._read_blocks: list[tuple[int, int, int]] = []
        try:
            _check_regular(self.path.stat())
            # Should a pipe take the place of the file just now, the opening must not wait for someone to write into it.
            flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
            self._file = os.fdopen(os.open(self.path, flags), "rb", buffering=0)
        except OSError as error:
            raise _cannot_open(self.path, error) from error
        except ValueError as error:  # the operating system cannot even be asked about a name with a zero character
            raise FormatError("the name holds a character that no file name can hold", "Choose another file.") from error
        try:
            status = os.fstat(self._file.fileno())
            _check_regular(status)
            self._state = (status.st_size, status.st_mtime_ns)
            self._is_young = time.time_ns() - status.st_mtime_ns < _YOUNG
            self.size = status.st_size
            if self.size == 0:
                raise FormatError("the file is empty (0 bytes)", "Save or copy it again from where it came from.")
            if self.size > MAXIMUM_BYTES:
                raise FormatError(
                    f"the file has {self.size:,} bytes; at most {MAXIMUM_BYTES:,} can be read",
                    "Simplify the mesh first, for example in MeshLab.",
                )
            self.head = self._read(min(HEAD_BYTES, self.size))
            self._file.seek(0)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self._file.close()

    @property
    def suffix(self) -> str:
        """The extension of the name in lower case, such as ``".obj"``."""
        return self.path.suffix.lower()

    def seek(self, position: int) -> None:
        """Let the next reading start ``position`` bytes from the beginning of the file."""
        self._file.seek(position)

    def read_up_to(self, n_bytes: int) -> bytes:
        """Return the next bytes, fewer than asked for only at the end of the file.

        Raises:
            FormatError: when the disk reports an error.
        """
        return self._read(n_bytes)

    def read_exactly(self, n_bytes: int) -> bytearray:
        """Return the next ``n_bytes`` bytes.

        Raises:
            FormatError: when the file has fewer, or 16 MiB of them are zeros.
        """
        content = bytearray()
        while len(content) < n_bytes:
            start = self._file.tell()
            block = self._read(min(_ZERO_BLOCK_BYTES, n_bytes - len(content)))
            if not block:
                raise FormatError(
                    "the file became shorter while it was being read", "Wait until it is complete, then open it again."
                )
            if len(block) == _ZERO_BLOCK_BYTES and block.count(0) == len(block):
                raise FormatError(
                    f"{_ZERO_BLOCK_BYTES:,} zero bytes follow on byte {start:,}: the file was never written completely",
                    "Save or copy it again from where it came from.",
                )
            content += block
        return content

    def check_unchanged(self) -> None:
        """Refuse a file that was written to since it was opened.

        Raises:
            FormatError: when size or time of modification differ from those at the opening, or, in a file that was written
                to just before, what has been read reads differently now.
        """
        changed = FormatError("the file was changed while it was being read", "Wait until it is complete, then open it again.")
        status = os.fstat(self._file.fileno())
        if (status.st_size, status.st_mtime_ns) != self._state:
            raise changed
        blocks, self._read_blocks = self._read_blocks, []
        for position, n_bytes, checksum in blocks:
            self._file.seek(position)
            if zlib.crc32(self._read(n_bytes)) != checksum:
                raise changed

    def _read(self, n_bytes: int) -> bytes:
        start = self._file.tell() if self._is_young else 0
        parts: list[bytes] = []
        missing = n_bytes
        while missing:
            try:
                part = self._file.read(missing)
            except OSError as error:
                raise FormatError(
                    f"the file cannot be read because {in_words(error)}", "Check the disk, then open it again."
                ) from error
            if not part:
                break
            parts.append(part)
            missing -= len(part)
        content = parts[0] if len(parts) == 1 else b"".join(parts)
        if self._is_young:
            self._read_blocks.append((start, len(content), zlib.crc32(content)))
        return content


def _check_regular(status: os.stat_result) -> None:
    kinds = (
        (stat.S_ISDIR, "this is a folder, not a file", "Choose a mesh file inside it."),
        (stat.S_ISFIFO, "this is a pipe, not a file", "Write the mesh to a file first."),
        (stat.S_ISSOCK, "this is a socket, not a file", "Write the mesh to a file first."),
        (stat.S_ISCHR, "this is a device, not a file", "Write the mesh to a file first."),
        (stat.S_ISBLK, "this is a disk device, not a file", "Choose a mesh file."),
    )
    for is_kind, cause, remedy in kinds:
        if is_kind(status.st_mode):
            raise FormatError(cause, remedy)
    if not stat.S_ISREG(status.st_mode):
        raise FormatError("this is not a regular file", "Choose a mesh file.")


def _cannot_open(path: Path, error: OSError) -> FormatError:
    if error.errno == errno.ENOENT and path.is_symlink():
        return FormatError("this is a link to a file that does not exist", "Choose the file itself.")
    if error.errno == errno.ENOENT:
        return FormatError("there is no such file", "Check the name and the folder.")
    return FormatError(
        f"the file cannot be opened because {in_words(error)}", "Check the name, its folder and its permissions."
    )
