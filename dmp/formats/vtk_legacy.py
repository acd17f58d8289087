"""Legacy VTK files (.vtk) with PolyData: text, and binary in big-endian order, in the layouts of versions 1 to 5."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from dmp.formats.assemble import PolygonMesh, counted
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.text import UNCLOSED_NOTE, encoding_of, not_a_number, parse_all, show, transcode
from dmp.formats.vtk_cells import Piece, counts_of, join_pieces
from dmp.formats.zero_runs import refuse_unwritten_end
from dmp.mesh import FloatArray, IntArray

MAGIC = b"# vtk DataFile"
_HEAD = re.compile(rb"# vtk DataFile Version (\d)\.(\d)[^\n]*\n[^\n]*\n[ \t]*(ASCII|BINARY)\b[^\n]*\n", re.IGNORECASE)
_TYPES = {
    **{"char": "i1", "unsigned_char": "u1", "short": "i2", "unsigned_short": "u2", "int": "i4", "unsigned_int": "u4"},
    **{"long": "i8", "unsigned_long": "u8", "vtktypeint64": "i8", "vtktypeuint64": "u8", "vtktypeint32": "i4"},
    **{"vtkidtype": "i4", "float": "f4", "double": "f8"},
}
_CELLS = ("POLYGONS", "TRIANGLE_STRIPS", "VERTICES", "LINES")
_VALUES = ("POINT_DATA", "CELL_DATA")
_KEYWORDS = (*_CELLS, *_VALUES, "POINTS", "METADATA", "FIELD", "OFFSETS", "CONNECTIVITY", "DATASET")
_NEXT_KEYWORD = re.compile(rb"^[ \t]*(?:%s)\b" % "|".join(_KEYWORDS).encode(), re.MULTILINE | re.IGNORECASE)
_FILLED = re.compile(rb"[^ \t\r\n]")
_OFFSETS = re.compile(rb"\s*OFFSETS\b", re.IGNORECASE)
_MAXIMUM_FIELDS = 1000
_FEW_ZEROS = 7
_LINES = 1000
_RESAVE = "Save or copy the file again from where it came from."
_AS_POLYDATA = "Extract the surface in ParaView (filter Extract Surface) and save it as VTP or PLY."


def read_vtk(source: SourceFile) -> PolygonMesh:
    """Read a legacy VTK file. Values of its points and cells are left out.

    Raises:
        FormatError: with line or byte, when it is no PolyData, or holds fewer or other numbers than it declares.
    """
    source.seek(0)
    content = bytes(source.read_exactly(source.size))
    if encoding_of(content[:4]) != "utf-8":
        content = transcode(content)
    content = content.removeprefix(b"\xef\xbb\xbf")
    binary = re.match(rb"[^\n\r]*(?:\r\n|\n|\r)[^\n\r]*(?:\r\n|\n|\r)[ \t]*BINARY", content, re.IGNORECASE) is not None
    if not binary:
        if b"\0" in content:
            raise FormatError(f"the text has a zero byte at byte {content.index(0):,}, so the file is damaged", _RESAVE)
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    head = _HEAD.match(content)
    if head is None:
        raise FormatError(
            "the first three lines are not those of a VTK file (version, title, ASCII or BINARY)", f"It is damaged. {_RESAVE}"
        )
    if int(head[1]) > 5:
        raise FormatError(f"the file is of version {int(head[1])}.{int(head[2])}; versions up to 5 can be read", _RESAVE)
    return _Reader(content, head.end(), binary=head[3].upper() == b"BINARY").read()


class _Reader:
    """Goes from keyword to keyword."""

    def __init__(self, content: bytes, position: int, *, binary: bool) -> None:
        self.content = content
        self.position = position
        self.binary = binary
        self.points: FloatArray | None = None
        self.cells: dict[str, tuple[IntArray, IntArray]] = {}
        self.notes: list[str] = []

    def read(self) -> PolygonMesh:
        """Read the whole file."""
        tokens = self._next_line()
        skipped = 0
        while tokens and tokens[0].upper() == "FIELD" and skipped < _MAXIMUM_FIELDS:  # such as a time, before everything
            skipped += 1
            self._skip_fields(tokens)
            tokens = self._next_line()
        if len(tokens) != 2 or tokens[0].upper() != "DATASET":
            raise self._error("the line 'DATASET …' is missing")
        if tokens[1].upper() != "POLYDATA":
            raise FormatError(
                f"the VTK file holds '{show(tokens[1].encode())}' and no POLYDATA, the kind for surfaces", _AS_POLYDATA
            )
        while tokens := self._next_line():
            keyword = tokens[0].upper()
            if keyword == "POINTS" and self.points is None:
                self.points = self._read_points(tokens)
            elif keyword in _CELLS and keyword not in self.cells:
                self.cells[keyword] = self._read_cells(keyword, tokens)
            elif keyword in ("FIELD", "METADATA") and skipped < _MAXIMUM_FIELDS:
                skipped += 1
                if keyword == "FIELD":
                    self._skip_fields(tokens)
                else:
                    self._skip_metadata()
            elif keyword in _VALUES:
                self.notes.append("Values of the vertices and faces of the file were left out.")
                break
            else:
                raise self._error(f"'{show(tokens[0].encode())}' is out of place")
        if not self.content.rstrip(b"\0").endswith(b"\n"):
            self.notes.append(UNCLOSED_NOTE)
        if self.points is None:
            raise FormatError("the file holds no vertices", _RESAVE)
        empty = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        if self.binary:
            for keyword, (corners, counts) in self.cells.items():
                refuse_unwritten_end(corners, counts, f"the {keyword.lower().replace('_', ' ')}")
        piece = Piece(
            "the file",
            self.points,
            self.cells.get("POLYGONS", empty),
            self.cells.get("TRIANGLE_STRIPS", empty),
            len(self.cells.get("VERTICES", empty)[1]),
            len(self.cells.get("LINES", empty)[1]),
        )
        return join_pieces([piece], self.notes)

    def _place(self) -> str:
        if self.binary:
            return f"byte {self.position:,}"
        line = self.content.count(b"\n", 0, max(self.position - 1, 0)) + 1
        return f"line {line:,}"

    def _error(self, cause: str, remedy: str = _RESAVE) -> FormatError:
        return FormatError(f"{self._place()}: {cause}", remedy)

    def _next_line(self) -> list[str]:
        """Return the words of the next line that is not blank; none at the end of the file."""
        filled = _FILLED.search(self.content, self.position)
        if filled is None:
            return []
        self.position = max(self.position, self.content.rfind(b"\n", self.position, filled.start()) + 1)
        while self.position < len(self.content):
            end = self.content.find(b"\n", self.position)
            end = len(self.content) if end < 0 else end
            line = self.content[self.position : min(end, self.position + 1000)]
            self.position = end + 1
            if line.strip(b"\0 \t\r\n\x1a"):
                return line.decode("utf-8", errors="replace").split()
            if line.count(0) > _FEW_ZEROS:
                raise self._error("many zero bytes follow, so the file was never written to its end")
            if b"\0" in line:
                self.notes.append("The file ends in zero bytes; if it was cut off, its last face is wrong.")
        return []

    def _counts(self, tokens: list[str], n: int) -> list[int]:
        """Return the numbers of a line after its keyword."""
        numbers = tokens[1 : n + 1]
        if len(numbers) != n or not all(re.fullmatch(r"[0-9]{1,15}", number) for number in numbers):
            raise self._error(f"after '{show(tokens[0].encode())}' the numbers of what follows are missing")
        return [int(number) for number in numbers]

    def _type(self, name: str) -> np.dtype:
        if name.lower() not in _TYPES:
            raise self._error(f"the type '{show(name.encode())}' is unknown")
        return np.dtype(">" + _TYPES[name.lower()])

    def _read_points(self, tokens: list[str]) -> FloatArray:
        (n,) = self._counts(tokens, 1)
        if len(tokens) != 3:
            raise self._error("the type of the points is missing")
        place = self._place()
        points = self._numbers(3 * n, self._type(tokens[2]), "points").astype(np.float64).reshape(-1, 3)
        good = np.isfinite(points).all(axis=1)
        if not good.all():
            raise FormatError(
                f"{place}: point {int(good.argmin()):,} after this place has a coordinate that is not a finite number",
                "Remove the point and its faces, or save the mesh again.",
            )
        return points

    def _read_cells(self, keyword: str, tokens: list[str]) -> tuple[IntArray, IntArray]:
        """Return the corners of all cells one after the other, and how many each has."""
        first, second = self._counts(tokens, 2)
        if _OFFSETS.match(self.content, self.position):
            return self._read_cells_of_version_5(keyword, first, second, self._next_line())
        place = self._place()
        values = self._numbers(second, np.dtype(">i4"), keyword.lower()).astype(np.int64)
        empty = np.zeros(0, dtype=np.int64)
        if not first:
            return empty, empty
        width = second // first
        if second == width * first and width and (values[::width] == width - 1).all():
            return values.reshape(first, width)[:, 1:].ravel(), np.full(first, width - 1, dtype=np.int64)
        starts = _walk(values.tolist(), first)
        if starts is None:
            raise FormatError(
                f"{place}: the {second:,} numbers of the {keyword.lower()} are not {counted(first, 'cell')}",
                f"A count is wrong, or the file is damaged. {_RESAVE}",
            )
        is_corner = np.ones(len(values), dtype=bool)
        is_corner[starts] = False
        return values[is_corner], values[starts]

    def _read_cells_of_version_5(
        self, keyword: str, n_offsets: int, n_corners: int, tokens: list[str]
    ) -> tuple[IntArray, IntArray]:
        place = self._place()
        offsets = self._whole_numbers(n_offsets, tokens, keyword)
        tokens = self._next_line()
        if not tokens or tokens[0].upper() != "CONNECTIVITY":
            raise self._error("the line 'CONNECTIVITY …' is missing")
        corners = self._whole_numbers(n_corners, tokens, keyword)
        if not len(offsets):
            return corners[:0], corners[:0]
        if offsets[0] != 0:
            raise FormatError(f"{place}: the first of the {keyword.lower()} does not begin at 0", _RESAVE)
        return corners, counts_of(offsets[1:], len(corners), f"{place}, {keyword.lower()}")

    def _whole_numbers(self, n: int, tokens: list[str], keyword: str) -> IntArray:
        if len(tokens) != 2 or _TYPES.get(tokens[1].lower(), "f").startswith("f"):
            raise self._error("the type of whole numbers is missing")
        values = self._numbers(n, self._type(tokens[1]), keyword.lower())
        if values.dtype == np.uint64:
            values = np.minimum(values, np.uint64(np.iinfo(np.int64).max))
        return values.astype(np.int64)

    def _numbers(self, n: int, dtype: np.dtype, what: str) -> NDArray:
        """Return the next ``n`` numbers, in the byte order of this machine; those of a text keep all digits."""
        if self.binary:
            n_bytes = n * dtype.itemsize
            if n_bytes > len(self.content) - self.position:
                raise self._error(
                    f"the {what} take {n_bytes:,} bytes, but only {max(len(self.content) - self.position, 0):,} follow",
                    f"The file was cut off, or a count is wrong. {_RESAVE}",
                )
            values = np.frombuffer(self.content, dtype, n, self.position)
            self.position += n_bytes
            return values.astype(dtype.newbyteorder("="))
        following = _NEXT_KEYWORD.search(self.content, self.position)
        end = following.start() if following else len(self.content)
        text = self.content[self.position : end]
        values_or_none = parse_all(text, n, np.float64 if dtype.kind == "f" else np.int64)
        if values_or_none is None:
            raise self._fault(text, n, what)
        self.position = end
        return values_or_none

    def _fault(self, text: bytes, n: int, what: str) -> FormatError:
        """Return why a text does not hold ``n`` numbers."""
        first_line = self.content.count(b"\n", 0, self.position) + 1
        lines = text.split(b"\n")
        n_found = 0
        for begin in range(0, len(lines), _LINES):
            part = b"\n".join(lines[begin : begin + _LINES])
            n_words = len(part.split())
            n_found += n_words
            if parse_all(part, n_words, np.float64) is None:  # word by word, that takes seconds for a few megabytes
                for line, words in enumerate(lines[begin : begin + _LINES], first_line + begin):
                    for word in words.split():
                        if parse_all(word, 1, np.float64) is None:
                            return not_a_number(word, line)
        if n_found == n:
            return FormatError(f"line {first_line:,}: one of the {what} from here on is not a whole number", _RESAVE)
        return FormatError(
            f"line {first_line:,}: {n:,} numbers are declared for the {what}, but {n_found:,} follow",
            f"The file was cut off, or a count is wrong. {_RESAVE}",
        )

    def _skip_metadata(self) -> None:
        """Go on after the next blank line."""
        end = re.compile(rb"\n[ \t\r]*\n").search(self.content, self.position - 1)
        self.position = end.end() if end else len(self.content)

    def _skip_fields(self, tokens: list[str]) -> None:
        """Go on after the arrays of a FIELD, which belong to the file as a whole."""
        if len(tokens) != 3 or not re.fullmatch(r"[0-9]{1,6}", tokens[2]) or int(tokens[2]) > _MAXIMUM_FIELDS:
            raise self._error("a FIELD has no number of arrays")
        for _ in range(int(tokens[2])):
            array = self._next_line()
            if array and array[0].upper() == "METADATA":
                self._skip_metadata()
                array = self._next_line()
            if len(array) != 4:
                raise self._error("an array of a FIELD does not tell its name, its extent and its type")
            components, rows = self._counts(array[:3], 2)
            if array[3].lower() not in _TYPES:
                raise self._error(f"the type '{show(array[3].encode())}' in a FIELD cannot be read", "Remove that array.")
            if self.binary:
                self._numbers(components * rows, self._type(array[3]), "numbers of a FIELD")
            else:
                self._skip_words(components * rows)

    def _skip_words(self, n: int) -> None:
        found = 0
        for match in re.compile(rb"\S+").finditer(self.content, self.position):
            if found == n:
                break
            found += 1
            self.position = match.end()
        if found < n:
            raise self._error("the file ends inside a FIELD")


def _walk(values: list[int], n_cells: int) -> list[int] | None:
    """Return where each cell begins, as "number of corners, corners …" one after the other; None when that does not fit."""
    starts = []
    position = 0
    for _ in range(n_cells):
        if position >= len(values) or values[position] < 0:
            return None
        starts.append(position)
        position += 1 + values[position]
    return starts if position == len(values) else None
