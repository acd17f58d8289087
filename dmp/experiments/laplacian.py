"""Figure 5 of the paper: how the MAD goes on with and without the Laplacian term."""

from __future__ import annotations

from pathlib import Path

from dmp.experiments.cases import Case
from dmp.experiments.jobs import Job
from dmp.experiments.plan import Plan
from dmp.experiments.plots import Line, Panel
from dmp.experiments.reports import Report, Results, mean_curve
from dmp.experiments.store import JobRecord
from dmp.experiments.tables import Row, Table, cell, measure

# How broad a minimum is: the share of steps whose MAD is at most this much above the lowest, degrees.
_CLOSE = 0.5


def _variants(plan: Plan, case: Case) -> dict[str, tuple[Job, ...]]:
    return {"with the term": plan.trainings(case), "without it": plan.trainings(case, laplacian_weight=0.0)}


def jobs(plan: Plan) -> list[Job]:
    """Return what has to be done."""
    return [job for case in plan.denoising_cases() for jobs in _variants(plan, case).values() for job in jobs]


def report(plan: Plan, results: Results, folder: Path) -> Report:
    """Return the table and the curves of what is done."""
    told = Report("The Laplacian term (paper, figure 5)", folder, [plan.description()])
    told.paragraphs.append(
        "The paper shows curves and no numbers: without the term the MAD has a sharp minimum and rises again, with it the "
        "minimum is broad."
    )
    rows, panels = [], []
    for case in plan.denoising_cases():
        lines = []
        for number, (label, variant) in enumerate(_variants(plan, case).items()):
            records = results.of(variant)
            rows.append(
                Row(
                    (case.name, label),
                    (
                        measure(records, "with_truth", "mad"),
                        cell(records, lambda record: record.results["with_truth"].step, 0),
                        measure(records, "last", "mad"),
                        cell(records, _rise),
                        cell(records, lambda record: 100 * close_share(record), 0),
                    ),
                )
            )
            lines.append(Line(label, *mean_curve(records, "mad"), colour=number))
        panels.append(Panel(case.name, lines))
    columns = (
        "lowest MAD",
        "at step",
        "MAD at the last step",
        "rise until then",
        f"% of steps within {_CLOSE:g} of the lowest",
    )
    told.tables["laplacian"] = Table("MAD in degrees while training", ("mesh", "Laplacian term"), columns, tuple(rows))
    told.add_chart("curves", "MAD while training, mean over the seeds.", panels, x_label="step", y_label="MAD, degrees")
    return told


def _rise(record: JobRecord) -> float:
    return record.results["last"].measures["mad"] - record.results["with_truth"].measures["mad"]


def close_share(record: JobRecord) -> float:
    """Return the share of the logged steps whose MAD is within half a degree of the lowest one, 0 to 1."""
    values = [value for value in record.curve.get("mad", []) if value is not None]
    return sum(value <= min(values) + _CLOSE for value in values) / len(values) if values else float("nan")
