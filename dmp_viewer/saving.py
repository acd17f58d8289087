"""Pictures written whole or not at all: Qt itself destroys the old file when the disk is full."""

from __future__ import annotations

from pathlib import Path

from qtpy.QtCore import QBuffer, QByteArray, QIODevice
from qtpy.QtGui import QImage, QPixmap

from dmp.errors import MeshFileError
from dmp.files import atomic_write_bytes, in_words


def save_picture(picture: QPixmap | QImage, path: Path) -> None:
    """Write a picture in the format of its suffix; PNG without one that Qt knows.

    Raises:
        MeshFileError: when it cannot be written; a file that was there before is as it was then.
    """
    content = QByteArray()
    buffer = QBuffer(content)
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    suffix = path.suffix[1:].upper()
    if not picture.save(buffer, suffix if suffix in ("PNG", "JPG", "JPEG", "BMP", "TIFF", "WEBP") else "PNG"):
        raise MeshFileError(path, "the picture cannot be encoded in this format", "Name a file ending in .png.")
    try:
        atomic_write_bytes(path, content.data())
    except (OSError, ValueError) as error:
        cause = in_words(error) if isinstance(error, OSError) else "the name cannot be one of a file"
        raise MeshFileError(
            path, f"the picture cannot be written because {cause}", "Nothing was changed. Choose another place."
        ) from error
