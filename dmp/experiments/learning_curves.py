"""Figure 8 of the paper: how fast a clean mesh and one with weak or strong noise are learnt, without the Laplacian term."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dmp.experiments.cases import Case
from dmp.experiments.jobs import Job
from dmp.experiments.plan import Plan
from dmp.experiments.plots import Line, Panel
from dmp.experiments.reports import Report, Results, mean_curve
from dmp.experiments.store import JobRecord
from dmp.experiments.tables import Cell, Row, Table, cell

_KINDS = {"positions": "position", "displacements": "displacement"}
_LOSS = "data_loss"
# Noise made here, always the same.
_NOISE_SEED = 1


def _meshes(plan: Plan, case: Case) -> dict[str, Case]:
    weak, strong = plan.levels
    return {
        "clean": case.clean(f"{case.name}, clean"),
        f"weak noise ({weak:g})": case.noisy(plan.noise, weak, _NOISE_SEED, f"{case.name}, weak noise"),
        f"strong noise ({strong:g})": case.noisy(plan.noise, strong, _NOISE_SEED, f"{case.name}, strong noise"),
    }


def _trainings(plan: Plan, case: Case, kind: str) -> tuple[Job, ...]:
    # Only the reconstruction of what is there, as in the paper; all vertices are reconstructed.
    return plan.trainings(case, predict=_KINDS[kind], laplacian_weight=0.0, hold_out=0.0)


def _all(plan: Plan) -> list[tuple[Case, str, str, tuple[Job, ...]]]:
    return [
        (case, noise, kind, _trainings(plan, mesh, kind))
        for case in plan.denoising_cases()
        for kind in _KINDS
        for noise, mesh in _meshes(plan, case).items()
    ]


def jobs(plan: Plan) -> list[Job]:
    """Return what has to be done."""
    return [job for *_, jobs in _all(plan) for job in jobs]


def report(plan: Plan, results: Results, folder: Path) -> Report:
    """Return the table and the curves of what is done."""
    told = Report("Learning curves (paper, figure 8)", folder, [plan.description(tells_weight=False)])
    told.paragraphs.append(
        f"Trained with the reconstruction error alone, without the Laplacian term. The noise is {plan.noise}, its levels "
        "are in mean edge lengths. The paper shows curves and no numbers: strong noise is learnt clearly later than a clean "
        "mesh or weak noise, and displacements reach lower errors than positions."
    )
    rows, panels = [], []
    for case in plan.denoising_cases():
        for kind in _KINDS:
            lines = []
            for number, (_, noise, _, trainings) in enumerate(
                item for item in _all(plan) if item[0] == case and item[2] == kind
            ):
                records = results.of(trainings)
                shares = tuple(_at(results, trainings, share) for share in (0.1, 0.25, 0.5, 1.0))
                rows.append(Row((case.name, kind, noise), shares))
                steps, losses = mean_curve(records, _LOSS)
                lines.append(Line(noise, steps, [_in_edges(records, loss) for loss in losses], colour=number))
            panels.append(Panel(f"{case.name}: {kind}", lines))
    columns = ("after 10 % of the steps", "25 %", "50 %", "all")
    told.tables["losses"] = Table(
        "Reconstruction error", ("mesh", "predicted", "input"), columns, tuple(rows),
        note="Mean distance from the input, in mean edge lengths of the clean mesh; a mean over the steps around each share.",
    )  # fmt: skip
    told.add_chart(
        "curves", "Reconstruction error while training, mean over the seeds.", panels,
        x_label="step", y_label="reconstruction error", log_y=True, same_y=True,
    )  # fmt: skip
    return told


def _in_edges(records: Sequence[JobRecord | None], loss: float | None) -> float | None:
    """Return a loss in mean edge lengths of the clean mesh; all seeds have the same unit."""
    unit = next((record.facts["unit"] for record in records if record is not None and not record.failure), 1.0)
    return None if loss is None else loss * unit


def _at(results: Results, trainings: tuple[Job, ...], share: float) -> Cell:
    """The error at a share of the steps, a mean over the logged steps around it, because single ones jump."""

    def value(record: JobRecord) -> float | None:
        pairs = zip(record.curve.get("step", ()), record.curve.get(_LOSS, ()), strict=True)
        points = [(step, loss) for step, loss in pairs if step is not None and loss is not None]
        near = [loss for step, loss in points if abs(step - share * points[-1][0]) <= 0.02 * points[-1][0]]
        return _in_edges([record], sum(near) / len(near)) if near else None

    return cell(results.of(trainings), value, 3)
