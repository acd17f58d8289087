"""Preset best, which knows no truth, against every filter tuned with the truth, on many meshes."""

from __future__ import annotations

import math
import statistics
from pathlib import Path

from dmp.experiments.cases import Case
from dmp.experiments.family import cases_of
from dmp.experiments.jobs import Job
from dmp.experiments.plan import Plan
from dmp.experiments.reports import Report, Results
from dmp.experiments.tables import Cell, Row, Table, measure


def _best(plan: Plan, case: Case) -> tuple[Job, ...]:
    return plan.trainings(case, preset="best")


def _filters(plan: Plan, case: Case) -> tuple[Job, ...]:
    return tuple(Job(case, filter_name=name, is_tuned=True) for name in plan.filters)


def jobs(plan: Plan) -> list[Job]:
    """Return what has to be done."""
    return [job for case in cases_of(plan) for job in (Job(case), *_filters(plan, case), *_best(plan, case))]


def report(plan: Plan, results: Results, folder: Path) -> Report:
    """Return the table of all meshes and its summary."""
    told = Report("Preset best against tuned filters", folder)
    told.paragraphs.append(
        "Preset best gives its last step and never sees the truth; each filter has the parameters that come closest to the "
        f"truth by MAD. Seeds {', '.join(map(str, plan.seeds))}. Not an experiment of the paper."
    )
    rows = []
    pairs: dict[str, list[tuple[float, float]]] = {"mad": [], "vertex_error": []}
    for case in cases_of(plan):
        best = results.of(_best(plan, case))
        filtered = {job.filter_name or "": results.of([job]) for job in _filters(plan, case)}
        untouched = results.of([Job(case)])
        cells: list[Cell] = []
        for name, digits in (("mad", 2), ("vertex_error", 3)):
            ours = measure(best, "without_truth", name, digits)
            tuned = {title: measure(records, "with_truth", name, digits) for title, records in filtered.items()}
            least = min((cell for cell in tuned.values() if cell.values), key=lambda cell: cell.values[0], default=Cell())
            cells += (measure(untouched, "without_truth", name, digits), ours, least)
            if ours.mean is not None and least.mean is not None:
                pairs[name].append((ours.mean, least.mean))
        closest = min(filtered, key=lambda title: _mad(results, case, title), default="")
        rows.append(Row((case.name, case.damage, closest), tuple(cells)))
    columns = (
        "MAD: input", "MAD: preset best", "MAD: best tuned filter",
        "vertex distance: input", "vertex distance: preset best", "vertex distance: least of the tuned filters",
    )  # fmt: skip
    told.tables["summary"] = summary(pairs)
    told.tables["meshes"] = Table("Each mesh", ("mesh", "noise", "best filter by MAD"), columns, tuple(rows))
    return told


def summary(pairs: dict[str, list[tuple[float, float]]]) -> Table:
    """Return the share of meshes on which ours is lower, and the median ratio, for each measure.

    Args:
        pairs: ours and the rival's by measure, one pair for each mesh.
    """
    titles = {"mad": "MAD", "vertex_error": "mean vertex distance"}
    rows = []
    for name, values in pairs.items():
        wins = (100 * sum(ours < other for ours, other in values) / len(values),) if values else ()
        ratios = [ours / other for ours, other in values if other > 0]
        ratio = (statistics.median(ratios),) if ratios else ()
        rows.append(Row((titles[name],), (Cell((len(values),), 0), Cell(wins, 0), Cell(ratio))))
    columns = ("meshes", "% of them where preset best is lower", "median of preset best / best tuned filter")
    return Table("Summary", ("measure",), columns, tuple(rows))


def _mad(results: Results, case: Case, filter_name: str) -> float:
    record = results.store.read(Job(case, filter_name=filter_name, is_tuned=True))
    return record.results["with_truth"].measures["mad"] if record is not None and "with_truth" in record.results else math.inf
