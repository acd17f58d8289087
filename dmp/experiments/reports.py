"""What an experiment tells: text, tables, charts and pictures in one folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dmp.errors import DmpError
from dmp.experiments.jobs import Job
from dmp.experiments.pictures import CANNOT_DRAW, Shown, picture_row
from dmp.experiments.plots import Panel, chart, save
from dmp.experiments.store import JobRecord, Store
from dmp.experiments.tables import Table
from dmp.mesh import TriangleMesh

REPORT = "report.md"


@dataclass(frozen=True)
class Results:
    """The records of an experiment's jobs."""

    store: Store

    def of(self, jobs: Sequence[Job]) -> list[JobRecord | None]:
        """Return the records of jobs, None for those that are not done."""
        return [self.store.read(job) for job in jobs]


@dataclass
class Report:
    """What an experiment tells.

    Attributes:
        title: its headline.
        folder: where it is written.
        paragraphs: sentences before the tables.
        tables: by the names of their CSV files.
        published: what the paper printed.
        images: captions by file name.
        remarks: what was left out and why.
    """

    title: str
    folder: Path
    paragraphs: list[str] = field(default_factory=list)
    tables: dict[str, Table] = field(default_factory=dict)
    published: Table | None = None
    images: dict[str, str] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    def add_chart(self, name: str, caption: str, panels: Sequence[Panel], **options: object) -> None:
        """Draw a chart unless none of its lines has two points; ``options`` are those of :func:`chart`."""
        if any(len([y for y in line.y if y is not None]) > 1 for panel in panels for line in panel.lines):
            chart(self.folder / name, panels, **options)  # type: ignore[arg-type]
            self.images[f"{name}.png"] = caption

    def add_pictures(self, name: str, caption: str, shown: Callable[[], Sequence[Shown]], like: TriangleMesh) -> None:
        """Draw a row of pictures, or say in one sentence why there is none."""
        try:
            drawn = picture_row(self.folder / f"{name}.png", shown(), like=like)
        except DmpError as error:
            self.remarks.append(f"The picture {name} was left out: {error}")
            return
        if drawn is not None:
            self.images[f"{name}.png"] = caption
        elif CANNOT_DRAW not in self.remarks:
            self.remarks.append(CANNOT_DRAW)

    def write(self) -> Path:
        """Write everything; return the Markdown file.

        Raises:
            RunError: when something cannot be written.
        """
        for name, table in self.tables.items():
            save(self.folder / f"{name}.csv", table.csv.encode())
        tables = [table.markdown for table in self.tables.values()]
        if self.published is not None:
            tables.append(self.published.markdown)
        images = [f"![{caption}]({name})\n\n*{caption}*\n" for name, caption in self.images.items()]
        parts = [f"# {self.title}\n", *(f"{text}\n" for text in self.paragraphs), *tables, *images]
        parts += [f"{remark}\n" for remark in self.remarks]
        path = self.folder / REPORT
        save(path, "\n".join(parts).encode())
        return path


def mean_curve(records: Sequence[JobRecord | None], name: str) -> tuple[list[float | None], list[float | None]]:
    """Return steps and the mean over seeds of a column of their curves, where all of them have it."""
    columns: list[Mapping[float, float]] = []
    for record in records:
        if record is None or name not in record.curve:
            continue
        pairs = zip(record.curve["step"], record.curve[name], strict=True)
        columns.append({step: value for step, value in pairs if step is not None and value is not None})
    if not columns:
        return [], []
    steps = sorted(set.intersection(*(set(column) for column in columns)))
    return list(steps), [sum(column[step] for column in columns) / len(columns) for step in steps]
