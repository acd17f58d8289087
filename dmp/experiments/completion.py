"""Figures 6 and 7 of the paper: holes that are filled, and what the network makes of the filling."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.sparse import csgraph

from dmp.experiments.cases import Case, meshes_of
from dmp.experiments.doing import problem_of, result_vertices
from dmp.experiments.jobs import Job
from dmp.experiments.pictures import Shown
from dmp.experiments.plan import Plan
from dmp.experiments.plots import Line, Panel
from dmp.experiments.reports import Report, Results, mean_curve
from dmp.experiments.rows import Rival, trained, untouched
from dmp.experiments.tables import Cell, Row, Table, measure
from dmp.geometry import vertex_normals
from dmp.mesh import FloatArray
from dmp.problem import Problem
from dmp.topology import adjacency

_FILLED = "holes filled, nothing else"
_PRIOR = "Deep Mesh Prior"
_BEST = "preset best"


def _cases(plan: Plan) -> list[Case]:
    """Those with holes as they are; into the clean meshes of the others two holes are cut."""
    return [case if case.task == "complete" else case.with_cut_holes() for case in plan.cases]


def _rivals(plan: Plan, case: Case) -> list[Rival]:
    return [
        untouched(case, _FILLED),
        trained(_PRIOR, plan.trainings(case)),
        trained(_BEST, plan.trainings(case, preset="best")),
    ]


def jobs(plan: Plan) -> list[Job]:
    """Return what has to be done."""
    return [job for case in _cases(plan) for rival in _rivals(plan, case) for job in rival.jobs]


def report(plan: Plan, results: Results, folder: Path) -> Report:
    """Return the table, the curves and the pictures of what is done."""
    told = Report("Completion (paper, figures 6 and 7)", folder)
    seeds = ", ".join(map(str, plan.seeds))
    told.paragraphs.append(f"Deep Mesh Prior with preset {plan.preset_for('complete')}, and preset best; seeds {seeds}.")
    if plan.preset != plan.preset_for("complete"):
        told.remarks.append(f"Preset {plan.preset} cannot fill holes; preset {plan.preset_for('complete')} was taken.")
    told.paragraphs.append("The paper judges its completions by eye and prints no numbers.")
    rows, panels = [], []
    for case in _cases(plan):
        lines: list[Line] = []
        for rival in _rivals(plan, case):
            cells: list[Cell] = []
            for name, digits in (("hole_distance", 3), ("hole_normal_error", 1)):
                cells += (
                    measure(results.of(rival.with_truth), "with_truth", name, digits),
                    measure(results.of(rival.without_truth), "without_truth", name, digits),
                )
            rows.append(Row((case.name, rival.label), tuple(cells)))
            if rival.with_truth:
                lines.append(Line(rival.label, *mean_curve(results.of(rival.with_truth), "hole_distance"), colour=len(lines)))
        panels.append(Panel(case.name, lines))
    columns = ("distance, best step", "distance, without truth", "normals, best step", "normals, without truth")
    told.tables["completion"] = Table(
        "Inserted vertices and faces against the true surface", ("mesh", "method"), columns, tuple(rows),
        note="Distance: mean of the inserted vertices to the true surface, mean edge lengths of the input. Normals: mean angle "
        "between inserted faces and the true surface, degrees. *Best step*: the one with the smallest distance.",
    )  # fmt: skip
    told.add_chart(
        "curves", "Distance of the inserted vertices while training, mean over the seeds.", panels,
        x_label="step", y_label="distance, mean edge lengths",
    )  # fmt: skip
    for case in _cases(plan):
        told.add_pictures(
            case.name,
            f"{case.name}: the first hole, closely.",
            lambda case=case: _pictures(plan, results, case),  # type: ignore[misc]
            meshes_of(case, results.store.shapes_folder)[1],
        )
    return told


def _pictures(plan: Plan, results: Results, case: Case) -> list[Shown]:
    """The hole, its filling, the completions and the truth, from the same place."""
    store = results.store
    damaged, truth = meshes_of(case, store.shapes_folder)
    problem = problem_of(Job(case), store)
    view = _first_hole(problem)
    found = [Shown("with holes", damaged, None, *view)]
    for rival, title in zip(_rivals(plan, case), ("filled", "DMP", "preset best"), strict=True):
        job = rival.without_truth[0]
        record = store.read(job)
        if record is not None and "without_truth" in record.results:
            mesh = problem.mesh.with_vertices(result_vertices(job, store, "without_truth"))
            distance = record.results["without_truth"].measures["hole_distance"]
            found.append(Shown(f"{title}\ndistance {distance:.2f}", mesh, None, *view))
    return [*found, Shown("ground truth", truth, None, *view)]


def _first_hole(problem: Problem) -> tuple[FloatArray, float, FloatArray]:
    """Return middle and reach of the filling that faces the eye of the pictures most, and the direction it faces."""
    from dmp.rendering import EYE

    n_vertices, faces = problem.mesh.n_vertices, problem.mesh.faces
    inserted = ~problem.known
    filling = faces[inserted[faces].any(axis=1)]
    _, patch_of = csgraph.connected_components(adjacency(filling, n_vertices), directed=False)
    first = int(np.where(inserted, problem.target @ np.asarray(EYE), -np.inf).argmax())
    members = patch_of == patch_of[first]
    points = problem.target[members]
    middle = points.mean(axis=0)
    normals = vertex_normals(problem.target, faces)[members].sum(axis=0)
    towards = normals if np.linalg.norm(normals) > 0 else np.asarray(EYE)
    return middle, 1.5 * float(np.linalg.norm(points - middle, axis=1).max()), towards
