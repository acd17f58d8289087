"""Text files as blocks of whole lines in one encoding, and the strict parsing of numbers in them."""

from __future__ import annotations

import codecs
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dmp.formats.source import FormatError, SourceFile
from dmp.mesh import FloatArray, IntArray

NEWLINE = 10
_BLOCK_BYTES = 1 << 22
_NUMBER = re.compile(rb"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?")
_INTEGER = re.compile(rb"[+-]?\d+")
_DECIMAL_COMMA = re.compile(rb"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_NOT_FINITE = re.compile(rb"[+-]?(?:nan|inf|infinity|1\.#).*", re.IGNORECASE | re.DOTALL)
# UTF-32 first: its little-endian mark begins with that of UTF-16.
_BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_RESAVE = "Save or copy it again from where it came from."
UNCLOSED_NOTE = "The file does not end with a line break; if it was cut off, its last line is incomplete."


def _faults_are_warnings() -> bool:
    """Tell whether this release of NumPy only warns of texts that are no numbers, and returns those before."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            np.fromstring("1 x", sep=" ")
        except ValueError:
            return False
    return True


_FAULTS_ARE_WARNINGS = _faults_are_warnings()
# A token that is no number as a whole.
_STRANGE_NUMBER = re.compile(
    rb"(?<![^\s])(?![+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?(?:\s|$)|[+-]?(?i:nan|inf|infinity)(?:\s|$))\S+"
)


def encoding_of(head: bytes) -> str:
    """Return ``"utf-16"`` or ``"utf-32"`` when the bytes begin with such a mark, else ``"utf-8"``."""
    for mark, name in _BYTE_ORDER_MARKS:
        if head.startswith(mark):
            return name
    return "utf-8"


def transcode(head: bytes) -> bytes:
    """Return the beginning of a text file in UTF-8, without a byte order mark; bytes without meaning are replaced."""
    encoding = encoding_of(head)
    if encoding != "utf-8":
        head = codecs.getincrementaldecoder(encoding)(errors="replace").decode(head).encode()
    return head.removeprefix(codecs.BOM_UTF8)


def show(token: bytes) -> str:
    """Return a token of a file for a message: at most 40 characters, without control characters."""
    text = token[:200].decode("utf-8", errors="replace")
    text = "".join(character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text)
    return text if len(text) <= 40 else text[:39] + "…"


@dataclass
class TextBlocks:
    """The lines of a text file as UTF-8 with LF line ends, whatever its encoding and line ends are.

    Attributes:
        source: the file; it is read from its beginning.
        unclosed_line: the last line, if no line end follows it; known once all blocks were taken.
    """

    source: SourceFile
    unclosed_line: bytes = b""

    def __iter__(self) -> Iterator[tuple[bytes, int]]:
        """Yield blocks of whole lines, each line closed by LF, with the number of their first line, counted from 1.

        A line that ends in a backslash is never parted from its successor.

        Raises:
            FormatError: at a NUL byte.
        """
        first_line = 1
        pending: list[bytes] = []
        for piece in self._pieces():
            cut = piece.rfind(b"\n") + 1
            while cut > 1 and piece[cut - 2] == ord("\\"):
                cut = piece.rfind(b"\n", 0, cut - 1) + 1
            # A backslash may also be the last byte of what is pending, with its line end at the start of this piece.
            if cut == 0 or (cut == 1 and pending and pending[-1].endswith(b"\\")):
                pending.append(piece)
                continue
            block = b"".join([*pending, piece[:cut]])
            pending = [piece[cut:]] if cut < len(piece) else []
            yield block, first_line
            first_line += block.count(b"\n")
        rest = b"".join(pending)
        if rest and not rest.endswith(b"\n"):
            self.unclosed_line = rest[rest.rfind(b"\n") + 1 :]
            rest += b"\n"
        if rest:
            yield rest, first_line

    def _pieces(self) -> Iterator[bytes]:
        """Yield the text in pieces of any extent, without carriage returns and NUL bytes."""
        encoding = encoding_of(self.source.head)
        decoder = None if encoding == "utf-8" else codecs.getincrementaldecoder(encoding)(errors="replace")
        self.source.seek(0)
        position, held_back = 0, b""
        while raw := self.source.read_up_to(_BLOCK_BYTES):
            text = raw if decoder is None else decoder.decode(raw).encode()
            if position == 0:
                text = text.removeprefix(codecs.BOM_UTF8)
            if b"\0" in text:
                offset = "" if decoder is not None else f" at byte {position + raw.index(0):,}"
                raise FormatError(f"the text has a zero byte{offset}, so the file is damaged or is no text", _RESAVE)
            position += len(raw)
            text, held_back = held_back + text, b""
            if text.endswith(b"\r"):  # its LF may come with the next piece
                text, held_back = text[:-1], b"\r"
            if b"\r" in text:
                text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
            if text:
                yield text
        rest = held_back + (decoder.decode(b"", final=True).encode() if decoder is not None else b"")
        if rest:
            yield rest.replace(b"\r", b"\n")


def token_counts(text: NDArray[np.uint8]) -> IntArray:
    """Return the number of tokens in each line of ``text``, whose last byte must be LF."""
    is_token = text > 32
    starts = is_token.copy()
    starts[1:] &= ~is_token[:-1]
    positions = np.flatnonzero(starts)
    return np.diff(np.searchsorted(positions, np.flatnonzero(text == NEWLINE)), prepend=0)


def parse_all(text: bytes, expected: int, dtype: type) -> NDArray | None:
    """Parse white-space separated numbers, or return None unless there are exactly ``expected`` and all are numbers.

    Words such as ``nan`` and ``inf`` are numbers here; numbers too large become infinite, integers the largest there is.
    """
    if expected == 0:
        return None if text.strip() else np.zeros(0, dtype=dtype)
    try:
        values: NDArray = np.fromstring(text, dtype=dtype, sep=" ")
    except (ValueError, DeprecationWarning):
        return None
    if _FAULTS_ARE_WARNINGS and _STRANGE_NUMBER.search(text):
        return None
    return values if len(values) == expected else None


def parse_number(token: bytes, line: int) -> float:
    """Return a token as a finite number.

    Raises:
        FormatError: when it is anything else than digits with an optional sign, period and exponent, or too large.
    """
    if not _NUMBER.fullmatch(token):
        raise not_a_number(token, line)
    value = float(token)
    if value - value != 0.0:
        raise FormatError(f"line {line}: the number '{show(token)}' is too large", "Scale the mesh before saving it.")
    return value


def parse_integer(token: bytes, line: int, what: str) -> int:
    """Return a token as a whole number of at most 18 digits; ``what`` says in a message what it should be.

    Raises:
        FormatError: when it is not.
    """
    if not _INTEGER.fullmatch(token):
        raise FormatError(f"line {line}: '{show(token)}' is not {what}", f"Correct the line. {_RESAVE}")
    if len(token) > 18:
        raise FormatError(f"line {line}: the number '{show(token)}' is too large for {what}", f"Correct the line. {_RESAVE}")
    return int(token)


def not_a_number(token: bytes, line: int) -> FormatError:
    """Return the error that tells why ``token`` is not a finite number."""
    shown = show(token)
    if _DECIMAL_COMMA.fullmatch(token):
        return FormatError(f"line {line}: the number '{shown}' has a decimal comma", "Save the mesh with decimal points.")
    if _NOT_FINITE.fullmatch(token):
        return FormatError(
            f"line {line}: '{shown}' is not a finite number", "Remove the vertex and its faces, or save the mesh again."
        )
    return FormatError(f"line {line}: '{shown}' is not a number", f"Correct the line. {_RESAVE}")


@dataclass(frozen=True, eq=False)
class NumberTable:
    """All numbers of a text, line by line; lines without numbers are left out.

    Attributes:
        values: the numbers of all lines one after the other, (K,) float64; may hold NaN and infinity.
        starts: where each line starts in ``values``, (L,) int64.
        counts: how many numbers each line has, (L,) int64, above 0.
        lines: the number of each line in the file, (L,) int64.
    """

    values: FloatArray
    starts: IntArray
    counts: IntArray
    lines: IntArray

    def __len__(self) -> int:
        return len(self.counts)


class NumberTableBuilder:
    """Collects blocks of lines that hold numbers and nothing else."""

    def __init__(self) -> None:
        self._values: list[FloatArray] = []
        self._counts: list[IntArray] = []
        self._lines: list[IntArray] = []

    def add(self, block: bytes, first_line: int) -> None:
        """Add whole lines, each closed by LF, the first of which has the number ``first_line`` in the file.

        Raises:
            FormatError: with the line, when something is not a number.
        """
        if not block:
            return
        counts = token_counts(np.frombuffer(block, dtype=np.uint8))
        values = parse_all(block, int(counts.sum()), np.float64)
        if values is None:
            raise _first_fault(block, first_line)
        filled = np.flatnonzero(counts)
        self._values.append(values)
        self._counts.append(counts[filled])
        self._lines.append(filled + first_line)

    def table(self) -> NumberTable:
        """Return everything added so far."""
        counts = np.concatenate([np.zeros(0, dtype=np.int64), *self._counts])
        return NumberTable(
            values=np.concatenate([np.zeros(0), *self._values]),
            starts=np.cumsum(counts) - counts,
            counts=counts,
            lines=np.concatenate([np.zeros(0, dtype=np.int64), *self._lines]),
        )


def _first_fault(block: bytes, first_line: int) -> FormatError:
    for line, content in enumerate(block.split(b"\n"), first_line):
        for token in content.split():
            if not _NUMBER.fullmatch(token) and not re.fullmatch(rb"[+-]?(nan|inf|infinity)", token, re.IGNORECASE):
                return not_a_number(token, line)
    return FormatError(f"there is something that is not a number at line {first_line} or later", _RESAVE)
