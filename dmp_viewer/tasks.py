"""What the window asks of the method: open a mesh, set up a training, go on with one. Called off the GUI thread."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dmp.mesh import TriangleMesh
    from dmp.problem import Problem
    from dmp.runs import Run
    from dmp.settings import Settings
    from dmp.stopping import Suggestion
    from dmp.training import Training
    from dmp_viewer.model import Source
    from dmp_viewer.runner import Session


def _denoise(mesh: TriangleMesh, settings: Settings, truth: TriangleMesh | None) -> Problem:
    from dmp.problem import denoising

    return denoising(mesh, settings, truth)


# The run panel offers these; a task of the method appears in the window by an entry here.
TASKS: dict[str, Callable[[TriangleMesh, Settings, TriangleMesh | None], Problem]] = {"denoise": _denoise}


@dataclass(frozen=True, eq=False)
class OpenedMesh:
    """A mesh that was read, ready to be shown and trained on.

    Attributes:
        problem: the mesh with its smoothed base and, if given, its ground truth.
        source: where it came from.
        notes: what the reader changed, in sentences.
    """

    problem: Problem
    source: Source
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class OpenedRun:
    """A run that was read from its folder."""

    run: Run
    problem: Problem
    source: Source
    suggestion: Suggestion | None


def open_mesh(path: Path, ground_truth_path: Path | None, settings: Settings) -> OpenedMesh:
    """Read a mesh and smooth it (raises :class:`dmp.errors.MeshError`)."""
    from dmp.meshio import read_mesh_with_notes
    from dmp_viewer.model import Source

    mesh, notes = read_mesh_with_notes(path)
    truth: TriangleMesh | None = None
    if ground_truth_path is not None:
        truth, truth_notes = read_mesh_with_notes(ground_truth_path)
        notes = (*notes, *(f"Ground truth: {note}" for note in truth_notes))
    problem = TASKS[settings.task](mesh, settings, truth)
    source = Source(path.stem, path.absolute(), _absolute(ground_truth_path))
    return OpenedMesh(problem, source, (*notes, *problem.notes))


def add_ground_truth(problem: Problem, source: Source, path: Path) -> OpenedMesh:
    """Read the clean version of an open mesh (raises :class:`dmp.errors.MeshError` when it belongs to another one)."""
    from dataclasses import replace

    from dmp.meshio import read_mesh_with_notes
    from dmp.metrics import GroundTruth

    truth, notes = read_mesh_with_notes(path)
    compared = replace(problem, ground_truth=GroundTruth.for_input(truth, problem.mesh))
    return OpenedMesh(compared, replace(source, ground_truth_path=path.absolute()), notes)


def open_run(folder: Path) -> OpenedRun:
    """Open a run folder (raises :class:`dmp.errors.RunError`)."""
    from dmp.runs import Run
    from dmp_viewer.model import Source

    run = Run.open(folder)
    problem = run.problem()
    path = run.input_path
    name = path.stem if path is not None else run.name
    return OpenedRun(run, problem, Source(name, path), run.suggestion())


def start_session(problem: Problem, source: Source, settings: Settings, runs_folder: Path | None = None) -> Session:
    """Set up a new training with a run folder of its own.

    Args:
        problem: what is open; its mesh and ground truth are trained on anew with ``settings``.
        source: where it came from, for the record.
        settings: how to train.
        runs_folder: where to put the run; by default where the library keeps them.
    """
    from dmp.methods import training_for
    from dmp.runs import Run

    truth = problem.ground_truth.mesh if problem.ground_truth is not None else None
    fresh = TASKS[settings.task](problem.mesh, settings, truth)
    # Before the folder is made, so that settings that cannot work leave no empty run behind.
    training = training_for(fresh, settings)
    folder = runs_folder / f"{source.name}_{uuid.uuid4().hex[:8]}" if runs_folder is not None else None
    run = Run.create(fresh, settings, folder=folder, input_path=source.path, ground_truth_path=source.ground_truth_path)
    training.run_id = run.run_id
    return _session(run, training)


def continue_session(run: Run) -> Session:
    """Set up the continuation of a stopped or interrupted run (raises :class:`dmp.errors.RunError`)."""
    return _session(run, run.resume())


def _session(run: Run, training: Training) -> Session:
    from dmp.devices import cores_beside_a_window, device_description
    from dmp.runs import record
    from dmp_viewer.runner import Session

    if run.settings.threads == 0:
        training.threads = cores_beside_a_window()
    return Session(run, training.problem, device_description(training.device).upper(), record(training, run))


def _absolute(path: Path | None) -> Path | None:
    return None if path is None else path.absolute()
