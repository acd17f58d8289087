"""Text STL: facets of three corners between ``solid`` and ``endsolid``.

Facets that are laid out as programs lay them out are read with NumPy; anything else is read word by word, which finds
the line to tell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dmp.formats.assemble import PolygonMesh
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.stl import weld
from dmp.formats.text import NEWLINE, TextBlocks, parse_all, parse_number, show, token_counts
from dmp.mesh import FloatArray, IntArray

_RESAVE = "Save or copy the file again from where it came from."
# The words of a facet; None stands for a number.
_PATTERN: tuple[bytes | None, ...] = (
    *(b"facet", b"normal", None, None, None, b"outer", b"loop"),
    *(b"vertex", None, None, None) * 3,
    *(b"endloop", b"endfacet"),
)
_WORDS = [(position, word) for position, word in enumerate(_PATTERN) if word is not None]
_FIRST_CORNER, _LAST_CORNER = 7, 18
_WORDS_OF_LINES = (5, 2, 4, 4, 4, 1, 1)


def read_text_stl(source: SourceFile) -> PolygonMesh:
    """Read a text STL file with one or several solids, in any text encoding and in small or capital letters.

    Raises:
        FormatError: with the line, when something is out of place, a coordinate is not a finite number, or the file
            was cut off.
    """
    reader = _Reader()
    for block, first_line in TextBlocks(source):
        reader.read_block(block, first_line)
    return reader.polygon_mesh()


class _Reader:
    """All facets read so far, and the place within the facet that is being read."""

    def __init__(self) -> None:
        self.points: list[FloatArray] = []
        self.lines: list[IntArray] = []
        self.in_solid = False
        self.position = 0
        self.line = 0
        self.corner_values: list[float] = []
        self.facet_lines: list[int] = []

    def read_block(self, block: bytes, first_line: int) -> None:
        """Read whole lines.

        Raises:
            FormatError: with the line of what is not STL.
        """
        start = 0
        line = first_line
        tried = False
        while start < len(block):
            if self.in_solid and not self.position and not tried:
                consumed = self._read_regular(block[start:], line)
                line += block.count(b"\n", start, start + consumed)
                self.line = line - 1
                start += consumed
                tried = True
                if start == len(block):
                    break
            end = block.index(b"\n", start)
            self._read_line(block[start:end], line)
            start = end + 1
            line += 1
        self._keep_facets()

    def _read_regular(self, block: bytes, first_line: int) -> int:
        """Read as many facets of seven lines as stand at the beginning of a block; return how many bytes they take."""
        text = np.frombuffer(block.lower(), dtype=np.uint8).copy()
        counts = token_counts(text)
        n = len(counts) // len(_WORDS_OF_LINES)
        n = _first_false((counts[: 7 * n].reshape(n, 7) == _WORDS_OF_LINES).all(axis=1))
        is_token = text > 32
        is_token[1:] &= text[:-1] <= 32
        starts = np.flatnonzero(is_token)[: n * len(_PATTERN)].reshape(n, len(_PATTERN))
        for position, word in _WORDS:
            # The last token of a text that was cut off is shorter than the word.
            letters = text[np.minimum(starts[:n, position, None] + np.arange(len(word) + 1), len(text) - 1)]
            n = _first_false((letters[:, :-1] == np.frombuffer(word, dtype=np.uint8)).all(axis=1) & (letters[:, -1] <= 32))
        if not n:
            return 0
        for position, word in _WORDS:
            text[starts[:n, position, None] + np.arange(len(word))] = ord(" ")
        end = int(np.flatnonzero(text == NEWLINE)[7 * n - 1]) + 1
        values = parse_all(text[:end].tobytes(), 12 * n, np.float64)
        if values is None:
            return 0
        corners = values.reshape(n, 12)[:, 3:]
        if not np.isfinite(corners).all():
            return 0
        self._keep_facets()
        self.points.append(corners.reshape(n, 3, 3))
        self.lines.append(first_line + 7 * np.arange(n))
        return end

    def _read_line(self, content: bytes, line: int) -> None:
        self.line = line
        for token in content.split():
            if not self.position:
                word = token.lower()
                if word in (b"solid", b"endsolid"):
                    if self.in_solid == (word == b"solid"):
                        raise FormatError(
                            f"line {line}: '{show(token)}' is out of place, so a part of the file is missing", _RESAVE
                        )
                    self.in_solid = not self.in_solid
                    return  # a name may follow
                if word == b"facet" and not self.in_solid:
                    raise FormatError(f"line {line}: a triangle stands outside of any solid", _RESAVE)
            self._read_token(token, line)

    def _read_token(self, token: bytes, line: int) -> None:
        expected = _PATTERN[self.position]
        if expected is None:
            if self.position >= _FIRST_CORNER:  # normals are not used and often not numbers
                self.corner_values.append(parse_number(token, line))
        elif token.lower() != expected:
            if expected == b"endloop" and token.lower() == b"vertex":
                raise FormatError(f"line {line}: a facet has more than three corners, which STL does not allow", _RESAVE)
            raise FormatError(f"line {line}: '{show(token)}' stands where '{expected.decode()}' is expected", _RESAVE)
        elif not self.position:
            self.facet_lines.append(line)
        self.position = (self.position + 1) % len(_PATTERN)

    def _keep_facets(self) -> None:
        """Move the complete facets that were read word by word to the others."""
        n = len(self.facet_lines) - (self.position > 0)
        if n:
            self.points.append(np.array(self.corner_values[: 9 * n]).reshape(n, 3, 3))
            self.lines.append(np.array(self.facet_lines[:n], dtype=np.int64))
            del self.corner_values[: 9 * n], self.facet_lines[:n]

    def polygon_mesh(self) -> PolygonMesh:
        """Return everything read.

        Raises:
            FormatError: when the file ended too early or held no triangles.
        """
        if self.position or self.in_solid:
            where = "inside a triangle" if self.position else "without 'endsolid'"
            raise FormatError(f"the file ends {where} after line {self.line}, so it was cut off", _RESAVE)
        if not self.points:
            raise FormatError("the file holds no triangles", _RESAVE)
        lines = np.concatenate(self.lines)
        return weld(np.concatenate(self.points), lambda facet: f"line {int(lines[facet])}", [])


def _first_false(values: NDArray[np.bool_]) -> int:
    """Return how many values are true before the first that is not."""
    return len(values) if values.all() else int(values.argmin())
