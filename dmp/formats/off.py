"""OFF as Geomview defines it, with its variants for colours, normals, texture and homogeneous coordinates."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dmp.formats.assemble import PolygonMesh
from dmp.formats.off_binary import read_binary_off
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.text import UNCLOSED_NOTE, NumberTable, NumberTableBuilder, TextBlocks, show
from dmp.mesh import FloatArray, IntArray, TriangleMesh

# Geomview has the letters in the order ST, C, N, 4, n; MeshLab writes NCOFF. Only in capitals a small n means dimensions.
KEYWORD = re.compile(rb"(?P<kinds>(?:ST|C|N|4){0,4})(?P<dimensions>n?)OFF|(?P<small_kinds>(?:st|c|n|4){0,4})off")
_BINARY = re.compile(rb"\s*(?:#[^\n\r]*[\n\r]\s*)*\w*OFF[ \t]+BINARY\b")
# Only after white space: some C libraries print what is not a number as "1.#IND".
_REMARK = re.compile(rb"(?<!\S)#[^\n]*")
_FACE_COLOUR_VALUES = (0, 1, 3, 4)
_RESAVE = "Save or copy the file again from where it came from."
_ROWS = 20_000


@dataclass(frozen=True)
class _Layout:
    """Which values a vertex has, in this order: position, weight, normal, colour, texture coordinates.

    MeshLab, the only program known to write NCOFF instead of CNOFF, puts the colour before the normal.
    """

    homogeneous: bool = False
    normals: bool = False
    colours: bool = False
    texture: bool = False
    colours_first: bool = False

    @property
    def n_values(self) -> int:
        """Values of a vertex, not counting its colour."""
        return 3 + self.homogeneous + 3 * self.normals + 2 * self.texture


@dataclass
class _Cursor:
    """A place in the numbers of the file: the index of a number, and that of its line."""

    number: int = 0
    line: int = 0


def read_off(source: SourceFile) -> PolygonMesh:
    """Read an OFF file: OFF, COFF, NOFF, STOFF, 4OFF and their combinations, as text or binary.

    Rows may be wrapped, and the keyword may be missing. Colours of vertices become the attribute ``color``, texture
    coordinates ``texture_u`` and ``texture_v``.

    Raises:
        FormatError: with the line, when the counts do not fit to what follows or something is not a finite number, and
            for dimensions other than 3.
    """
    if _BINARY.match(source.head):
        return read_binary_off(source)
    builder = NumberTableBuilder()
    notes: list[str] = []
    keyword: bytes | None = None
    text = TextBlocks(source)
    for block, first_line in text:
        numbers = _REMARK.sub(b"", block) if b"#" in block else block
        if keyword is None and (first := re.search(rb"\S+", numbers)):
            keyword = first[0] if KEYWORD.fullmatch(first[0]) else b""
            numbers = numbers[: first.start()] + numbers[first.start() + len(keyword) :]
        builder.add(numbers, first_line)
    if not keyword:
        notes.append("The file does not begin with 'OFF'; it was read as if it did.")
    if text.unclosed_line:
        notes.append(UNCLOSED_NOTE)
    rows = builder.table()
    cursor = _Cursor()
    layout = _layout(keyword or b"OFF", rows, cursor)
    n_vertices, n_faces = _declared_counts(rows, cursor)
    vertices, attributes = _read_vertices(rows, cursor, n_vertices, layout, notes)
    corners, counts, lines = _read_faces(rows, cursor.line, n_faces, notes)
    return PolygonMesh(vertices, corners, counts, lambda face: f"line {int(lines[face])}", 0, attributes, notes)


def _layout(keyword: bytes, rows: NumberTable, cursor: _Cursor) -> _Layout:
    match = KEYWORD.fullmatch(keyword)
    assert match is not None
    prefix = (match["kinds"] or match["small_kinds"] or b"").upper()
    if match["dimensions"]:
        if not len(rows) or rows.counts[0] != 1 or rows.values[0] != 3 or b"4" in prefix:
            raise FormatError(
                f"the file is of the kind '{show(keyword)}' and not three-dimensional", "Save it as a three-dimensional mesh."
            )
        cursor.number = cursor.line = 1
    return _Layout(b"4" in prefix, b"N" in prefix, b"C" in prefix, b"ST" in prefix, colours_first=b"NC" in prefix)


def _declared_counts(rows: NumberTable, cursor: _Cursor) -> tuple[int, int]:
    """Read the numbers of vertices and faces; that of the edges, which may be missing, means nothing."""
    available = rows.values[cursor.number : cursor.number + 3]
    n = 2 if cursor.line < len(rows) and rows.counts[cursor.line] == 2 else 3
    if len(available) < n:
        raise FormatError("the file ends before the numbers of its vertices and faces", _RESAVE)
    declared = available[:2]
    if not ((declared >= 0) & (declared < 2.0**53) & (declared == np.floor(declared))).all():
        raise FormatError(
            f"line {int(rows.lines[cursor.line])}: {declared[0]:g} and {declared[1]:g} are not numbers of vertices and faces",
            _RESAVE,
        )
    _advance(rows, cursor, n)
    return int(declared[0]), int(declared[1])


def _advance(rows: NumberTable, cursor: _Cursor, n: int) -> None:
    cursor.number += n
    cursor.line = int(np.searchsorted(rows.starts, cursor.number, side="right")) - 1
    if cursor.number >= len(rows.values):
        cursor.line = len(rows)


def _read_vertices(
    rows: NumberTable, cursor: _Cursor, n_vertices: int, layout: _Layout, notes: list[str]
) -> tuple[FloatArray, dict[str, NDArray]]:
    first_number, first_line = cursor.number, cursor.line
    n_values = _values_of_a_vertex(rows, cursor, n_vertices, layout, notes)
    table = rows.values[first_number : first_number + n_vertices * n_values].reshape(n_vertices, n_values)
    good = np.isfinite(table).all(axis=1)
    if not good.all():
        row = int(good.argmin())
        line = int(np.searchsorted(rows.starts, first_number + row * n_values, side="right")) - 1
        raise FormatError(
            f"line {int(rows.lines[max(line, first_line)])}: vertex {row:,} has a value that is not a finite number",
            "Remove the vertex and its faces, or save the mesh again.",
        )
    _advance(rows, cursor, n_vertices * n_values)
    vertices = table[:, :3]
    column = 3
    if layout.homogeneous:
        weights = table[:, 3:4]
        if (weights == 0).any():
            raise FormatError(f"vertex {int((weights == 0).argmax()):,} lies at infinity (its fourth value is 0)", _RESAVE)
        vertices = vertices / weights
        column = 4
    attributes: dict[str, NDArray] = {}
    n_colours = n_values - layout.n_values
    if n_colours:
        first = column + 3 * (layout.normals and not layout.colours_first)
        attributes["color"] = _colours(table[:, first : first + n_colours])
    column += n_colours
    if layout.normals:
        column += 3
        notes.append("Normals of the file were left out; they follow from the faces.")
    if layout.texture:
        attributes["texture_u"], attributes["texture_v"] = table[:, column], table[:, column + 1]
    return vertices, attributes


def _values_of_a_vertex(rows: NumberTable, cursor: _Cursor, n_vertices: int, layout: _Layout, notes: list[str]) -> int:
    """Find out how many values each vertex has, which the keyword does not tell about colours.

    Raises:
        FormatError: when the numbers that follow are too few, or their lines cannot be the rows of vertices.
    """
    possible = [layout.n_values + n for n in ((4, 3) if layout.colours else (0, 3, 4))]
    n_numbers = len(rows.values) - cursor.number
    if n_vertices * min(possible) > n_numbers:
        raise FormatError(
            f"the header declares {n_vertices:,} vertices, but only {n_numbers:,} numbers follow",
            f"The file was cut off, or the count is wrong. {_RESAVE}",
        )
    if not n_vertices:
        return possible[0]
    at_line_start = cursor.line < len(rows) and rows.starts[cursor.line] == cursor.number
    counts = rows.counts[cursor.line : cursor.line + n_vertices]
    if at_line_start and (counts == counts[0]).all() and counts[0] in possible:
        if not layout.colours and counts[0] > layout.n_values:
            notes.append("The vertices have colours, although the file does not begin with 'COFF'.")
        return int(counts[0])
    # Wrapped rows: the vertices must fill whole lines in a way that a missing or surplus number would break.
    candidates = possible if layout.colours else possible[:1]
    if counts[0] in candidates:  # the first line is a whole row, which tells how long the others are
        candidates = [int(counts[0])]
    for n_values in candidates:
        ends = rows.starts[cursor.line :] + rows.counts[cursor.line :] - cursor.number
        last = int(np.searchsorted(ends, n_vertices * n_values))
        if last < len(ends) and ends[last] == n_vertices * n_values and _is_wrapped(ends[: last + 1], n_values):
            return n_values
    expected = possible[-1] if layout.colours and counts[0] == possible[-1] else possible[0]
    wrong = int((counts != expected).argmax())
    raise FormatError(
        f"line {int(rows.lines[cursor.line + wrong])}: a vertex has {int(counts[wrong])} values instead of {expected}",
        f"A number is missing, or the count of vertices is wrong. {_RESAVE}",
    )


def _is_wrapped(ends: IntArray, n_values: int) -> bool:
    """Tell whether lines that end after so many numbers hold one row each in parts, several rows each, or are filled evenly."""
    counts = np.diff(ends, prepend=0)
    multiples = ends % n_values == 0
    in_parts = int(multiples.sum()) == int(ends[-1]) // n_values
    return in_parts or bool(multiples.all()) or bool((counts[:-1] == counts[0]).all() and counts[-1] <= counts[0])


def _colours(values: FloatArray) -> NDArray:
    """Return colours as whole numbers of 0 to 255 where the file has such, else as they are."""
    if values.size and values.max() > 1 and values.min() >= 0 and values.max() <= 255 and (values == np.floor(values)).all():
        return values.astype(np.uint8)
    return values


def _read_faces(rows: NumberTable, first: int, n_faces: int, notes: list[str]) -> tuple[IntArray, IntArray, IntArray]:
    """Return corners, the number of corners of each face, and the line of each face."""
    if n_faces > len(rows) - first:
        raise FormatError(
            f"the header declares {n_faces:,} faces, but the lines after its vertices are {max(len(rows) - first, 0):,}",
            f"The file was cut off, or a count is wrong. {_RESAVE}",
        )
    starts, lengths = rows.starts[first:], rows.counts[first:]
    sizes = rows.values[starts]
    if n_faces == len(starts) and ((sizes >= 0) & np.isin(lengths - 1 - sizes, _FACE_COLOUR_VALUES)).all():
        counts = sizes.astype(np.int64)
        lines = rows.lines[first:]
        coloured = bool((lengths - 1 > counts).any())
    else:
        starts, counts, lines, coloured = _read_wrapped_faces(rows, first, n_faces)
    if coloured:
        notes.append("Colours of faces were left out.")
    ends = np.cumsum(counts)
    places = np.repeat(starts + 1 - (ends - counts), counts) + np.arange(int(ends[-1]) if n_faces else 0)
    values = rows.values[places]
    good = (np.abs(values) < 2.0**53) & (values == np.floor(values))
    if not good.all():
        face = int(np.searchsorted(ends, int(good.argmin()), side="right"))
        raise FormatError(
            f"line {int(lines[face])}: the index of a vertex is not a whole number", f"Correct the line. {_RESAVE}"
        )
    return values.astype(np.int64), counts, lines


def _read_wrapped_faces(rows: NumberTable, first: int, n_faces: int) -> tuple[IntArray, IntArray, IntArray, bool]:
    """Read faces each of which begins on a line of its own and may go on over the next lines."""
    row_starts = rows.starts.tolist()
    row_ends = (rows.starts + rows.counts).tolist()
    starts, counts, lines = [], [], []
    coloured = False
    whole: set[tuple[int, bool]] = set()
    broken: list[tuple[int, bool, int, int]] = []
    row = first
    for face in range(n_faces):
        if row >= len(row_starts):
            raise FormatError(
                f"the header declares {n_faces:,} faces, but the file ends after {face:,}", f"It was cut off. {_RESAVE}"
            )
        line, start = int(rows.lines[row]), row_starts[row]
        size = rows.values[start]
        if not (size >= 0 and size == np.floor(size) and start + 1 + size <= len(rows.values)):
            raise FormatError(
                f"line {line}: {size:g} is not a possible number of corners of a face", f"Correct the line. {_RESAVE}"
            )
        end = start + 1 + int(size)
        first_row = row
        while row_ends[row] < end:
            row += 1
        surplus = row_ends[row] - end
        if row > first_row:
            shortest = min(row_ends[part] - row_starts[part] for part in range(first_row, row))
            broken.append((int(size), surplus > 0, shortest, line))
        else:
            whole.add((int(size), surplus > 0))
        if surplus not in _FACE_COLOUR_VALUES:
            raise FormatError(
                f"line {int(rows.lines[row])}: {surplus} values follow the {int(size)} corners; a colour has 1, 3 or 4",
                f"Correct the line. {_RESAVE}",
            )
        coloured |= surplus > 0
        starts.append(start)
        counts.append(int(size))
        lines.append(line)
        row += 1
    _check_broken(whole, broken)
    if row < len(row_starts):
        raise FormatError(
            f"line {int(rows.lines[row])}: the file goes on after the last of the {n_faces:,} declared faces",
            f"The count is wrong, or the file is damaged. {_RESAVE}",
        )
    return np.array(starts, dtype=np.int64), np.array(counts, dtype=np.int64), np.array(lines, dtype=np.int64), coloured


def _check_broken(whole: set[tuple[int, bool]], broken: list[tuple[int, bool, int, int]]) -> None:
    """Refuse a face that is broken over several lines for no reason and is of another kind than all the others.

    A number of corners that is damaged swallows the lines that follow.

    Args:
        whole: corners of the faces that stand on one line, and whether they have a colour.
        broken: the same for the others, the fewest numbers on a line that is not their last one, and their line.
    """
    longest = max((size + 1 for size, _ in whole), default=0)
    for size, coloured, shortest, line in broken:
        if shortest < longest and (size, coloured) not in whole:
            raise FormatError(
                f"line {line}: a face with {size:,} corners goes on over the next lines, unlike all the others", _RESAVE
            )


def write_off(mesh: TriangleMesh) -> Iterator[bytes]:
    """Yield a mesh as text OFF, positions with all digits that make them unique, without attributes."""
    yield f"OFF\n{mesh.n_vertices} {mesh.n_faces} 0\n".encode()
    for begin in range(0, mesh.n_vertices, _ROWS):
        rows = mesh.vertices[begin : begin + _ROWS]
        yield ("%r %r %r\n" * len(rows) % tuple(rows.ravel().tolist())).encode()
    for begin in range(0, mesh.n_faces, _ROWS):
        corners = mesh.faces[begin : begin + _ROWS]
        yield ("3 %d %d %d\n" * len(corners) % tuple(corners.ravel().tolist())).encode()
