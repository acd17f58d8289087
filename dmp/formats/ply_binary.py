"""Reading the tables of a binary PLY file."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dmp.formats.assemble import counted
from dmp.formats.ply_header import INDEX_LISTS, Element, Header, Property
from dmp.formats.ply_tables import Table
from dmp.formats.source import FormatError, SourceFile
from dmp.mesh import IntArray

_RESAVE = "Save or copy the file again from where it came from."
_GATHERED_BYTES = 1 << 24
_FEW_ROWS = 100_000


def read_binary_tables(source: SourceFile, header: Header, notes: list[str]) -> dict[str, Table]:
    """Read all tables of a binary file.

    Args:
        source: the file.
        header: its header.
        notes: receives a sentence when a few bytes follow the last table.

    Raises:
        FormatError: with the byte, when the file holds fewer or more rows than declared, or was not written to its end.
    """
    n_bytes = source.size - header.n_bytes
    needed = sum(element.count * element.smallest_row for element in header.elements)
    if needed > n_bytes:
        rows = ", ".join(f"{element.count:,} rows of '{element.name}'" for element in header.elements)
        raise FormatError(
            f"the header declares {rows}, which take at least {needed:,} bytes, but only {max(n_bytes, 0):,} follow",
            f"The file was cut off, or a count is wrong. {_RESAVE}",
        )
    source.seek(header.n_bytes)
    body = source.read_exactly(n_bytes)
    tables: dict[str, Table] = {}
    position = 0
    for element in header.elements:
        if not element.properties or not element.count:
            tables[element.name] = Table(place=str)
            continue
        tables[element.name], position = _BinaryElement(element, header, body).read(position)
        last = element
    if position:
        _check_tail(last, tables[last.name], body[:position], header.n_bytes)
    _check_surplus(header, body, position, notes)
    return tables


def _check_tail(element: Element, table: Table, body: bytearray, offset: int) -> None:
    """Refuse a last table whose end was never written: a face without corners, or two vertices with nothing but zeros."""
    n_rows = {"face": 1, "tristrips": 1, "vertex": 2}.get(element.name, 0)
    if table.start is None or not 0 < n_rows <= element.count or any(body[table.start(element.count - n_rows) :]):
        return
    raise FormatError(
        f"from byte {offset + len(body.rstrip(bytes(1))):,} on the file holds only zeros: it was never written completely",
        _RESAVE,
    )


def _check_surplus(header: Header, body: bytearray, end: int, notes: list[str]) -> None:
    surplus = len(body) - end
    if not surplus:
        return
    smallest = min((element.smallest_row for element in header.elements if element.properties), default=1)
    if surplus >= smallest and body[end:].strip(b"\0 \t\r\n\x1a"):
        raise FormatError(
            f"byte {header.n_bytes + end:,}: {surplus:,} bytes follow after the rows that the header declares",
            f"A count is wrong, or the file is damaged. {_RESAVE}",
        )
    notes.append(f"Ignored {counted(surplus, 'byte')} after the end of the mesh.")


class _BinaryElement:
    """Reads the rows of one element from the bytes after the header."""

    def __init__(self, element: Element, header: Header, body: bytearray) -> None:
        self.element = element
        self.order = header.byte_order
        self.offset = header.n_bytes
        self.body = body

    def read(self, start: int) -> tuple[Table, int]:
        """Return the table and where the next one begins.

        Raises:
            FormatError: with the byte, when a list goes beyond the end of the file or has a negative length.
        """
        return self._read_uniform(start) or self._read_ragged(start)

    def _type(self, code: str) -> np.dtype:
        return np.dtype(self.order + code)

    def _table(self, start: Callable[[int], int]) -> Table:
        return Table(place=lambda row: f"byte {self.offset + start(row):,}", start=start)

    def _read_uniform(self, start: int) -> tuple[Table, int] | None:
        """Read rows that all have the same length, as the lists of most meshes do; None when they differ."""
        fields: list[tuple] = []
        lengths: dict[str, int] = {}
        position = start
        for index, item in enumerate(self.element.properties):
            if item.count_type is None:
                fields.append((f"value{index}", self._type(item.value_type)))
                position += fields[-1][1].itemsize
                continue
            count_type = self._type(item.count_type)
            if position + count_type.itemsize > len(self.body):
                return None
            n = int(np.frombuffer(self.body, count_type, 1, position)[0])
            position += count_type.itemsize + n * np.dtype(item.value_type).itemsize
            if n < 0 or position > len(self.body):
                return None
            lengths[item.name] = n
            fields += [(f"count{index}", count_type), (f"value{index}", self._type(item.value_type), (n,))]
        row_bytes = position - start
        end = start + self.element.count * row_bytes
        if end > len(self.body):
            return None
        rows = np.frombuffer(self.body, np.dtype(fields), self.element.count, start)
        table = self._table(lambda row: start + row * row_bytes)
        for index, item in enumerate(self.element.properties):
            values = rows[f"value{index}"]
            if item.count_type is None:
                table.numbers[item.name] = values
                continue
            if (rows[f"count{index}"] != lengths[item.name]).any():
                return None
            table.lists[item.name] = values.ravel(), np.full(self.element.count, lengths[item.name], dtype=np.int64)
        return table, end

    def _read_ragged(self, start: int) -> tuple[Table, int]:
        """Read rows of different lengths."""
        # Between lists lie runs of numbers whose places follow from the place of the run.
        runs: list[list[tuple[str, np.dtype, int]]] = [[]]
        lists: list[Property] = []
        run_bytes = [0]
        for item in self.element.properties:
            value_type = self._type(item.value_type)
            if item.count_type is None:
                runs[-1].append((item.name, value_type, run_bytes[-1]))
                run_bytes[-1] += value_type.itemsize
            else:
                lists.append(item)
                runs.append([])
                run_bytes.append(0)
        self._check_room(start)
        places, counts, end = self._walk(start, lists, run_bytes)
        row_starts = places[0]
        table = self._table(lambda row: int(row_starts[row]))
        for run, starts in zip(runs, places, strict=True):
            for name, value_type, shift in run:
                table.numbers[name] = self._gather(starts + shift, np.ones(len(starts), dtype=np.int64), value_type)
        for index, item in enumerate(lists):
            value_type = self._type(item.value_type)
            starts = places[index + 1] - counts[index] * value_type.itemsize
            table.lists[item.name] = self._gather(starts, counts[index], value_type), counts[index]
        return table, end

    def _check_room(self, start: int) -> None:
        """Refuse faces, more than half of which cannot have three corners, before each of them is looked at.

        Otherwise a file of megabytes, all bytes of which are empty faces, would take a gigabyte.

        Raises:
            FormatError: when the bytes from ``start`` on are too few.
        """
        index = self.element.find(*INDEX_LISTS)
        is_small = self.element.count <= _FEW_ROWS  # looking at each of them finds the one that is damaged
        if is_small or self.element.name != "face" or index is None or index.count_type is None:
            return
        needed = self.element.count * self.element.smallest_row
        needed += 3 * np.dtype(index.value_type).itemsize * (self.element.count // 2)
        if needed > len(self.body) - start:
            raise FormatError(
                f"byte {self.offset + start:,}: {self.element.count:,} faces are declared, but most of them cannot have three "
                f"corners in the {len(self.body) - start:,} bytes that follow",
                f"The file was cut off, or a count is wrong. {_RESAVE}",
            )

    def _walk(self, start: int, lists: list[Property], run_bytes: list[int]) -> tuple[list[IntArray], list[IntArray], int]:
        """Go from row to row; return where each run begins, how long each list is, and the end of the last row."""
        body, n_bytes = self.body, len(self.body)
        steps = []
        for item, before in zip(lists, run_bytes, strict=False):
            assert item.count_type is not None
            reader = struct.Struct(self.order + {"i8": "q", "u8": "Q"}.get(item.count_type, np.dtype(item.count_type).char))
            steps.append((before, reader.unpack_from, reader.size, np.dtype(item.value_type).itemsize, array("q"), array("q")))
        row_starts = array("q")
        after = run_bytes[-1]
        position = start
        for row in range(self.element.count):
            row_starts.append(position)
            for before, unpack, count_bytes, value_bytes, lengths, run_starts in steps:
                position += before
                if position + count_bytes > n_bytes:
                    raise self._cut_off(row)
                n = unpack(body, position)[0]
                position += count_bytes + n * value_bytes
                if n < 0 or position > n_bytes:
                    raise self._bad_length(row, n, position - count_bytes - n * value_bytes)
                lengths.append(n)
                run_starts.append(position)
            position += after
        if position > n_bytes:
            raise self._cut_off(self.element.count - 1)
        as_integers = [np.frombuffer(places, dtype=np.int64) for places in (row_starts, *(step[5] for step in steps))]
        return as_integers, [np.frombuffer(step[4], dtype=np.int64) for step in steps], position

    def _cut_off(self, row: int) -> FormatError:
        return FormatError(
            f"byte {self.offset + len(self.body):,}: the file ends inside row {row:,} of '{self.element.name}'",
            f"It was cut off or is damaged. {_RESAVE}",
        )

    def _bad_length(self, row: int, n: int, position: int) -> FormatError:
        return FormatError(
            f"byte {self.offset + position:,}: row {row:,} of '{self.element.name}' has a list of {n:,} values",
            f"It was cut off or is damaged. {_RESAVE}",
        )

    def _gather(self, places: IntArray, counts: IntArray, value_type: np.dtype) -> NDArray:
        """Return ``counts[i]`` values that begin at byte ``places[i]``, for all i, one after the other."""
        result = np.empty(int(counts.sum()), dtype=value_type)
        targets = np.cumsum(counts) - counts
        order = np.argsort(counts, kind="stable")
        sizes, firsts = np.unique(counts[order], return_index=True)
        data = np.frombuffer(self.body, dtype=np.uint8)
        for size, first, last in zip(sizes.tolist(), firsts.tolist(), [*firsts[1:].tolist(), len(order)], strict=True):
            if size == 0:
                continue
            windows = sliding_window_view(data, size * value_type.itemsize)
            step = max(1, _GATHERED_BYTES // (size * value_type.itemsize))
            for begin in range(first, last, step):
                rows = order[begin : min(begin + step, last)]
                result[targets[rows, None] + np.arange(size)] = windows[places[rows]].view(value_type)
        return result
