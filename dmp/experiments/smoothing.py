"""Table 2 of the paper: what the displacements start from."""

from __future__ import annotations

from pathlib import Path

from dmp.experiments.cases import Case
from dmp.experiments.jobs import Job
from dmp.experiments.plan import Plan
from dmp.experiments.plots import Line, Panel
from dmp.experiments.published import TABLE_2
from dmp.experiments.reports import Report, Results, mean_curve
from dmp.experiments.tables import Row, Table, measure

_KINDS = {"none": "unprocessed", "laplacian": "Laplacian smoothing", "spherical": "sphere"}


def _variants(plan: Plan, case: Case) -> dict[str, tuple[Job, ...]]:
    return {label: plan.trainings(case, smoothing=kind) for kind, label in _KINDS.items()}


def jobs(plan: Plan) -> list[Job]:
    """Return what has to be done."""
    return [job for case in plan.denoising_cases() for jobs in ((Job(case),), *_variants(plan, case).values()) for job in jobs]


def report(plan: Plan, results: Results, folder: Path) -> Report:
    """Return the table and the curves of what is done."""
    told = Report("The smoothing (paper, table 2)", folder, [plan.description()], published=TABLE_2)
    rows, panels = [], []
    for case in plan.denoising_cases():
        variants = _variants(plan, case)
        for choice, label in (("with_truth", "with truth"), ("without_truth", "without")):
            cells = [measure(results.of(variant), choice, "mad") for variant in variants.values()]
            rows.append(Row((case.name, label), (measure(results.of([Job(case)]), "without_truth", "mad"), *cells)))
        lines = [
            Line(label, *mean_curve(results.of(variant), "mad"), colour=number)
            for number, (label, variant) in enumerate(variants.items())
        ]
        panels.append(Panel(case.name, lines))
    told.tables["smoothing"] = Table(
        "MAD in degrees",
        ("mesh", "step chosen"),
        ("the input", *_KINDS.values()),
        tuple(rows),
        note="*With truth*: the step with the lowest MAD, as in the paper. *Without*: the suggested step.",
    )
    told.add_chart("curves", "MAD while training, mean over the seeds.", panels, x_label="step", y_label="MAD, degrees")
    return told
