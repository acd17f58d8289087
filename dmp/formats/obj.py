"""Wavefront OBJ: positions, polygons and colours per vertex. Materials, textures and curves are left out.

Blocks of lines that look as programs write them are read with NumPy; a block with anything unusual in it, or wrong,
is read line by line, which finds the line to tell.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from dmp.formats.assemble import PolygonMesh, counted
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.text import (
    NEWLINE,
    UNCLOSED_NOTE,
    TextBlocks,
    parse_all,
    parse_integer,
    parse_number,
    show,
    token_counts,
)
from dmp.mesh import BoolArray, FloatArray, IntArray

_VERTEX, _FACE = ord("v"), ord("f")
_SLASHED = re.compile(rb"(?<=\d)/(?:[+-]?\d+)?(?:/(?:[+-]?\d+)?)?(?=\s)")
# Only after white space: some C libraries print what is not a number as "1.#IND".
_REMARK = re.compile(rb"(?<!\S)#[^\n]*")
_CORNER = re.compile(rb"([^/]+)(?:/(?:[+-]?\d+)?)?(?:/(?:[+-]?\d+)?)?")
_SAID_COUNT = re.compile(rb"^#\s*(vertices|faces):\s*(\d{1,12})\s*$", re.IGNORECASE | re.MULTILINE)
_RESAVE = "Save or copy the file again from where it came from."

_SILENT = {b"g", b"o", b"s", b"mg", b"usemtl", b"mtllib", b"usemap", b"maplib", b"bevel", b"c_interp", b"d_interp", b"lod"}
_SILENT |= {b"shadow_obj", b"trace_obj", b"ctech", b"stech", b"vw", b"t"}
_TEXTURE = {b"vt", b"vn"}
_LINES = {b"l", b"p"}
_CURVES = {b"vp", b"cstype", b"deg", b"bmat", b"step", b"curv", b"curv2", b"surf", b"parm", b"trim", b"hole", b"scrv", b"sp"}
_CURVES |= {b"end", b"con", b"bsp", b"bzp", b"cdc", b"cdp", b"res"}
_CALLS = {b"call", b"csh"}
STATEMENTS = {b"v", b"f", b"fo"} | _SILENT | _TEXTURE | _LINES | _CURVES | _CALLS
_LEFT_OUT = (
    (_LINES, "line or point statement", "line and point statements"),
    (_CURVES, "statement on curves and surfaces", "statements on curves and surfaces"),
    (_CALLS, "call of another file", "calls of other files"),
)


class _Reader:
    """Everything read so far."""

    def __init__(self) -> None:
        self.n_vertices = 0
        self.positions: list[FloatArray] = []
        self.corners: list[IntArray] = []
        self.counts: list[IntArray] = []
        self.lines: list[IntArray] = []
        self.left_out: Counter[bytes] = Counter()

    def add_vertices(self, values: FloatArray) -> None:
        """Add vertices (n, k) with k = 3 (position), 4 (and weight), 6 (and colour) or 7 (and opacity) values."""
        self.positions.append(values)
        self.n_vertices += len(values)

    def add_faces(self, corners: IntArray, counts: IntArray, lines: IntArray) -> None:
        """Add faces with indices counted from 0."""
        self.corners.append(corners)
        self.counts.append(counts)
        self.lines.append(lines)

    def read_block(self, block: bytes, first_line: int) -> None:
        """Read whole lines.

        Raises:
            FormatError: with the line, for anything that is not OBJ.
        """
        if b"#" in block:
            block = _REMARK.sub(b"", block)
        if not self._read_regular(block, first_line):
            self._read_lines(block, first_line)

    def _read_regular(self, block: bytes, first_line: int) -> bool:
        """Read a block that holds nothing unusual, or return False and change nothing."""
        if b"\\\n" in block:
            return False
        text = np.frombuffer(block, dtype=np.uint8)
        ends = np.flatnonzero(text == NEWLINE)
        starts = np.append(0, ends[:-1] + 1)
        first, second, third = (text[np.minimum(starts + offset, ends)] for offset in range(3))
        keyword_ends = second <= 32
        is_vertex, is_face = (first == _VERTEX) & keyword_ends, (first == _FACE) & keyword_ends
        is_texture = (first == _VERTEX) & ((second == ord("t")) | (second == ord("n"))) & (third <= 32)
        left_out: Counter[bytes] = Counter({b"vt": int(np.count_nonzero(is_texture))})
        for line in np.flatnonzero(~(is_vertex | is_face | is_texture | (first == NEWLINE))):
            keyword = block[starts[line] : ends[line]].split(None, 1)[:1]
            if keyword and (keyword[0] not in STATEMENTS or keyword[0] in {b"v", b"f", b"fo"}):
                return False
            left_out.update(keyword)

        vertices = np.zeros((0, 3))
        if is_vertex.any():
            rows = _select(text, starts, ends, is_vertex)
            counts = token_counts(rows)
            n_values = int(counts[0])
            values = parse_all(rows.tobytes(), int(counts.sum()), np.float64)
            if n_values not in (3, 4, 6, 7) or (counts != n_values).any() or values is None or not np.isfinite(values).all():
                return False
            vertices = values.reshape(-1, n_values)
        if is_face.any():
            bare = _SLASHED.sub(b"", _select(text, starts, ends, is_face).tobytes())
            counts = token_counts(np.frombuffer(bare, dtype=np.uint8))
            corners = parse_all(bare, int(counts.sum()), np.int64)
            if corners is None or counts.min() < 3 or (corners == 0).any():
                return False
            face_lines = np.flatnonzero(is_face)
            relative = corners < 0
            if relative.any():
                vertices_before = np.repeat((self.n_vertices + np.cumsum(is_vertex))[face_lines], counts)
                corners = np.where(relative, corners + vertices_before, corners - 1)
                if (corners < 0).any():
                    return False
            else:
                corners -= 1
            self.add_faces(corners, counts, face_lines + first_line)
        if len(vertices):
            self.add_vertices(vertices)
        self.left_out.update(left_out)
        return True

    def _read_lines(self, block: bytes, first_line: int) -> None:
        """Read a block statement by statement."""
        vertices: list[list[float]] = []
        corners: list[int] = []
        counts: list[int] = []
        lines: list[int] = []
        for line, statement in _statements(block, first_line):
            tokens = statement.split()
            if not tokens:
                continue
            keyword = tokens[0]
            if keyword == b"v":
                vertices.append([parse_number(token, line) for token in tokens[1:]])
                if len(tokens) - 1 not in (3, 4, 6, 7):
                    raise FormatError(
                        f"line {line}: a vertex has {len(tokens) - 1} values instead of 3 (x y z), 4, 6 (with colour) or 7",
                        f"Correct the line. {_RESAVE}",
                    )
            elif keyword in (b"f", b"fo"):
                if len(tokens) < 4:
                    raise FormatError(
                        f"line {line}: a face has {counted(len(tokens) - 1, 'corner')}; at least 3 are needed", _RESAVE
                    )
                corners.extend(_vertex_index(token, self.n_vertices + len(vertices), line) for token in tokens[1:])
                counts.append(len(tokens) - 1)
                lines.append(line)
            elif keyword in STATEMENTS:
                self.left_out[keyword] += 1
            else:
                raise FormatError(
                    f"line {line}: '{show(keyword)}' does not begin any OBJ statement",
                    "If it is a remark, put a # before it; otherwise the file is damaged or of another format.",
                )
        for _, run in groupby(vertices, key=len):
            self.add_vertices(np.array(list(run)))
        if counts:
            self.add_faces(np.array(corners, dtype=np.int64), np.array(counts, dtype=np.int64), np.array(lines, dtype=np.int64))

    def polygon_mesh(self, said: dict[bytes, int], unclosed_line: bytes) -> PolygonMesh:
        """Return everything read, with notes.

        Args:
            said: the numbers of vertices and faces that a comment at the top of the file tells.
            unclosed_line: the last line, if no line end follows it.

        Raises:
            FormatError: when less was found than was said, or there are only lines or curves.
        """
        n_faces = sum(len(counts) for counts in self.counts)
        # MeshLab counts triangles also where it writes larger polygons.
        n_triangles = sum(int(counts.sum()) for counts in self.counts) - 2 * n_faces
        for what, n_found in ((b"vertices", self.n_vertices), (b"faces", max(n_faces, n_triangles))):
            if said.get(what, 0) > n_found:
                raise FormatError(
                    f"a comment tells of {said[what]:,} {what.decode()}, but the file holds {n_found:,}: it was cut off",
                    f"{_RESAVE} If it is complete, delete that comment.",
                )
        notes: list[str] = []
        for kind, singular, plural in _LEFT_OUT:
            n_left_out = sum(self.left_out[keyword] for keyword in kind)
            if n_left_out and not n_faces:
                raise FormatError(
                    f"the file holds {counted(n_left_out, singular, plural)} but no faces",
                    "Convert it to a triangle mesh with the program it came from.",
                )
            if n_left_out:
                notes.append(f"Left out {counted(n_left_out, singular, plural)}.")
        if any(self.left_out[keyword] for keyword in _TEXTURE):
            notes.append("Texture coordinates and normals of the file were left out.")
        if unclosed_line.strip() and not unclosed_line.lstrip().startswith(b"#"):
            notes.append(UNCLOSED_NOTE)
        first_faces = np.cumsum([0, *(len(counts) for counts in self.counts)])

        def place(face: int) -> str:
            block = int(np.searchsorted(first_faces, face, side="right")) - 1
            return f"line {int(self.lines[block][face - first_faces[block]])}"

        colours = self._colours(notes)
        return PolygonMesh(
            vertices=np.concatenate([np.zeros((0, 3)), *(values[:, :3] for values in self.positions)]),
            corners=np.concatenate([np.zeros(0, dtype=np.int64), *self.corners]),
            counts=np.concatenate([np.zeros(0, dtype=np.int64), *self.counts]),
            place=place,
            first_index=1,
            attributes={} if colours is None else {"color": colours},
            notes=notes,
        )

    def _colours(self, notes: list[str]) -> FloatArray | None:
        """Return the colours of the vertices, (V, 3) or (V, 4), if all have some."""
        widths = {values.shape[1] for values in self.positions}
        if widths in ({6}, {7}):
            return np.concatenate([values[:, 3:] for values in self.positions])
        if any((values[:, 3] != 1.0).any() for values in self.positions if values.shape[1] == 4):
            notes.append("The weights of vertices (their fourth value) were left out.")
        if widths & {6, 7}:
            notes.append("Colours were left out, because not all vertices have one of the same kind.")
        return None


def read_obj(source: SourceFile) -> PolygonMesh:
    """Read a Wavefront OBJ file, in any text encoding.

    Positions are read in double precision. Faces may have any number of corners, written ``v``, ``v/vt``, ``v//vn`` or
    ``v/vt/vn``, and relative (negative) indices. Colours after the positions become the attribute ``color``.

    Raises:
        FormatError: with the line, at the first thing that is not OBJ, is not finite, or has an impossible index.
    """
    reader = _Reader()
    text = TextBlocks(source)
    said: dict[bytes, int] = {}
    for block, first_line in text:
        if first_line == 1:
            said = {name.lower(): int(number) for name, number in _SAID_COUNT.findall(block[:4096])}
        reader.read_block(block, first_line)
    return reader.polygon_mesh(said, text.unclosed_line)


def _vertex_index(token: bytes, n_before: int, line: int) -> int:
    """Return the index, counted from 0, of a face corner ``v``, ``v/vt``, ``v//vn`` or ``v/vt/vn``."""
    match = _CORNER.fullmatch(token)
    if match is None:
        raise FormatError(f"line {line}: '{show(token)}' is not a corner of a face", f"Correct the line. {_RESAVE}")
    index = parse_integer(match[1], line, "the index of a vertex")
    if index == 0:
        raise FormatError(f"line {line}: a face refers to vertex 0, but OBJ counts vertices from 1", _RESAVE)
    if index < -n_before:
        raise FormatError(
            f"line {line}: a face refers to the vertex {-index:,} before it, but there are only {n_before:,}", _RESAVE
        )
    return index - 1 if index > 0 else n_before + index


def _select(text: NDArray[np.uint8], starts: IntArray, ends: IntArray, chosen: BoolArray) -> NDArray[np.uint8]:
    """Return the chosen lines without their keyword of one character."""
    lengths = ends - starts + 1
    rows = text[np.repeat(chosen, lengths)]
    chosen_lengths = lengths[chosen]
    rows[np.cumsum(chosen_lengths) - chosen_lengths] = ord(" ")
    return rows


def _statements(block: bytes, first_line: int) -> Iterator[tuple[int, bytes]]:
    """Yield statements, continued lines joined, with the number of their first line."""
    parts: list[bytes] = []
    begin = first_line
    for line, content in enumerate(block.split(b"\n")[:-1], first_line):
        if not parts:
            begin = line
        if content.endswith(b"\\"):
            parts.append(content[:-1])
            continue
        yield begin, b" ".join([*parts, content]) if parts else content
        parts = []
    if parts:
        yield begin, b" ".join(parts)
