"""The rows that several experiments share: which jobs stand behind them, and what of their records is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dmp.experiments.cases import Case
from dmp.experiments.jobs import Job
from dmp.experiments.plan import Plan
from dmp.experiments.reports import Results
from dmp.experiments.tables import Cell, Row, Table, measure
from dmp.filters import FILTERS

# Column, measure, digits, factor.
_DISTANCES = (
    ("MAD, degrees", "mad", 2, 1.0),
    ("vertex distance, mean", "vertex_error", 3, 1.0),
    ("vertex distance, largest", "vertex_error_max", 2, 1.0),
    ("Hausdorff, result to truth", "surface_distance_max", 2, 1.0),
    ("Hausdorff, truth to result", "surface_distance_back_max", 2, 1.0),
    ("flipped faces, %", "flipped_faces", 2, 100.0),
)
_UNITS = (
    "Distances are in mean edge lengths of the truth, after scale and place were aligned; largest distances are over vertices. "
    "A face is flipped when its normal is more than 90 degrees off."
)


@dataclass(frozen=True)
class Rival:
    """One way to restore a mesh.

    Attributes:
        label: how tables call it.
        with_truth: jobs whose result was chosen with the ground truth, one for each seed.
        without_truth: jobs whose result needs no truth.
    """

    label: str
    with_truth: tuple[Job, ...]
    without_truth: tuple[Job, ...]

    @property
    def jobs(self) -> tuple[Job, ...]:
        """All jobs behind it."""
        return self.with_truth + tuple(job for job in self.without_truth if job not in self.with_truth)


def untouched(case: Case, label: str = "no filter (the input)") -> Rival:
    """The input as it is."""
    return Rival(label, (), (Job(case),))


def filters(plan: Plan, case: Case) -> list[Rival]:
    """The classical filters: tuned, and with default parameters."""
    return [
        Rival(FILTERS[name].title, (Job(case, filter_name=name, is_tuned=True),), (Job(case, filter_name=name),))
        for name in plan.filters
    ]


def trained(label: str, jobs: tuple[Job, ...]) -> Rival:
    """A training: at the best step and at the suggested one."""
    return Rival(label, jobs, jobs)


def mad_table(title: str, results: Results, by_case: dict[str, list[Rival]], note: str = "") -> Table:
    """Return the MADs: a row for each rival, two columns for each mesh, chosen with the truth and without it."""
    labels = list(dict.fromkeys(rival.label for rivals in by_case.values() for rival in rivals))
    columns = tuple(f"{name}, {how}" for name in by_case for how in ("with truth", "without"))
    rows = []
    for label in labels:
        cells: list[Cell] = []
        for rivals in by_case.values():
            rival = next((rival for rival in rivals if rival.label == label), Rival(label, (), ()))
            cells.append(measure(results.of(rival.with_truth), "with_truth", "mad"))
            cells.append(measure(results.of(rival.without_truth), "without_truth", "mad"))
        rows.append(Row((label,), tuple(cells)))
    return Table(title, ("MAD in degrees",), columns, tuple(rows), bold=True, note=note)


def distance_table(title: str, results: Results, by_case: dict[str, list[Rival]]) -> Table:
    """Return all measures: a row for each mesh, rival and way of choosing."""
    rows = []
    for name, rivals in by_case.items():
        for rival in rivals:
            for choice, how, jobs in (
                ("with_truth", "with truth", rival.with_truth),
                ("without_truth", "without", rival.without_truth),
            ):
                if jobs:
                    records = results.of(jobs)
                    cells = tuple(measure(records, choice, *value) for _, *value in _DISTANCES)  # type: ignore[arg-type]
                    if any(cell.values for cell in cells):
                        rows.append(Row((name, rival.label, how, _chosen(results, jobs, choice)), cells))
    columns = tuple(column for column, *_ in _DISTANCES)
    return Table(title, ("mesh", "method", "chosen", "what was chosen"), columns, tuple(rows), note=_UNITS)


def _chosen(results: Results, jobs: Sequence[Job], choice: str) -> str:
    found = [record.results[choice].what for record in results.of(jobs) if record is not None and choice in record.results]
    return "; ".join(dict.fromkeys(found))
