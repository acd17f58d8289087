"""Tables of measured numbers: Markdown for people, CSV for programs."""

from __future__ import annotations

import csv
import io
import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from dmp.experiments.store import JobRecord


@dataclass(frozen=True)
class Cell:
    """The numbers measured for one place of a table, one for each seed.

    Attributes:
        values: the numbers; none when nothing was measured.
        digits: after the decimal point, for people.
        reason: why there are none.
        unit: written behind the number, for people.
    """

    values: tuple[float, ...] = ()
    digits: int = 2
    reason: str = ""
    unit: str = ""

    @property
    def mean(self) -> float | None:
        """The mean, or None without numbers."""
        return statistics.fmean(self.values) if self.values else None

    @property
    def deviation(self) -> float | None:
        """The sample standard deviation (n - 1), or None for fewer than two numbers."""
        return statistics.stdev(self.values) if len(self.values) > 1 else None

    @property
    def text(self) -> str:
        """The mean, and with several seeds ``± deviation``; a dash without numbers."""
        if self.mean is None:
            return "–"
        spread = f" ± {self.deviation:.{self.digits}f}" if self.deviation is not None else ""
        return f"{self.mean:.{self.digits}f}{spread}{self.unit}"


@dataclass(frozen=True)
class Row:
    """A line of a table: what it is about, in words, and what was measured."""

    heads: tuple[str, ...]
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        title: above it.
        heads: names of the columns with words.
        columns: names of the columns with numbers.
        rows: its lines.
        bold: whether the lowest mean of each column is printed in bold.
        note: a paragraph below it.
    """

    title: str
    heads: tuple[str, ...]
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    bold: bool = False
    note: str = ""

    @property
    def markdown(self) -> str:
        """The table as Markdown, with the reasons for empty cells below it."""
        lowest = [self._lowest(column) if self.bold else None for column in range(len(self.columns))]
        lines = [
            "| " + " | ".join([*self.heads, *self.columns]) + " |",
            "|" + " --- |" * len(self.heads) + " ---: |" * len(self.columns),
        ]
        reasons: dict[str, dict[str, None]] = {}
        for row in self.rows:
            texts = []
            for cell, least in zip(row.cells, lowest, strict=True):
                is_lowest = least is not None and cell.mean is not None and cell.mean <= least
                texts.append(f"**{cell.text}**" if is_lowest else cell.text)
                if not cell.values and cell.reason:
                    reasons.setdefault(cell.reason, {})[", ".join(head for head in row.heads if head)] = None
            lines.append("| " + " | ".join([*map(_escaped, row.heads), *texts]) + " |")
        text = f"**{self.title}**\n\n" + "\n".join(lines) + "\n"
        if reasons:
            told = (f"{'; '.join(where)}: {reason}" for reason, where in reasons.items())
            text += "\nEmpty cells: " + " ".join(told) + "\n"
        return text + (f"\n{self.note}\n" if self.note else "")

    def _lowest(self, column: int) -> float | None:
        means = [mean for row in self.rows if (mean := row.cells[column].mean) is not None]
        return min(means) if len(means) > 1 else None

    @property
    def csv(self) -> str:
        """One line for each cell: the words of its row, the measure, mean, deviation, n, the numbers, or why there are none."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([*self.heads, "measure", "mean", "deviation", "n", "values", "reason"])
        for row in self.rows:
            for name, cell in zip(self.columns, row.cells, strict=True):
                numbers = ["" if number is None else repr(number) for number in (cell.mean, cell.deviation)]
                values = " ".join(map(repr, cell.values))
                writer.writerow([*row.heads, name, *numbers, len(cell.values), values, cell.reason])
        return text.getvalue()


def _escaped(text: str) -> str:
    return text.replace("|", "\\|")


def cell(
    records: Iterable[JobRecord | None], value: Callable[[JobRecord], float | None], digits: int = 2, unit: str = ""
) -> Cell:
    """Return what a function finds in the records of one row, one for each seed.

    Args:
        records: of the jobs; None for one that is not done.
        value: takes a record and returns the number, or None where it has none.
        digits: after the decimal point.
        unit: written behind the number.
    """
    values, reason = [], ""
    for record in records:
        if record is None:
            reason = "not done yet."
        elif record.failure:
            reason = record.failure
        elif (found := value(record)) is not None and math.isfinite(found):
            values.append(float(found))
    return Cell(tuple(values), digits, "" if values else reason, unit)


def measure(records: Sequence[JobRecord | None], choice: str, name: str, digits: int = 2, factor: float = 1.0) -> Cell:
    """Return one measure of one of the results of each record, times ``factor``."""

    def value(record: JobRecord) -> float | None:
        chosen = record.results.get(choice)
        found = None if chosen is None else chosen.measures.get(name)
        return None if found is None else found * factor

    return cell(records, value, digits)
