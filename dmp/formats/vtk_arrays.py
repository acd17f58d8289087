"""The data arrays of XML files of VTK: text, base64 or raw bytes, as they are or in compressed blocks."""

from __future__ import annotations

import binascii
import lzma
import math
import re
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dmp.formats.limits import largest_unpacked
from dmp.formats.source import FormatError
from dmp.formats.text import parse_all, show
from dmp.mesh import FloatArray, IntArray

_TYPES = {
    **{f"Int{bits}": f"i{bits // 8}" for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": f"u{bits // 8}" for bits in (8, 16, 32, 64)},
    "Float32": "f4",
    "Float64": "f8",
}
_ZLIB, _LZMA = "vtkZLibDataCompressor", "vtkLZMADataCompressor"
_LZMA_MEMORY = 1 << 28
_TAG = re.compile(rb"""<(?:[^<>"']++|"[^"]*"|'[^']*')*+>""")
_MAXIMUM_COMPONENTS = 1000
_RESAVE = "Save or copy the file again from where it came from."


@dataclass(frozen=True)
class Declared:
    """What the element of an array tells.

    Attributes:
        where: what to call it in messages.
        name: its name.
        type_name: such as "Float32".
        components: numbers for each point or cell.
        layout: "ascii", "binary" or "appended".
        offset: where its data begin after the mark of the appended data.
        byte: where its element begins in the file.
        range: the smallest and largest length of its rows, where the file tells them.
    """

    where: str
    name: str
    type_name: str
    components: int
    layout: str
    offset: int
    byte: int
    range: FloatArray | None

    @property
    def is_numeric(self) -> bool:
        """Whether the type is one of numbers; others are texts and single bits."""
        return self.type_name in _TYPES

    @classmethod
    def from_attributes(cls, attributes: dict[str, str], where: str, byte: int) -> Declared:
        """Return what the attributes of an element tell.

        Raises:
            FormatError: when a number is none or the layout is unknown.
        """
        name = attributes.get("Name", "")
        place = f"{where}, array '{show(name.encode(errors='replace'))}'"
        numbers = {}
        for key, default in (("NumberOfComponents", "1"), ("offset", "0")):
            text = attributes.get(key, default).strip()
            if not re.fullmatch(r"[0-9]{1,15}", text):
                raise FormatError(f"{place}: '{key}' is not a number", _RESAVE)
            numbers[key] = int(text)
        layout = attributes.get("format", "ascii")
        if layout not in ("ascii", "binary", "appended"):
            raise FormatError(f"{place}: the format '{show(layout.encode(errors='replace'))}' is unknown", _RESAVE)
        components = max(numbers["NumberOfComponents"], 1)
        if components > _MAXIMUM_COMPONENTS:
            raise FormatError(f"{place}: {components:,} components are too many", _RESAVE)
        limits = _floats(attributes.get("RangeMin"), attributes.get("RangeMax"))
        return cls(place, name, attributes.get("type", ""), components, layout, numbers["offset"], byte, limits)


class ArrayReader:
    """Reads the arrays of one file, no more of them than a small file may become."""

    def __init__(
        self, content: bytes, attributes: dict[str, str], file_bytes: int, *, appended: tuple[int, memoryview, str]
    ) -> None:
        self._content = content
        self._appended_start, self._appended, self._appended_encoding = appended
        order = attributes.get("byte_order", "LittleEndian")
        header = attributes.get("header_type", "UInt32")
        compressor = attributes.get("compressor", "")
        if order not in ("LittleEndian", "BigEndian") or header not in ("UInt32", "UInt64"):
            shown = show(f"{order}, {header}".encode(errors="replace"))
            raise FormatError(f"the byte order or the type of the headers is unknown: {shown}", _RESAVE)
        self._order = "<" if order == "LittleEndian" else ">"
        self._word = np.dtype(self._order + ("u4" if header == "UInt32" else "u8"))
        self._compressor = compressor
        self._limit = largest_unpacked(file_bytes)
        self._unpacked = 0

    def read(self, array: Declared, n_rows: int, *, all_digits: bool = False) -> NDArray:
        """Return an array, (n_rows, components), in its type and the byte order of this machine.

        Args:
            array: what its element tells.
            n_rows: how many points or cells it has values for.
            all_digits: whether numbers of a text are kept in double precision, also when they are declared as single.

        Raises:
            FormatError: when it does not hold exactly so many numbers, or the arrays together are too large.
        """
        if not array.is_numeric:
            raise FormatError(f"{array.where}: the type '{show(array.type_name.encode(errors='replace'))}' is unknown", _RESAVE)
        dtype = np.dtype(self._order + _TYPES[array.type_name])
        n = n_rows * array.components
        self._unpacked += n * dtype.itemsize
        if self._unpacked > self._limit:
            raise FormatError(
                f"{array.where}: the arrays up to here would take more than {self._limit:,} bytes, far more than the file has",
                f"A count is wrong, or the file is not to be trusted. {_RESAVE}",
            )
        if array.layout == "ascii":
            values = self._parse(array, n, dtype)
            if all_digits and dtype.kind == "f":
                return values.reshape(n_rows, array.components)
        else:
            values = np.frombuffer(self._bytes(array, n * dtype.itemsize), dtype=dtype)
        return values.astype(dtype.newbyteorder("=")).reshape(n_rows, array.components)

    def read_whole_numbers(self, array: Declared, n: int) -> IntArray:
        """Return an array of whole numbers, (n,)."""
        if not array.is_numeric or _TYPES[array.type_name].startswith("f") or array.components != 1:
            raise FormatError(f"{array.where}: the array does not hold whole numbers", _RESAVE)
        values = self.read(array, n)[:, 0]
        if values.dtype == np.uint64:
            values = np.minimum(values, np.uint64(np.iinfo(np.int64).max))
        return values.astype(np.int64)

    def _inline(self, array: Declared) -> bytes:
        """Return the text of an element, up to the first element inside of it or its end."""
        tag = _TAG.match(self._content, array.byte)
        assert tag is not None
        if tag[0].endswith(b"/>"):
            return b""
        return self._content[tag.end() : self._content.find(b"<", tag.end())]

    def _parse(self, array: Declared, n: int, dtype: np.dtype) -> NDArray:
        text = self._inline(array)
        if b"&" in text:
            raise FormatError(f"{array.where}: it holds something that is not a number", _RESAVE)
        wide = np.float64 if dtype.kind == "f" else np.int64
        values = parse_all(text, n, wide)
        if values is None:
            found = len(text.split())
            wrong = f"it has {found:,} numbers instead of {n:,}" if found != n else "it holds something that is not a number"
            raise FormatError(f"{array.where}: {wrong}", _RESAVE)
        if dtype.kind != "f" and len(values):
            limits = np.iinfo(dtype)
            if values.min() < limits.min or values.max() > limits.max:
                raise FormatError(f"{array.where}: a number is not from {limits.min} to {limits.max}", _RESAVE)
        return values

    def _bytes(self, array: Declared, n_bytes: int) -> bytes | memoryview:
        """Return the bytes of an array, which must be exactly so many."""
        if self._compressor not in ("", _ZLIB, _LZMA):
            shown = show(self._compressor.encode(errors="replace"))
            raise FormatError(
                f"the data are compressed by '{shown}'; only zlib and LZMA can be read",
                "Save the file without compression or with zlib.",
            )
        stream = self._stream(array)
        if not self._compressor:
            said = int(stream.words(1, self._word)[0])
            if said != n_bytes:
                raise FormatError(f"{array.where}: it has {said:,} bytes instead of {n_bytes:,}", _RESAVE)
            return stream.after_header(n_bytes)
        n_blocks = int(stream.words(1, self._word)[0])
        if not n_blocks:
            if n_bytes:
                raise FormatError(f"{array.where}: it is empty", _RESAVE)
            return b""
        if n_blocks * self._word.itemsize > stream.n_available:
            raise FormatError(f"{array.where}: it declares {n_blocks:,} blocks, more than the file can hold", _RESAVE)
        header = [int(word) for word in stream.words(3 + n_blocks, self._word)]
        block_bytes, last_bytes, packed = header[1], header[2], header[3:]
        sizes = [block_bytes] * (n_blocks - 1) + [last_bytes or block_bytes]
        if sum(sizes) != n_bytes:
            raise FormatError(f"{array.where}: it unpacks to {sum(sizes):,} bytes instead of {n_bytes:,}", _RESAVE)
        data = stream.after_header(sum(packed))
        result = bytearray()
        position = 0
        for size, packed_size in zip(sizes, packed, strict=True):
            result += self._unpack(data[position : position + packed_size], size, array)
            position += packed_size
        return bytes(result)

    def _unpack(self, data: bytes | memoryview, size: int, array: Declared) -> bytes:
        unpacker = zlib.decompressobj() if self._compressor == _ZLIB else lzma.LZMADecompressor(memlimit=_LZMA_MEMORY)
        try:
            block = unpacker.decompress(data, size + 1)
        except (zlib.error, lzma.LZMAError) as error:
            raise FormatError(f"{array.where}: a compressed block is damaged", _RESAVE) from error
        # The checksum is compared only when the end of the block was reached.
        if len(block) != size or not unpacker.eof:
            raise FormatError(f"{array.where}: a compressed block is not as long as the file tells", _RESAVE)
        return block

    def _stream(self, array: Declared) -> _Stream:
        if array.layout == "binary":
            return _Base64Stream(memoryview(b"".join(self._inline(array).split())), array.where, is_whole=True)
        if array.offset >= len(self._appended):
            raise FormatError(
                f"{array.where}: its data begin at byte {array.offset:,} of {len(self._appended):,} appended bytes",
                f"It was cut off or is damaged. {_RESAVE}",
            )
        data = self._appended[array.offset :]
        if self._appended_encoding == "raw":
            return _Stream(data, array.where)
        return _Base64Stream(data, array.where, is_whole=False)


class _Stream:
    """Raw bytes: the words of a header, then data."""

    def __init__(self, data: memoryview, where: str) -> None:
        self._data = data
        self._where = where
        self._header_bytes = 0

    @property
    def n_available(self) -> int:
        """At most so many bytes are there."""
        return len(self._data)

    def words(self, n: int, word: np.dtype) -> NDArray:
        """Return the first ``n`` words, which are the header."""
        self._header_bytes = n * word.itemsize
        return np.frombuffer(self._first(self._header_bytes), dtype=word)

    def after_header(self, n_bytes: int) -> bytes | memoryview:
        """Return the bytes that follow the header."""
        return self._first(self._header_bytes + n_bytes)[self._header_bytes :]

    def _first(self, n_bytes: int) -> bytes | memoryview:
        if n_bytes > len(self._data):
            raise self._cut_off(n_bytes)
        return self._data[:n_bytes]

    def _cut_off(self, n_bytes: int) -> FormatError:
        return FormatError(
            f"{self._where}: it should have {n_bytes:,} bytes, but the file ends before", f"It was cut off. {_RESAVE}"
        )


class _Base64Stream(_Stream):
    """The same in base64, where the header may be encoded for itself or together with the data.

    Args:
        data: the text; where it is the whole text of an element, it may not go on after the data.
        where: what to call the array in messages.
        is_whole: whether the text is that of an element.
    """

    def __init__(self, data: memoryview, where: str, *, is_whole: bool) -> None:
        super().__init__(data, where)
        self._is_whole = is_whole

    def after_header(self, n_bytes: int) -> bytes | memoryview:
        header_text = 4 * math.ceil(self._header_bytes / 3)
        is_joint = bool(self._header_bytes % 3) and bytes(self._data[header_text - 1 : header_text]) != b"="
        n_encoded = 4 * math.ceil((self._header_bytes + n_bytes) / 3) if is_joint else header_text + 4 * math.ceil(n_bytes / 3)
        if self._is_whole and len(self._data) > n_encoded:
            raise FormatError(f"{self._where}: its base64 text goes on after its {n_bytes:,} bytes", _RESAVE)
        return super().after_header(n_bytes) if is_joint else _decoded(self._data[header_text:], n_bytes, self._where)

    def _first(self, n_bytes: int) -> bytes | memoryview:
        return _decoded(self._data, n_bytes, self._where)


def _decoded(text: memoryview, n_bytes: int, where: str) -> bytes:
    """Return the first ``n_bytes`` bytes that a base64 text holds."""
    part = bytes(text[: 4 * math.ceil(n_bytes / 3)])
    try:
        data = binascii.a2b_base64(part, strict_mode=True) if part else b""
    except binascii.Error as error:
        raise FormatError(f"{where}: its base64 text is cut off or damaged", _RESAVE) from error
    if len(data) < n_bytes:
        raise FormatError(
            f"{where}: it should have {n_bytes:,} bytes, but there are {len(data):,}", f"It was cut off. {_RESAVE}"
        )
    return data[:n_bytes]


def _floats(low: str | None, high: str | None) -> FloatArray | None:
    try:
        limits = np.array([float(low or "nan"), float(high or "nan")])
    except ValueError:
        return None
    return limits if np.isfinite(limits).all() else None
