"""A table of a PLY file, and reading all of them from a text file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dmp.formats.ply_header import Element, Header
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.text import UNCLOSED_NOTE, NumberTable, NumberTableBuilder, TextBlocks
from dmp.mesh import IntArray

_RESAVE = "Save or copy the file again from where it came from."


@dataclass
class Table:
    """The rows of one element.

    Attributes:
        numbers: the values of each property that is a number, (count,), in its declared type; float64 in a text file.
        lists: for each property that is a list, its values one row after the other, and how many each row has, (count,).
        place: tells where in the file a row stands, such as "line 12" or "byte 3,456".
        start: at which byte after the header a row begins; in a binary file only.
    """

    place: Callable[[int], str]
    start: Callable[[int], int] | None = None
    numbers: dict[str, NDArray] = field(default_factory=dict)
    lists: dict[str, tuple[NDArray, IntArray]] = field(default_factory=dict)


def read_text_tables(source: SourceFile, header: Header, notes: list[str]) -> dict[str, Table]:
    """Read all tables of a text file, each row of which is one line.

    Args:
        source: the file.
        header: its header.
        notes: receives a sentence when the last line is not closed.

    Raises:
        FormatError: with the line, when the rows and values are not as many as declared, or not numbers.
    """
    builder = NumberTableBuilder()
    text = TextBlocks(source)
    for block, first_line in text:
        skipped = header.n_lines + 1 - first_line
        if skipped <= 0:
            builder.add(block, first_line)
        elif skipped < block.count(b"\n"):
            start = int(np.flatnonzero(np.frombuffer(block, dtype=np.uint8) == 10)[skipped - 1]) + 1
            builder.add(block[start:], header.n_lines + 1)
    rows = builder.table()
    tables: dict[str, Table] = {}
    first = 0
    for element in header.elements:
        if not element.properties:
            continue
        if element.count > len(rows) - first:
            raise FormatError(
                f"the header declares {element.count:,} rows of '{element.name}', but the file has {len(rows) - first:,}",
                f"It was cut off, or the count is wrong. {_RESAVE}",
            )
        tables[element.name] = _text_table(element, rows, first)
        first += element.count
    if first < len(rows):
        raise FormatError(f"line {int(rows.lines[first])}: the file goes on after the rows that its header declares", _RESAVE)
    if text.unclosed_line:
        notes.append(UNCLOSED_NOTE)
    return tables


def _text_table(element: Element, rows: NumberTable, first: int) -> Table:
    chosen = slice(first, first + element.count)
    starts, lines = rows.starts[chosen], rows.lines[chosen]
    ends = starts + rows.counts[chosen]
    table = Table(place=lambda row: f"line {int(lines[row])}")
    position = starts.copy()
    for item in element.properties:
        _check_rows(position < ends, lines, "has fewer values than its header declares")
        values = rows.values[position]
        position += 1
        if item.count_type is None:
            table.numbers[item.name] = values
            continue
        # NaN fails both comparisons, so nothing strange is converted below.
        _check_rows((values >= 0) & (values <= ends - position), lines, "has a list whose length does not fit to the line")
        counts = values.astype(np.int64)
        _check_rows(counts == values, lines, "has a list whose length is not a whole number")
        table.lists[item.name] = rows.values[_ranges(position, counts)], counts
        position += counts
    _check_rows(position == ends, lines, "has more values than its header declares")
    return table


def _check_rows(good: NDArray[np.bool_], lines: IntArray, what: str) -> None:
    if not good.all():
        raise FormatError(f"line {int(lines[int(good.argmin())])} {what}", f"Correct the line. {_RESAVE}")


def _ranges(starts: IntArray, counts: IntArray) -> IntArray:
    """Return for each i the ``counts[i]`` whole numbers from ``starts[i]`` on, one after the other."""
    ends = np.cumsum(counts)
    return np.repeat(starts - (ends - counts), counts) + np.arange(int(ends[-1]) if len(ends) else 0)
