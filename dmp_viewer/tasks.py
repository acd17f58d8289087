"""What the window asks of the method: open a mesh, set up a training, go on with one. Called off the GUI thread."""

from __future__ import annotations

import re
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from dmp.errors import MeshError, NoHolesError, NoSphereError

if TYPE_CHECKING:
    from dmp.boundary import BoundaryLoop
    from dmp.mesh import TriangleMesh
    from dmp.problem import Problem
    from dmp.runs import Run
    from dmp.settings import Settings
    from dmp.stopping import Suggestion
    from dmp.training import Training
    from dmp_viewer.colors import UpAxis
    from dmp_viewer.model import Source
    from dmp_viewer.runner import Session


# The tasks that the run panel offers.
TASKS = ("denoise", "complete")


@dataclass(frozen=True, eq=False)
class OpenedMesh:
    """A mesh that was read, ready to be shown and trained on.

    Attributes:
        problem: the mesh with its smoothed base and, if given, its ground truth.
        source: where it came from.
        notes: what was changed on the way, in sentences.
        failed: indices of the holes that could not be closed, with the reason.
    """

    problem: Problem
    source: Source
    notes: tuple[str, ...]
    failed: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class OpenedRun:
    """A run that was read from its folder."""

    run: Run
    problem: Problem
    source: Source
    suggestion: Suggestion | None


def open_mesh(path: Path, ground_truth_path: Path | None, settings: Settings) -> OpenedMesh:
    """Read a mesh and set it up for the task of ``settings`` (raises :class:`dmp.errors.MeshError`)."""
    from dmp.meshio import read_mesh_with_notes
    from dmp_viewer.holes import find_holes
    from dmp_viewer.model import Source

    mesh, notes = read_mesh_with_notes(path)
    truth: TriangleMesh | None = None
    if ground_truth_path is not None:
        truth, truth_notes = read_mesh_with_notes(ground_truth_path)
        notes = (*notes, *(f"Ground truth: {note}" for note in truth_notes))
    up = up_axis_of(path)
    source = Source(path.stem, mesh, truth, path.absolute(), _absolute(ground_truth_path), up, find_holes(mesh))
    opened = set_up(source, settings)
    return replace(opened, notes=(*notes, *opened.notes))


def set_up(source: Source, settings: Settings, loops: tuple[BoundaryLoop, ...] | None = None) -> OpenedMesh:
    """Set an open mesh up for a task; one without holes is shown as it is when holes were to be filled.

    Args:
        source: what is open.
        settings: what to do and how.
        loops: the holes to fill, or None for the usual choice.
    """
    from dmp_viewer.holes import failures

    try:
        problem = _problem(source, settings, loops)
    except NoHolesError as error:
        shown = set_up(source, replace(settings, task="denoise"))
        return replace(shown, notes=(str(error), *shown.notes))
    except NoSphereError as error:
        # Nothing is wrong with the mesh, so it is shown; who starts all the same is told again.
        shown = set_up(source, replace(settings, smoothing="laplacian"), loops)
        return replace(shown, notes=(*shown.notes, str(error)))
    if problem.task != "complete":
        return OpenedMesh(problem, source, problem.notes)
    most, usual = settings.max_hole_edges, source.holes.usual_choice
    named = {id(loop) for loop in loops or ()}
    wanted = frozenset(
        index
        for index, loop in enumerate(source.holes.loops)
        if (index in usual if loops is None else id(loop) in named) and (not most or loop.n_edges <= most)
    )
    return OpenedMesh(problem, source, problem.notes, failures(source.holes, wanted, problem))


def _problem(source: Source, settings: Settings, loops: tuple[BoundaryLoop, ...] | None) -> Problem:
    from dmp.completion import completion
    from dmp.problem import denoising

    if settings.task != "complete":
        return denoising(source.mesh, settings, source.ground_truth)
    if loops is not None and not loops:
        raise NoHolesError("No hole is chosen to be filled. Tick at least one in the list of holes.")
    return completion(source.mesh, settings, source.ground_truth, loops)


def add_ground_truth(problem: Problem, source: Source, path: Path) -> OpenedMesh:
    """Read the clean version of an open mesh (raises :class:`dmp.errors.MeshError` when it belongs to another one)."""
    from dmp.hole_metrics import HoleTruth
    from dmp.meshio import read_mesh_with_notes
    from dmp.metrics import GroundTruth

    truth, notes = read_mesh_with_notes(path)
    measured: GroundTruth | HoleTruth
    if problem.task == "complete":
        measured = HoleTruth.for_filled(truth, problem.mesh, problem.known, problem.edge_length)
    else:
        measured = GroundTruth.for_input(truth, problem.mesh)
    compared = replace(problem, ground_truth=measured)
    return OpenedMesh(compared, replace(source, ground_truth=truth, ground_truth_path=path.absolute()), notes)


def open_run(folder: Path) -> OpenedRun:
    """Open a run folder (raises :class:`dmp.errors.RunError`)."""
    from dmp.runs import Run
    from dmp_viewer.holes import find_holes, still_open
    from dmp_viewer.model import Source

    run = Run.open(folder)
    problem = run.problem()
    path = run.input_path
    # The stem of proposed file names: what a run calls itself must not lead into another folder.
    name = re.sub(r"[^\w .,()+-]", "_", path.stem if path is not None else run.name).strip(". ")[:80] or "mesh"
    truth = problem.ground_truth.mesh if problem.ground_truth is not None else None
    mesh = _before_filling(problem)
    holes = find_holes(mesh)
    if problem.task == "complete":
        holes = replace(holes, chosen_at_first=frozenset(range(len(holes.loops))) - still_open(holes, problem.mesh))
    source = Source(name, mesh, truth, path, up=up_axis_of(path), holes=holes)
    return OpenedRun(run, problem, source, run.suggestion())


def start_session(
    source: Source,
    settings: Settings,
    runs_folder: Path | None = None,
    loops: tuple[BoundaryLoop, ...] | None = None,
    *,
    leaves_core: bool = True,
) -> Session:
    """Set up a new training with a run folder of its own.

    Args:
        source: what is open.
        settings: what to do and how.
        runs_folder: where to put the run; by default where the library keeps them.
        loops: the holes to fill, or None for the usual choice.
        leaves_core: whether a core is left to the window, unless the settings name a number of threads.
    """
    return _session(*_new_run(source, settings, runs_folder, loops, in_memory=True), leaves_core=leaves_core)


def waiting_run(
    source: Source, settings: Settings, runs_folder: Path | None = None, loops: tuple[BoundaryLoop, ...] | None = None
) -> Run:
    """Make the folder of a run whose training is to begin later; the arguments are those of :func:`start_session`.

    Raises:
        DmpError: when the settings cannot work, or the folder cannot be written.
    """
    return _new_run(source, settings, runs_folder, loops, in_memory=False)[0]


def _new_run(
    source: Source,
    settings: Settings,
    runs_folder: Path | None,
    loops: tuple[BoundaryLoop, ...] | None,
    *,
    in_memory: bool,
) -> tuple[Run, Training]:
    from dmp.memory_needs import check_memory
    from dmp.methods import training_for
    from dmp.runs import Run

    fresh = _problem(source, settings, loops)
    longer_way = check_memory(settings, fresh.mesh.n_vertices)
    # Before the folder is made, so that settings that cannot work leave no empty run behind.
    training = training_for(fresh, settings)
    folder = runs_folder / f"{source.name}_{uuid.uuid4().hex[:8]}" if runs_folder is not None else None
    run = Run.create(
        fresh,
        settings,
        folder=folder,
        input_path=source.path,
        ground_truth_path=source.ground_truth_path,
        name=source.name,
        in_memory=in_memory,
    )
    training.run_id = run.run_id
    if longer_way:
        run.warnings.append(longer_way)
    return run, training


def continue_session(run: Run, steps: int | None = None, *, leaves_core: bool = True) -> Session:
    """Set up the continuation of a run, until ``steps`` if given (raises :class:`dmp.errors.RunError`).

    ``leaves_core`` is that of :func:`start_session`; it matters to a run that has not begun.
    """
    return _session(run, run.resume(steps), leaves_core=leaves_core)


def _session(run: Run, training: Training, *, leaves_core: bool) -> Session:
    from dmp.devices import cores_beside_a_window, device_description
    from dmp.runs import record
    from dmp_viewer.runner import Session

    # A run that is gone on with keeps its number of threads: sums over another one differ in their last digits.
    if leaves_core and run.settings.threads == 0 and run.recorded_threads is None:
        training.threads = cores_beside_a_window()
    return Session(run, run.problem(), device_description(training.device).upper(), record(training, run))


def up_axis_of(path: Path | None) -> UpAxis | None:
    """Return the axis that points up in a file, where that is known: the samples are modelled with z up."""
    from dmp.samples import assets_folder

    try:
        return "z" if path is not None and path.absolute().parent == assets_folder() else None
    except MeshError:
        return None


def _before_filling(problem: Problem) -> TriangleMesh:
    """Return the mesh as it was before its holes were filled: inserted vertices and faces come last."""
    import numpy as np

    from dmp.mesh import TriangleMesh

    if problem.task != "complete":
        return problem.mesh
    vertices, faces = problem.mesh.vertices[: int(problem.known.sum())], problem.mesh.faces
    # Runs of earlier versions do not say how many faces there were.
    with_inserted = np.flatnonzero(~problem.known[faces].all(axis=1))
    n_faces = problem.n_input_faces or (int(with_inserted[0]) if len(with_inserted) else len(faces))
    return TriangleMesh(vertices, faces[:n_faces])


def _absolute(path: Path | None) -> Path | None:
    return None if path is None else path.absolute()
