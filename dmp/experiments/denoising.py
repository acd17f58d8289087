"""Figure 4 and table 1 of the paper: convolutions, positions against displacements, and the rivals."""

from __future__ import annotations

from pathlib import Path

from dmp.experiments.cases import Case, meshes_of
from dmp.experiments.doing import problem_of, result_vertices
from dmp.experiments.jobs import Job
from dmp.experiments.pictures import Shown
from dmp.experiments.plan import Plan
from dmp.experiments.plots import Line, Panel
from dmp.experiments.published import TABLE_1
from dmp.experiments.reports import Report, Results, mean_curve
from dmp.experiments.rows import Rival, distance_table, filters, mad_table, trained, untouched
from dmp.metrics import GroundTruth, angular_differences

_POSITIONS = "Deep Mesh Prior, positions (GCN)"
_DISPLACEMENTS = "Deep Mesh Prior, displacements (GCN)"
_BEST = "preset best (last step)"
_OTHERS = {
    "Deep Mesh Prior, displacements (Chebyshev)": "chebyshev",
    "Deep Mesh Prior, displacements (Gaussian mixture by degree, as published)": "gmm",
    "Deep Mesh Prior, displacements (Gaussian mixture by geometry)": "gmm-geometric",
}
_NOTE = (
    "*With truth*: the step, or the parameters of a filter, that come closest to the ground truth, as the paper chooses its "
    "numbers; nobody has that truth for a scan. *Without*: the suggested step, the default parameters, the last step of preset "
    "best. A tuned filter is a strong rival: on several meshes plain filters tie with the numbers that the paper printed."
)


def _rivals(plan: Plan, case: Case) -> list[Rival]:
    trainings = [
        trained(_POSITIONS, plan.trainings(case, predict="position")),
        trained(_DISPLACEMENTS, plan.trainings(case)),
        *(trained(label, plan.trainings(case, convolution=name)) for label, name in _OTHERS.items()),
        trained(_BEST, plan.trainings(case, preset="best")),
    ]
    return [untouched(case), *filters(plan, case), *trainings]


def jobs(plan: Plan) -> list[Job]:
    """Return what has to be done."""
    return [job for case in plan.denoising_cases() for rival in _rivals(plan, case) for job in rival.jobs]


def report(plan: Plan, results: Results, folder: Path) -> Report:
    """Return tables, curves and pictures of what is done."""
    by_case = {case.name: _rivals(plan, case) for case in plan.denoising_cases()}
    told = Report("Denoising (paper, figure 4 and table 1)", folder, [plan.description()], published=TABLE_1)
    told.tables["mad"] = mad_table("Mean angular difference", results, by_case, _NOTE)
    told.tables["distances"] = distance_table("All measures", results, by_case)
    panels = []
    for name, rivals in by_case.items():
        curves = [rival for rival in rivals if rival.label in (_POSITIONS, _DISPLACEMENTS, *_OTHERS)]
        lines = [
            Line(rival.label.removeprefix("Deep Mesh Prior, "), *mean_curve(results.of(rival.with_truth), "mad"), colour=number)
            for number, rival in enumerate(curves)
        ]
        panels.append(Panel(name, lines))
    told.add_chart(
        "curves", "MAD while training, mean over the seeds.", panels, x_label="step", y_label="MAD, degrees", log_y=True
    )
    for case in plan.denoising_cases():
        told.add_pictures(
            case.name,
            f"{case.name}: colours are the angles between the faces' normals and the true ones.",
            lambda case=case: _pictures(results, case, by_case[case.name]),  # type: ignore[misc]
            meshes_of(case, results.store.shapes_folder)[1],
        )
    return told


def _pictures(results: Results, case: Case, rivals: list[Rival]) -> list[Shown]:
    """Noisy, the best tuned filter, positions, displacements, preset best, and the truth."""
    store = results.store
    truth = problem_of(Job(case), store).ground_truth
    assert isinstance(truth, GroundTruth)
    input_mesh = meshes_of(case, store.shapes_folder)[0]

    def shown(title: str, job: Job, choice: str) -> Shown | None:
        record = store.read(job)
        if record is None or choice not in record.results:
            return None
        vertices = result_vertices(job, store, choice)
        angles = angular_differences(vertices, truth.normals, truth.mesh.faces)
        title = f"{title}\nMAD {record.results[choice].measures['mad']:.2f}"
        return Shown(title, input_mesh.with_vertices(vertices), angles)

    tuned = [job for rival in rivals for job in rival.with_truth if job.filter_name]
    closest = min(tuned, key=lambda job: _mad(results, job), default=None)
    by_label = {rival.label: rival for rival in rivals}
    found = [
        shown("noisy", Job(case), "without_truth"),
        shown(f"{closest.filter_name} filter, tuned", closest, "with_truth") if closest else None,
        shown("DMP, positions", by_label[_POSITIONS].with_truth[0], "with_truth"),
        shown("DMP, displacements", by_label[_DISPLACEMENTS].with_truth[0], "with_truth"),
        shown("preset best", by_label[_BEST].without_truth[0], "without_truth"),
    ]
    return [item for item in found if item is not None] + [Shown("ground truth", truth.mesh)]


def _mad(results: Results, job: Job) -> float:
    record = results.store.read(job)
    return (
        record.results["with_truth"].measures["mad"] if record is not None and "with_truth" in record.results else float("inf")
    )
