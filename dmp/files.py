"""Writing files so that a name always holds either the old content or the whole new content.

A file is written under a temporary name in the folder of its target, flushed, synchronised with the disk, compared
with what was meant to be written, and only then renamed over the target; the folder is synchronised last. A full
disk, a missing right, a crash or a kill in between leaves the old file as it was. After a kill a hidden file whose
name ends in :data:`TEMPORARY_SUFFIX` may be left behind; it is never mistaken for a result.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

TEMPORARY_SUFFIX = ".dmp-part"

_IN_WORDS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file is larger than the system allows",
    errno.EROFS: "the disk is read-only",
    errno.EACCES: "there is no permission to do so",
    errno.EPERM: "there is no permission to do so",
    errno.ENOENT: "the file or its folder does not exist",
    errno.ENOTDIR: "a part of its path is a file, not a folder",
    errno.EISDIR: "it is a folder",
    errno.ENAMETOOLONG: "its name is too long",
    errno.ELOOP: "it is a link that leads in a circle",
    errno.EIO: "the disk reports an error",
    errno.EMFILE: "too many files are open",
    errno.ENFILE: "too many files are open",
    errno.ENXIO: "the device is not there",
    errno.ESTALE: "the network folder is gone",
}
# Some file systems (network shares, FUSE) cannot synchronise a folder; their renames are as durable as they get.
_FOLDER_SYNC_UNSUPPORTED = {errno.EINVAL, errno.ENOTSUP, errno.ENOSYS, errno.EBADF, errno.EACCES, errno.EPERM, errno.EISDIR}


def in_words(error: OSError) -> str:
    """Return why the operating system refused, as a clause without capital and period, such as "the disk is full"."""
    if error.errno in _IN_WORDS:
        return _IN_WORDS[error.errno]
    return error.strerror or str(error) or type(error).__name__


@contextmanager
def atomic_write(
    path: Path | str, *, check: Callable[[Path], None] | None = None, follow_link: bool = True
) -> Iterator[BinaryIO]:
    """Open a binary file for writing that takes the name ``path`` only when the block ends without an error.

    An existing file keeps its permissions.

    Args:
        path: the file to write; its folder must exist.
        check: called with the path of the complete temporary file before the renaming; raising an error in it keeps
            the old file.
        follow_link: whether a link is followed, so that its target is replaced and the link stays; otherwise the file
            takes the place of the link.

    Yields:
        The temporary file, seekable, opened for writing.

    Raises:
        OSError: when the file cannot be written whole, with the errno of the cause (:func:`in_words` tells it). The
            temporary file is removed and the old file is untouched. Also when ``path`` is a folder, a pipe or a device.
    """
    target = Path(os.path.realpath(path)) if follow_link else Path(os.path.realpath(Path(path).parent)) / Path(path).name
    mode = None if not follow_link and target.is_symlink() else _mode_of_existing(target)
    temporary = target.parent / f".{secrets.token_hex(6)}{TEMPORARY_SUFFIX}"
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
    descriptor = os.open(temporary, flags, 0o666)
    try:
        file = os.fdopen(descriptor, "wb")
        try:
            yield file
            file.flush()
            length = file.seek(0, os.SEEK_END)
            if mode is not None and hasattr(os, "fchmod"):
                with suppress(OSError):
                    os.fchmod(file.fileno(), mode)
            os.fsync(file.fileno())
        finally:
            # After a failed write, closing tries to flush once more and fails likewise; the first error is the one to tell.
            with suppress(OSError):
                file.close()
        if temporary.stat().st_size != length:
            raise OSError(errno.EIO, "the file is shorter than what was written", str(target))
        if check is not None:
            check(temporary)
        temporary.replace(target)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    _synchronise_folder(target.parent)


def atomic_write_bytes(path: Path | str, content: bytes, *, follow_link: bool = True) -> None:
    """Write ``content`` to ``path`` as :func:`atomic_write` does, and compare what is in the file with it before renaming.

    Raises:
        OSError: when the file cannot be written whole; the old file is untouched then.
    """

    def check(temporary: Path) -> None:
        if temporary.read_bytes() != content:
            raise OSError(errno.EIO, "the file does not hold what was written to it", str(path))

    with atomic_write(path, check=check, follow_link=follow_link) as file:
        file.write(content)


def _mode_of_existing(target: Path) -> int | None:
    """Return the permissions of an existing regular file, None when there is none, and refuse anything else."""
    try:
        status = target.lstat()
    except FileNotFoundError:
        return None
    if stat.S_ISLNK(status.st_mode):
        raise OSError(errno.ELOOP, "a link that leads in a circle", str(target))
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder", str(target))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it is a pipe, a device or a socket, not a file", str(target))
    # Renaming needs no right on the file itself; a file that its owner protected must still not be replaced.
    if not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, "the file is write-protected", str(target))
    return stat.S_IMODE(status.st_mode)


def _synchronise_folder(folder: Path) -> None:
    if os.name == "nt":  # Windows has no way to synchronise a folder
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        if error.errno not in _FOLDER_SYNC_UNSUPPORTED:
            raise
