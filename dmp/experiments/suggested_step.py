"""How much the step that is suggested without a truth loses against the best one."""

from __future__ import annotations

import statistics
from functools import partial
from pathlib import Path

from dmp.experiments.family import cases_of
from dmp.experiments.jobs import Job
from dmp.experiments.plan import Plan
from dmp.experiments.reports import Report, Results
from dmp.experiments.store import JobRecord
from dmp.experiments.tables import Cell, Row, Table, cell, measure


def jobs(plan: Plan) -> list[Job]:
    """Return what has to be done."""
    return [job for case in cases_of(plan) for job in plan.trainings(case)]


def regret(record: JobRecord, choice: str = "without_truth") -> float:
    """Return the MAD of a choice minus that of the best step, degrees; never below 0."""
    return record.results[choice].measures["mad"] - record.results["with_truth"].measures["mad"]


def _step(record: JobRecord, choice: str) -> float | None:
    return record.results[choice].step


def report(plan: Plan, results: Results, folder: Path) -> Report:
    """Return the table of all meshes and its summary."""
    told = Report("What the suggested step loses", folder, [plan.description()])
    told.paragraphs.append(
        "Regret: MAD at the chosen step minus the lowest MAD of all kept steps, degrees. The suggested step is chosen by "
        "vertices that were hidden from the training, without a truth. Not an experiment of the paper."
    )
    rows = []
    regrets: dict[str, list[float]] = {"without_truth": [], "last": []}
    for case in cases_of(plan):
        records = results.of(plan.trainings(case))
        lost = {choice: cell(records, partial(regret, choice=choice)) for choice in regrets}
        for choice, found in lost.items():
            regrets[choice] += found.values
        steps = [cell(records, partial(_step, choice=choice), 0) for choice in ("with_truth", "without_truth")]
        shown = (measure(records, "with_truth", "mad"), *steps, *lost.values())
        rows.append(Row((case.name, case.damage), shown))
    told.tables["summary"] = Table(
        "Regret in degrees, over meshes and seeds",
        ("step",),
        ("runs", "median", "mean", "largest"),
        tuple(
            Row((label,), tuple(Cell((value,), digits) for value, digits in _figures(regrets[choice])))
            for choice, label in (("without_truth", "suggested"), ("last", "last"))
        ),
    )
    columns = ("lowest MAD", "best step", "suggested step", "regret of the suggested step", "regret of the last step")
    told.tables["meshes"] = Table("Each mesh", ("mesh", "noise"), columns, tuple(rows))
    return told


def _figures(values: list[float]) -> list[tuple[float, int]]:
    if not values:
        return [(0, 0), (float("nan"), 2), (float("nan"), 2), (float("nan"), 2)]
    return [(len(values), 0), (statistics.median(values), 2), (statistics.fmean(values), 2), (max(values), 2)]
