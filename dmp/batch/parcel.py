"""A run folder and its result as one piece of bytes, for workers that do not see the folder of the batch."""

from __future__ import annotations

import io
import os
import re
import zipfile
from pathlib import Path

from dmp.errors import RunError
from dmp.files import atomic_write_bytes, in_words

# What a run folder consists of; nothing else travels, and nothing else is ever unpacked.
_FILES = re.compile(
    r"(run\.json|input\.ply|ground_truth\.ply|base\.npy|curve\.csv|checkpoint\.pt|kept\.json|snapshots/[0-9]{6,9}\.npy)"
)


def pack(folder: Path, *, without_snapshots: bool = False) -> bytes:
    """Return the files of a run folder in one piece (raises :class:`RunError` when one cannot be read)."""
    buffer = io.BytesIO()
    try:
        # Not compressed: the numbers of a training are noise to a compressor.
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
            for path in sorted(folder.rglob("*")):
                name = path.relative_to(folder).as_posix()
                if without_snapshots and name.startswith("snapshots/"):
                    continue
                if _FILES.fullmatch(name) and path.is_file() and not path.is_symlink():
                    archive.write(path, name)
    except OSError as error:
        raise RunError(f"The run folder {folder} cannot be read: {in_words(error)}.") from error
    return buffer.getvalue()


def unpack(content: bytes, folder: Path) -> None:
    """Write the files of a parcel into a folder, ``run.json`` last, so that half a parcel is no run.

    Raises:
        RunError: when the folder cannot be written, or the parcel holds anything but the files of a run folder.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            if any(not _FILES.fullmatch(item.filename) for item in entries):
                raise RunError("What the worker sent is not a run folder.")
            if sum(item.file_size for item in entries) > len(content):
                raise RunError("What the worker sent claims to be larger than it is.")
            (folder / "snapshots").mkdir(parents=True, exist_ok=True)
            for item in sorted(entries, key=lambda item: item.filename == "run.json"):
                atomic_write_bytes(folder / item.filename, archive.read(item))
    except (OSError, zipfile.BadZipFile) as error:
        cause = in_words(error) if isinstance(error, OSError) else "what the worker sent is damaged"
        raise RunError(f"The run folder {folder} cannot be written: {cause}.") from error


def private_folder(name: str) -> Path:
    """Return a folder of this user alone below the system's folder for temporary files, made if it is not there.

    Raises:
        RunError: when it cannot be made, or is somebody else's.
    """
    import tempfile

    user = os.getuid() if hasattr(os, "getuid") else 0
    root = Path(tempfile.gettempdir()) / f"dmp-batch-{user}"
    try:
        root.mkdir(mode=0o700, exist_ok=True)
        if root.is_symlink() or (hasattr(os, "getuid") and root.stat().st_uid != user):
            raise RunError(f"{root} belongs to somebody else. Set TMPDIR to a folder of your own on this worker.")
        folder = root / re.sub(r"[^\w.-]+", "_", name)
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise RunError(f"{root} cannot be made on the worker: {in_words(error)}.") from error
    return folder
