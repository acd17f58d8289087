"""Reading single parts out of a ZIP archive from a stranger, each bounded in size before it is unpacked.

Nothing is ever written to the disk, so that names with "..", links and the like mean nothing.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib

from dmp.formats.assemble import counted
from dmp.formats.limits import largest_unpacked
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.text import show

_MAXIMUM_PARTS = 50_000
_ENCRYPTED = 0x1
_RESAVE = "Save or copy the file again from where it came from."
# What the library raises for damaged archives, beyond its own class.
_FAULTS = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    ValueError,
    NotImplementedError,
    RuntimeError,
    OSError,
    IndexError,
)


class ZipParts:
    """The parts of an archive, by names in small letters and without a slash at the beginning.

    Attributes:
        names: the names as they stand in the archive, in its order.
        n_packed: bytes of the whole file.
    """

    def __init__(self, source: SourceFile) -> None:
        source.seek(0)
        content = source.read_exactly(source.size)
        self.n_packed = len(content)
        self._unpacked = 0
        try:
            self._archive = zipfile.ZipFile(io.BytesIO(content))
            infos = self._archive.infolist()
        except _FAULTS as error:
            raise FormatError(
                "the archive has no valid list of its parts at its end, so it was cut off or is damaged", _RESAVE
            ) from error
        if len(infos) > _MAXIMUM_PARTS:
            raise FormatError(f"the archive has {counted(len(infos), 'part')}; at most {_MAXIMUM_PARTS:,} can be read", _RESAVE)
        self.names = [info.filename for info in infos]
        self._infos: dict[str, list[zipfile.ZipInfo]] = {}
        for info in infos:
            self._infos.setdefault(_key(info.filename), []).append(info)

    def __contains__(self, name: str) -> bool:
        return _key(name) in self._infos

    def read(self, name: str) -> bytes:
        """Return the content of a part, whose checksum is compared.

        Raises:
            FormatError: when there is no such part or more than one, it is encrypted or damaged, or it would unpack to
                forty times the size of the file, and more than 32 MiB.
        """
        shown = show(name.encode(errors="replace"))
        infos = self._infos.get(_key(name), [])
        if len(infos) != 1:
            raise FormatError(f"the archive has {'no' if not infos else 'more than one'} part '{shown}'", _RESAVE)
        info = infos[0]
        if info.flag_bits & _ENCRYPTED:
            raise FormatError(f"the part '{shown}' is encrypted", "Save the file without a password.")
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise FormatError(f"the part '{shown}' is compressed in a way that 3MF does not know", _RESAVE)
        limit = largest_unpacked(self.n_packed) - self._unpacked
        if info.file_size > limit:
            raise FormatError(
                f"the part '{shown}' would unpack to {info.file_size:,} bytes, from a file of {self.n_packed:,}",
                "A mesh does not shrink so much; do not trust this file.",
            )
        try:
            with self._archive.open(info) as part:
                content = part.read(info.file_size + 1)
        except _FAULTS as error:
            raise FormatError(f"the part '{shown}' of the archive is damaged", _RESAVE) from error
        if len(content) != info.file_size:
            raise FormatError(f"the part '{shown}' is not as long as the archive tells", _RESAVE)
        self._unpacked += len(content)
        return content


def _key(name: str) -> str:
    return name.replace("\\", "/").lstrip("/").lower()
