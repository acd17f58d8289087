"""The header of a PLY file (G. Turk, "The PLY Polygon File Format", 1994): which elements follow, and how they are stored."""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass

import numpy as np

from dmp.formats.source import FormatError, SourceFile
from dmp.formats.text import encoding_of, show, transcode

# The names of 1994, those with their number of bits, and the 64-bit integers that some writers add.
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"},
    **{
        "int8": "i1",
        "uint8": "u1",
        "int16": "i2",
        "uint16": "u2",
        "int32": "i4",
        "uint32": "u4",
        "float32": "f4",
        "float64": "f8",
    },
    **{"int64": "i8", "uint64": "u8"},
}
_BYTE_ORDERS = {b"ascii": "", b"binary_little_endian": "<", b"binary_big_endian": ">"}
INDEX_LISTS = ("vertex_indices", "vertex_index")
_HEADER_BYTES = 1 << 24
_MAXIMUM_PROPERTIES = 1000
_MAXIMUM_ELEMENTS = 100
_END = re.compile(rb"(?:^|[\r\n])[ \t]*end_header[ \t]*(?=[\r\n]|$)")
_RESAVE = "Save or copy the file again from where it came from."
_CONVERT = "Open the file in the program it came from and save it as PLY again."


@dataclass(frozen=True)
class Property:
    """One property of an element: a number, or a list of numbers when ``count_type`` is set.

    Types are NumPy codes without byte order, such as ``"f4"``.
    """

    name: str
    value_type: str
    count_type: str | None = None


@dataclass(frozen=True)
class Element:
    """A table of the file: ``count`` rows of the same properties."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def has_lists(self) -> bool:
        """Whether rows may differ in length."""
        return any(item.count_type for item in self.properties)

    @property
    def smallest_row(self) -> int:
        """The fewest bytes that a row takes in a binary file: that of a row whose lists are empty."""
        return sum(np.dtype(item.count_type or item.value_type).itemsize for item in self.properties)

    def find(self, *names: str) -> Property | None:
        """Return the first property that has one of the names, or None."""
        return next((item for item in self.properties if item.name in names), None)


@dataclass(frozen=True)
class Header:
    """What the header says.

    Attributes:
        byte_order: ``"<"`` or ``">"`` for binary files, empty for text.
        elements: the tables in the order in which they follow.
        n_lines: lines of the header, the last of which is ``end_header``.
        n_bytes: where the tables of a binary file begin.
    """

    byte_order: str
    elements: tuple[Element, ...]
    n_lines: int
    n_bytes: int

    def find(self, name: str) -> Element | None:
        """Return the element of that name, or None."""
        return next((element for element in self.elements if element.name == name), None)


def read_header(source: SourceFile) -> Header:
    """Read and check the header of a PLY file, in any text encoding; binary tables can only follow a plain one.

    Raises:
        FormatError: with the line, for anything that the format does not know.
    """
    source.seek(0)
    raw = source.read_up_to(min(_HEADER_BYTES, source.size))
    text = transcode(raw)
    end = _END.search(text)
    if end is None:
        raise FormatError(
            "the header of the PLY file has no end (no line 'end_header')", f"The file was cut off or is damaged. {_RESAVE}"
        )
    header = text[: end.end()]
    if b"\0" in header:
        raise FormatError(f"the header has a zero byte at byte {header.index(0):,}, so it is damaged", _RESAVE)
    lines = header.replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
    byte_order, elements = _parse(lines)
    is_plain = encoding_of(raw) == "utf-8"
    if byte_order and not is_plain:
        raise FormatError("the binary file was converted like a text, which destroys it", _RESAVE)
    mark = len(codecs.BOM_UTF8) if raw.startswith(codecs.BOM_UTF8) else 0
    return Header(byte_order, elements, len(lines), mark + end.end() + _line_end_length(text, end.end()))


def _line_end_length(text: bytes, position: int) -> int:
    """Return how many bytes end the line at ``position``.

    After a lone carriage return the first byte of the tables may look like a line feed, so the other lines decide.
    """
    first = re.search(rb"\r\n|\r|\n", text)
    if first is not None and first[0] == b"\r":
        return 1
    return 2 if text[position : position + 2] == b"\r\n" else 1


def _parse(lines: list[bytes]) -> tuple[str, tuple[Element, ...]]:
    byte_order: str | None = None
    elements: list[Element] = []
    for number, line in enumerate(lines[:-1], 1):
        tokens = line.split()
        keyword = tokens[0] if tokens else b"comment"
        if keyword in (b"comment", b"obj_info") or (keyword == b"ply" and byte_order is None):
            continue
        if keyword == b"format":
            byte_order = _parse_format(tokens, number)
        elif keyword == b"element":
            element = _parse_element(tokens, number)
            if any(element.name == other.name for other in elements):
                raise FormatError(f"line {number}: the element '{show(tokens[1])}' is declared twice", _CONVERT)
            elements.append(element)
            if len(elements) > _MAXIMUM_ELEMENTS:
                raise FormatError(f"line {number}: the header declares more than {_MAXIMUM_ELEMENTS} elements", _CONVERT)
        elif keyword == b"property":
            if not elements:
                raise FormatError(f"line {number}: a property stands before the first element", _CONVERT)
            added = _parse_property(tokens, number)
            last = elements[-1]
            if last.find(added.name):
                raise FormatError(f"line {number}: the property '{show(tokens[-1])}' is declared twice", _CONVERT)
            if len(last.properties) >= _MAXIMUM_PROPERTIES:
                raise FormatError(f"line {number}: an element has more than {_MAXIMUM_PROPERTIES:,} properties", _CONVERT)
            elements[-1] = Element(last.name, last.count, (*last.properties, added))
        else:
            raise FormatError(f"line {number}: '{show(keyword)}' does not belong into the header of a PLY file", _RESAVE)
    if byte_order is None:
        raise FormatError("the header of the PLY file has no line 'format'", _RESAVE)
    return byte_order, tuple(elements)


def _parse_format(tokens: list[bytes], number: int) -> str:
    if len(tokens) != 3 or tokens[1] not in _BYTE_ORDERS:
        raise FormatError(
            f"line {number}: the PLY format '{show(b' '.join(tokens[1:]))}' is unknown",
            _CONVERT,
        )
    if tokens[2] != b"1.0":
        raise FormatError(f"line {number}: the PLY version '{show(tokens[2])}' is unknown; 1.0 can be read", _CONVERT)
    return _BYTE_ORDERS[tokens[1]]


def _parse_element(tokens: list[bytes], number: int) -> Element:
    if len(tokens) != 3:
        raise FormatError(f"line {number}: an element needs a name and a number of rows", _RESAVE)
    if not re.fullmatch(rb"\+?\d{1,18}", tokens[2]):
        raise FormatError(f"line {number}: '{show(tokens[2])}' is not a number of rows", _RESAVE)
    return Element(tokens[1].decode(errors="replace"), int(tokens[2]), ())


def _parse_property(tokens: list[bytes], number: int) -> Property:
    is_list = tokens[1:2] == [b"list"]
    if len(tokens) != (5 if is_list else 3):
        raise FormatError(f"line {number}: '{show(b' '.join(tokens))}' does not declare a property", _RESAVE)
    types = []
    for token in tokens[2:4] if is_list else tokens[1:2]:
        name = token.decode(errors="replace")
        if name not in _TYPES:
            raise FormatError(f"line {number}: the type '{show(token)}' is unknown", _CONVERT)
        types.append(_TYPES[name])
    name = tokens[-1].decode(errors="replace")
    if not is_list:
        return Property(name, types[0])
    if types[0].startswith("f"):
        raise FormatError(f"line {number}: the length of the list '{show(tokens[-1])}' is not a whole number", _CONVERT)
    return Property(name, types[1], types[0])
