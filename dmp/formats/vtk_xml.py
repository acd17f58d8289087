"""VTP, the XML format of VTK for surfaces: text, inline base64, and appended base64 or raw data, also compressed.

The file format is told in "The VTK User's Guide" (Kitware, 11th edition, 2010), chapter "VTK File Formats".
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dmp.formats.assemble import PolygonMesh
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.text import encoding_of, show, transcode
from dmp.formats.vtk_arrays import ArrayReader, Declared
from dmp.formats.vtk_cells import Piece, counts_of, join_pieces
from dmp.formats.xml_events import XmlEvents
from dmp.formats.zero_runs import refuse_unwritten_end
from dmp.mesh import IntArray

_MAXIMUM_ELEMENTS = 100_000
_MAXIMUM_PIECES = 5_000
_TAG = re.compile(rb"<AppendedData\b[^>]*>")
_ENCODING = re.compile(rb"""encoding\s*=\s*["'](\w+)["']""")
_CELL_SECTIONS = ("Verts", "Lines", "Strips", "Polys")
_SECTIONS = ("Points", "PointData", "CellData", *_CELL_SECTIONS)
_TOLERANCE = 1e-4
_RESAVE = "Save or copy the file again from where it came from."
_AS_POLYDATA = "Extract the surface in ParaView (filter Extract Surface) and save it as VTP or PLY."


@dataclass
class _DeclaredPiece:
    """What a piece declares: how many points and cells, and its arrays by section."""

    where: str
    numbers: dict[str, int]
    arrays: dict[str, list[Declared]] = field(default_factory=lambda: {section: [] for section in _SECTIONS})


def read_vtp(source: SourceFile) -> PolygonMesh:
    """Read a VTP file: all pieces of its PolyData as one mesh, and the numbers of its points.

    Raises:
        FormatError: with the line or the array, when it is no PolyData, is compressed in another way than by zlib or LZMA, or
            its arrays do not have the sizes that it declares.
    """
    source.seek(0)
    content = bytes(source.read_exactly(source.size))
    is_utf8 = encoding_of(content[:4]) == "utf-8"
    if not is_utf8:
        content = transcode(content)
    head, appended, start, encoding = _split(content)
    document = _Document(head, None if is_utf8 else "utf-8")
    reader = ArrayReader(content, document.attributes, source.size, appended=(start, appended, encoding))
    notes: list[str] = []
    pieces = [_read_piece(piece, reader, notes) for piece in document.pieces]
    if any(piece.arrays["CellData"] for piece in document.pieces):
        notes.append("Values of the cells of the file were left out.")
    return join_pieces(pieces, notes)


def _split(content: bytes) -> tuple[bytes, memoryview, int, str]:
    """Part the XML text from the data appended to it, which may be anything.

    Returns:
        The text, closed where the data were; the data; the byte where they begin; and their encoding.
    """
    tag = _TAG.search(content)
    if tag is None:
        return content, memoryview(b""), 0, ""
    if not content.rstrip(b"\0 \t\r\n").endswith(b"</VTKFile>"):
        raise FormatError("the file does not end with '</VTKFile>', so it was cut off or is damaged", _RESAVE)
    begin, end = content.find(b"_", tag.end()), content.rfind(b"</AppendedData>")
    if begin < 0 or end < begin or content[tag.end() : begin].strip():
        raise FormatError(f"byte {tag.end():,}: the appended data do not begin with '_' or have no end", _RESAVE)
    encoding = _ENCODING.search(tag[0])
    if encoding is None or encoding[1] not in (b"raw", b"base64"):
        raise FormatError(f"byte {tag.start():,}: the encoding of the appended data is unknown", _RESAVE)
    head = content[: tag.end()] + b"</AppendedData>" + content[end + len(b"</AppendedData>") :]
    return head, memoryview(content)[begin + 1 : end], begin + 1, encoding[1].decode()


class _Document:
    """The elements of the file.

    Attributes:
        attributes: those of the root element.
        pieces: in the order of the file.
    """

    def __init__(self, head: bytes, encoding: str | None) -> None:
        self.attributes: dict[str, str] = {}
        self.pieces: list[_DeclaredPiece] = []
        self._path: list[str] = []
        self._events = XmlEvents("", _MAXIMUM_ELEMENTS)
        self._events.parse(head, self._start, self._end, encoding=encoding)

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._path.append(name)
        depth = len(self._path)
        if depth == 1:
            self._begin(name, attributes)
        elif self._path[1:2] != ["PolyData"]:
            return
        elif name == "Piece" and depth == 3:
            if len(self.pieces) == _MAXIMUM_PIECES:
                raise self._events.error(f"there are more than {_MAXIMUM_PIECES:,} pieces", "Save the mesh as one piece.")
            keys = ("NumberOfPoints", *(f"NumberOf{section}" for section in _CELL_SECTIONS))
            numbers = {key: self._number(attributes, key) for key in keys if key in attributes or key == "NumberOfPoints"}
            self.pieces.append(_DeclaredPiece(f"piece {len(self.pieces)}", numbers))
        elif name in ("DataArray", "PDataArray", "Array") and depth == 5 and self._path[2] == "Piece":
            section = self._path[3]
            if section in _SECTIONS:
                if f"NumberOf{section}" not in self.pieces[-1].numbers and section in _CELL_SECTIONS:
                    raise self._events.error(f"the piece does not tell the number of its {section}")
                declared = Declared.from_attributes(attributes, f"{self.pieces[-1].where}, {section}", self._events.byte)
                self.pieces[-1].arrays[section].append(declared)

    def _end(self, name: str) -> None:
        self._path.pop()

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        if name != "VTKFile":
            raise self._events.error(f"the file begins with '{show(name.encode(errors='replace'))}' and is no VTK file")
        kind = attributes.get("type", "")
        if kind != "PolyData":
            raise FormatError(
                f"the VTK file holds '{show(kind.encode(errors='replace'))}' and no PolyData, the kind for surfaces",
                _AS_POLYDATA,
            )
        self.attributes = attributes

    def _number(self, attributes: dict[str, str], key: str) -> int:
        text = attributes.get(key, "0").strip()
        if not re.fullmatch(r"[0-9]{1,15}", text):
            raise self._events.error(f"'{key}' is not a number")
        return int(text)


def _read_piece(piece: _DeclaredPiece, reader: ArrayReader, notes: list[str]) -> Piece:
    n_points = piece.numbers["NumberOfPoints"]
    points = np.zeros((0, 3))
    if n_points:
        declared = piece.arrays["Points"]
        if len(declared) != 1 or declared[0].components != 3:
            raise FormatError(f"{piece.where} has no array of positions with three components", _RESAVE)
        points = reader.read(declared[0], n_points, all_digits=True).astype(np.float64)
        good = np.isfinite(points).all(axis=1)
        if not good.all():
            raise FormatError(
                f"{piece.where}: point {int(good.argmin()):,} has a coordinate that is not a finite number",
                "Remove the point and its faces, or save the mesh again.",
            )
        _check_range(declared[0], points, piece.where, notes)
    values: dict[str, NDArray] = {}
    for array in piece.arrays["PointData"]:
        if array.name.lower() in ("normals", "tcoords", "texture coordinates"):
            _note_once(notes, "Texture coordinates and normals of the file were left out.")
        elif not array.is_numeric:
            _note_once(notes, "Values of the vertices that are no numbers were left out.")
        elif n_points:
            values[array.name] = reader.read(array, n_points)
    return Piece(
        piece.where,
        points,
        _cells(piece, "Polys", reader),
        _cells(piece, "Strips", reader),
        piece.numbers.get("NumberOfVerts", 0),
        piece.numbers.get("NumberOfLines", 0),
        values,
    )


def _cells(piece: _DeclaredPiece, section: str, reader: ArrayReader) -> tuple[IntArray, IntArray]:
    """Return the corners of all cells of a section one after the other, and how many each has."""
    n_cells = piece.numbers.get(f"NumberOf{section}", 0)
    empty = np.zeros(0, dtype=np.int64)
    if not n_cells:
        return empty, empty
    where = f"{piece.where}, {section}"
    arrays = {array.name: array for array in piece.arrays[section]}
    if "connectivity" not in arrays or "offsets" not in arrays:
        raise FormatError(f"{where}: the arrays 'connectivity' and 'offsets' are not both there", _RESAVE)
    offsets = reader.read_whole_numbers(arrays["offsets"], n_cells)
    if offsets[-1] < 0:
        raise FormatError(f"{where}: the places where cells end are negative", _RESAVE)
    corners = reader.read_whole_numbers(arrays["connectivity"], int(offsets[-1]))
    counts = counts_of(offsets, len(corners), where)
    if arrays["connectivity"].layout != "ascii":
        refuse_unwritten_end(corners, counts, where)
    return corners, counts


def _check_range(array: Declared, points: NDArray, where: str, notes: list[str]) -> None:
    """Note when the lengths of the positions are not what the file tells: a sign of damage, or of a careless program."""
    if array.range is None:
        return
    lengths = np.sqrt((points**2).sum(axis=1))
    found = np.array([lengths.min(), lengths.max()])
    if (np.abs(found - array.range) > _TOLERANCE * max(abs(array.range[1]), 1e-300)).any():
        notes.append(f"The positions of {where} do not fit to the range that the file tells for them; it may be damaged.")


def _note_once(notes: list[str], note: str) -> None:
    if note not in notes:
        notes.append(note)
