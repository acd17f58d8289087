"""The folder of an experiment: a record for each job that is done, run folders of trainings, tables and pictures."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from dmp.errors import RunError
from dmp.experiments.jobs import Job
from dmp.files import atomic_write_bytes, in_words

_FORMAT = 1
# With the truth: the step or the parameters that come closest to it. Without: what a person without a truth gets.
Choice = Literal["with_truth", "without_truth", "last"]


@dataclass(frozen=True)
class Chosen:
    """One result of a job.

    Attributes:
        what: which step or parameters it stands for, in words.
        measures: its distances from the ground truth by name, as :meth:`dmp.metrics.GroundTruth.full_measures` gives them.
        step: the step of a training.
        parameters: those of a filter.
    """

    what: str
    measures: Mapping[str, float]
    step: int | None = None
    parameters: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class JobRecord:
    """What is kept of a job.

    Attributes:
        results: by how they were chosen.
        curve: columns of the training's curve by name; None where nothing was measured at a step.
        seconds: how long it took; of a training the time in its steps.
        facts: device, threads, program version and date.
        failure: why there is no result, in a sentence; empty when there is one.
    """

    results: Mapping[str, Chosen] = field(default_factory=dict)
    curve: Mapping[str, list[float | None]] = field(default_factory=dict)
    seconds: float = 0.0
    facts: Mapping[str, Any] = field(default_factory=dict)
    failure: str = ""


class Store:
    """Keeps the results of jobs under one folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def shapes_folder(self) -> Path:
        """Where meshes are kept that were made by formulas."""
        return self.folder / "shapes"

    def run_folder(self, job: Job) -> Path:
        """Where the training of a job is kept; `dmp-viewer` opens it."""
        return self.folder / "runs" / job.name

    def read(self, job: Job) -> JobRecord | None:
        """Return the record of a job; None when it was never done, or what was written is not readable any more."""
        try:
            content = json.loads((self.folder / "records" / f"{job.name}.json").read_bytes())
            if content["format"] != _FORMAT:
                return None
            values = content["record"]
            results = {name: Chosen(**chosen) for name, chosen in values.pop("results").items()}
            return JobRecord(results=results, **values)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None

    def is_done(self, job: Job) -> bool:
        """Tell whether there is a result; what failed is tried again."""
        record = self.read(job)
        return record is not None and not record.failure

    def write(self, job: Job, record: JobRecord) -> None:
        """Keep the record of a job.

        Raises:
            RunError: when it cannot be written.
        """
        content = {"format": _FORMAT, "job": job.description(), "record": asdict(record)}
        path = self.folder / "records" / f"{job.name}.json"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            atomic_write_bytes(path, json.dumps(content, indent=1, allow_nan=False).encode())
        except OSError as error:
            raise RunError(f"{path} cannot be written: {in_words(error)}. Name another folder with --out.") from error


def as_columns(rows: list[dict[str, float]]) -> dict[str, list[float | None]]:
    """Return the rows of a curve as columns by name; what is missing in a row, or not a number, becomes None."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {
        name: [value if (value := row.get(name)) is not None and math.isfinite(value) else None for row in rows]
        for name in names
    }
