"""What is laid beside the run on show: other runs of the same mesh, and classical filters. Called off the GUI thread."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from dmp.errors import MeshError, RunError
from dmp.filters import filter_named, filtered, tuned
from dmp.mesh import FloatArray
from dmp.metrics import GroundTruth
from dmp.problem import Problem
from dmp.runs import Run, list_runs
from dmp_viewer.other_run import OtherRun

_METHODS = {"prior": "Deep Mesh Prior", "recorrupted": "recorrupted copies", "made-up-holes": "made-up holes"}


@dataclass(frozen=True)
class RunEntry:
    """A run to choose.

    Attributes:
        folder: where it lies.
        name: what it is called.
        details: how it was trained and how far it is, one line.
    """

    folder: Path
    name: str
    details: str


def comparable_runs(folder: Path | None, problem: Problem, shown_run_id: str | None) -> list[RunEntry]:
    """Return the runs that may be of the open mesh, newest first, without the one on show and those without snapshots.

    Args:
        folder: where to look; None for the usual place.
        problem: what is open.
        shown_run_id: the run on show.
    """
    found = []
    for run in list_runs(folder):
        fits = run.mesh_size == (problem.mesh.n_vertices, problem.mesh.n_faces)
        if fits and run.run_id != shown_run_id and run.snapshot_steps():
            found.append(RunEntry(run.folder, run.name, _details(run)))
    return found


def open_other(folder: Path, problem: Problem) -> OtherRun:
    """Open a run to lay it beside the one on show.

    Raises:
        RunError: when it cannot be read, is of another mesh, or has no snapshots.
    """
    run = Run.open(folder)
    if not run.problem().mesh.same_connectivity(problem.mesh):
        raise RunError(f"The run “{run.name}” was trained on another mesh. Choose a run of the mesh that is open.")
    if not run.snapshot_steps():
        raise RunError(f"The run “{run.name}” has no snapshots yet, so there is nothing to compare with.")
    return OtherRun(run)


@dataclass(frozen=True, eq=False)
class FilteredMesh:
    """What a filter made of the input.

    Attributes:
        title: name of the filter, for people.
        details: its parameters, for people.
        positions: (V, 3), file units.
    """

    title: str
    details: str
    positions: FloatArray


def run_filter(problem: Problem, name: str, parameters: Mapping[str, int | float | str]) -> FilteredMesh:
    """Filter the input (raises :class:`dmp.errors.DmpError` when that fails)."""
    chosen = filter_named(name)
    return FilteredMesh(chosen.title, _in_words(chosen.checked(parameters)), filtered(problem.mesh, name, **parameters))


def run_tuned_filter(problem: Problem, name: str) -> FilteredMesh:
    """Filter the input with the parameters that come closest to the ground truth.

    Raises:
        DmpError: when that fails, or there is no ground truth with the same faces.
    """
    truth = problem.ground_truth
    if not isinstance(truth, GroundTruth):
        raise MeshError("The best parameters can only be found with a ground truth that has the same faces as the mesh.")
    best = tuned(problem.mesh, truth, name)
    return FilteredMesh(filter_named(name).title, f"tuned by truth: {_in_words(best.parameters)}", best.vertices)


def _in_words(parameters: Mapping[str, int | float | str]) -> str:
    return ", ".join(
        f"{name.replace('_', ' ')} {value if isinstance(value, str) else f'{value:g}'}" for name, value in parameters.items()
    )


def _details(run: Run) -> str:
    kept = f", kept step {run.kept_step:,}" if run.kept_step is not None else ""
    return f"Preset {run.settings.preset} ({_METHODS[run.settings.method]}), {run.last_step:,} steps, {run.state}{kept}"
