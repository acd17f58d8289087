"""Binary OFF, as Geomview defines it: big-endian numbers of 32 bits after a line such as ``OFF BINARY``."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dmp.formats.assemble import PolygonMesh, counted
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.zero_runs import refuse_unwritten_end
from dmp.mesh import IntArray

HEADER = re.compile(rb"\s*(?:#[^\n\r]*[\n\r]\s*)*(?P<kinds>(?:ST|C|N|4){0,4})(?P<dimensions>n?)OFF[ \t]+BINARY\b[^\n]*\n")
_NUMBER_BYTES = 4
_RESAVE = "Save or copy the file again from where it came from."


def read_binary_off(source: SourceFile) -> PolygonMesh:
    """Read a binary OFF file. Colours of vertices become the attribute ``color``.

    Raises:
        FormatError: with the byte, when the counts do not fit the bytes, a coordinate is not finite, or the file has
            another dimension than 3.
    """
    head = HEADER.match(source.head)
    if head is None:
        raise FormatError("the first line of the binary OFF file is damaged", _RESAVE)
    if head["dimensions"]:
        raise FormatError(
            "the binary OFF file is of the kind 'nOFF'", "Save it as a three-dimensional mesh, for example as PLY."
        )
    source.seek(head.end())
    body = source.read_exactly(source.size - head.end())
    words = len(body) // _NUMBER_BYTES
    integers = np.frombuffer(body, ">i4", words)
    if words < 3:
        raise FormatError("the file ends before the numbers of its vertices and faces", _RESAVE)
    n_vertices, n_faces = int(integers[0]), int(integers[1])
    kinds = head["kinds"]
    # Position, weight, normal, colour, texture coordinates, in this order.
    widths = (3, b"4" in kinds, 3 * (b"N" in kinds), 4 * (b"C" in kinds), 2 * (b"ST" in kinds))
    n_values = sum(widths)
    if n_vertices < 0 or n_faces < 0 or 3 + n_vertices * n_values + 2 * n_faces > words:
        raise FormatError(
            f"byte {head.end()}: {n_vertices:,} vertices and {n_faces:,} faces are declared, but {len(body):,} bytes follow",
            f"The file was cut off, or a count is wrong. {_RESAVE}",
        )
    first_face = 3 + n_vertices * n_values
    table = (
        np.frombuffer(body, ">f4", n_vertices * n_values, 3 * _NUMBER_BYTES).reshape(n_vertices, n_values).astype(np.float64)
    )
    good = np.isfinite(table).all(axis=1)
    if not good.all():
        row = int(good.argmin())
        raise FormatError(
            f"byte {head.end() + _NUMBER_BYTES * (3 + row * n_values):,}: vertex {row:,} has a value that is not finite",
            "Remove the vertex and its faces, or save the mesh again.",
        )
    notes: list[str] = []
    vertices, column = table[:, :3], 3
    if widths[1]:
        if (table[:, 3] == 0).any():
            raise FormatError(f"vertex {int((table[:, 3] == 0).argmax()):,} lies at infinity (its fourth value is 0)", _RESAVE)
        vertices, column = vertices / table[:, 3:4], 4
    if widths[2]:
        notes.append("Normals of the file were left out; they follow from the faces.")
    column += widths[2]
    attributes: dict[str, NDArray] = {"color": table[:, column : column + 4]} if widths[3] else {}
    if widths[4]:
        attributes["texture_u"], attributes["texture_v"] = table[:, -2], table[:, -1]

    def place(word: int) -> str:
        return f"byte {head.end() + _NUMBER_BYTES * word:,}"

    starts, end = _face_starts(integers, first_face, n_faces, place)
    counts = integers[starts].astype(np.int64)
    if (integers[starts + 1 + counts] > 0).any():
        notes.append("Colours of faces were left out.")
    _check_end(body, end * _NUMBER_BYTES, head.end(), notes)
    ends = np.cumsum(counts)
    places = np.repeat(starts + 1 - (ends - counts), counts) + np.arange(int(ends[-1]) if n_faces else 0)
    corners = integers[places].astype(np.int64)
    refuse_unwritten_end(corners, counts, "the faces")
    return PolygonMesh(vertices, corners, counts, lambda face: place(int(starts[face])), 0, attributes, notes)


def _face_starts(integers: NDArray, first: int, n_faces: int, place: Callable[[int], str]) -> tuple[IntArray, int]:
    """Return where each face begins, and where the last one ends: the number of its corners, corners, colours."""
    values = integers.tolist()
    starts = np.empty(n_faces, dtype=np.int64)
    position = first
    for face in range(n_faces):
        starts[face] = position
        n = values[position] if position < len(values) else -1
        end = position + 1 + n
        if n < 0 or end >= len(values) or not 0 <= values[end] <= 4 or end + 1 + values[end] > len(values):
            raise FormatError(
                f"{place(position)}: face {face:,} has {counted(n, 'corner')} or a colour that are not possible",
                f"It was cut off or is damaged. {_RESAVE}",
            )
        position = end + 1 + values[end]
    return starts, position


def _check_end(body: bytearray, end: int, offset: int, notes: list[str]) -> None:
    surplus = len(body) - end
    if surplus >= 2 * _NUMBER_BYTES and body[end:].strip(b"\0 \t\r\n\x1a"):
        raise FormatError(
            f"byte {offset + end:,}: {surplus:,} bytes follow after the last face that the file declares",
            f"A count is wrong, or the file is damaged. {_RESAVE}",
        )
    if surplus:
        notes.append(f"Ignored {counted(surplus, 'byte')} after the end of the mesh.")
