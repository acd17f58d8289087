"""The function that does one job of a batch, in any process: train, choose a step, save it."""

from __future__ import annotations

import math
import platform
import shutil
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dmp.batch.folder import BatchFolder, Outcome
from dmp.batch.jobs import BatchJob
from dmp.batch.parcel import pack, private_folder, unpack
from dmp.errors import DmpError, NoHolesError, RunError

if TYPE_CHECKING:
    from dmp.mesh import FloatArray, TriangleMesh
    from dmp.runs import Run

Stop = Callable[[], bool]
Told = Callable[[float], object]

# So long a job waits for a folder whose lock another process holds: one that was taken for dead may still be writing.
LOCK_PATIENCE_SECONDS = 120.0
_PICTURE_SIDE = 160
_COLOUR = (0.66, 0.74, 0.85)


class Interrupted(Exception):  # noqa: N818
    """A job was asked to stop before its end; its run folder is whole, and the next attempt goes on from it.

    Attributes:
        parcel: its run folder when it does not lie where the batch does, empty otherwise.
    """

    def __init__(self, parcel: bytes = b"") -> None:
        super().__init__(parcel)
        self.parcel = parcel


@dataclass(frozen=True)
class Order:
    """What is wanted of all jobs of a batch.

    Attributes:
        suffix: format of the results, such as ``.ply``.
        keep: which step to save: ``auto``, ``last`` or ``best``.
        batch: identifies the batch, for the name of a folder of its own.
    """

    suffix: str = ".ply"
    keep: str = "auto"
    batch: str = ""


@dataclass(frozen=True, eq=False)
class Delivery:
    """What is sent to a worker that does not see the files, for one job.

    Attributes:
        mesh, ground_truth: the meshes as they were read.
        notes: what was changed in reading.
        run: the run folder so far, from :func:`dmp.batch.parcel.pack`; empty at first.
    """

    mesh: TriangleMesh
    ground_truth: TriangleMesh | None
    notes: tuple[str, ...]
    run: bytes = b""


@dataclass(frozen=True, eq=False)
class _Attempt:
    """One attempt at a job, with all that it needs."""

    job: BatchJob
    place: BatchFolder
    delivery: Delivery | None
    threads: int
    stop: Stop
    told: Told


@dataclass(frozen=True, eq=False)
class Done:
    """What a worker returns.

    Attributes:
        outcome: how the job ended.
        picture: the input beside the result, PNG; empty when there is none.
        run: the run folder, and ``result`` the file of the restored mesh, when they do not lie where the batch does.
    """

    outcome: Outcome
    picture: bytes = b""
    run: bytes = b""
    result: bytes = b""


def do_job(
    job: BatchJob,
    folder: Path | None,
    order: Order | None = None,
    delivery: Delivery | None = None,
    *,
    threads: int = 0,
    stop: Stop = lambda: False,
    told: Told = lambda _share: None,
) -> Done:
    """Do a job, going on from its last checkpoint where its run folder is there.

    An error that a person can cause becomes the outcome's ``failure``.

    Args:
        job: what to do.
        folder: the folder of the batch; None when this process does not see it and works in one of its own.
        order: what is wanted of all jobs of the batch.
        delivery: the meshes, where their files cannot be seen.
        threads: processor threads, when the settings leave them open; 0 for as many as there are cores.
        stop: asked after each training step.
        told: called with the share that is done, 0 to 1.

    Raises:
        Interrupted: when ``stop`` said so.
    """
    started = time.perf_counter()
    order = order or Order()
    is_here = folder is not None
    own: Path | None = None
    basis = Outcome(
        mesh=str(job.mesh), task=job.settings.task, preset=job.settings.preset, seed=job.settings.seed, machine=platform.node()
    )
    try:
        if folder is None:
            own = folder = private_folder(order.batch) / job.name
            if delivery is not None and delivery.run and not BatchFolder(own).run_folder(job.name).exists():
                unpack(delivery.run, BatchFolder(own).run_folder(job.name))
        place = BatchFolder(folder)
        done = _restore(_Attempt(job, place, delivery, threads, stop, told), basis, order)
        done = replace(done, outcome=replace(done.outcome, wall_seconds=time.perf_counter() - started))
        if not is_here:
            done = replace(
                done, run=_packed(place.run_folder(done.outcome.run or job.name)), result=_bytes(place, done.outcome)
            )
    except Interrupted as error:
        raise error if is_here or folder is None else Interrupted(_packed(BatchFolder(folder).run_folder(job.name))) from None
    except (DmpError, OSError, MemoryError) as error:
        done = Done(replace(basis, failure=_reason(error), wall_seconds=time.perf_counter() - started))
    if own is not None:
        shutil.rmtree(own, ignore_errors=True)
    return done


def _reason(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return "There is not enough memory for this mesh here. Use a machine with more, or fewer workers at once."
    return str(error) if isinstance(error, DmpError) else f"{type(error).__name__}: {error}."


def _packed(folder: Path) -> bytes:
    return pack(folder) if folder.is_dir() else b""


def _bytes(place: BatchFolder, outcome: Outcome) -> bytes:
    return (place.folder / "results" / outcome.result).read_bytes() if outcome.result else b""


def _restore(attempt: _Attempt, basis: Outcome, order: Order) -> Done:
    from dmp.meshio import write_mesh

    job, place = attempt.job, attempt.place
    notes: tuple[str, ...] = ()
    result = place.result(job.name, order.suffix)
    result.parent.mkdir(parents=True, exist_ok=True)
    try:
        run, notes, first = _trained(attempt)
    except NoHolesError as error:
        # Nothing is wrong and there is nothing to do: as `dmp complete` does, the mesh is handed on as it is.
        mesh = _meshes(job, attempt.delivery)[0]
        write_mesh(result, mesh)
        drawn = _picture(mesh, mesh)
        return Done(
            replace(basis, vertices=mesh.n_vertices, faces=mesh.n_faces, notes=(str(error),), result=result.name), drawn
        )
    problem = run.problem()
    step, why = chosen_step(run, order.keep)
    restored = run.mesh_at(step)
    notes = (*notes, *write_mesh(result, restored))
    truth = problem.ground_truth
    rows = run.curve()
    outcome = replace(
        basis,
        vertices=restored.n_vertices,
        faces=restored.n_faces,
        steps=run.last_step,
        step=step,
        why=why,
        before={} if truth is None else _finite(truth.measures(problem.target)),
        after={} if truth is None else _finite(truth.measures(restored.vertices)),
        seconds=float(rows[-1]["seconds"]) if rows else 0.0,
        device=run.device or "",
        threads=run.recorded_threads or 0,
        resumed_from=first,
        notes=notes,
        result=result.name,
        run=run.folder.name,
    )
    return Done(outcome, _picture(problem.mesh, restored))


def _finite(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items() if math.isfinite(value)}


def _meshes(job: BatchJob, delivery: Delivery | None) -> tuple[TriangleMesh, TriangleMesh | None, tuple[str, ...]]:
    from dmp.meshio import read_mesh, read_mesh_with_notes

    if delivery is not None:
        return delivery.mesh, delivery.ground_truth, delivery.notes
    mesh, notes = read_mesh_with_notes(job.mesh)
    return mesh, None if job.ground_truth is None else read_mesh(job.ground_truth), tuple(notes)


def deliver(job: BatchJob, run: Path) -> Delivery:
    """Return what a worker needs that sees neither the files nor the run folder (raises :class:`MeshError`)."""
    mesh, truth, notes = _meshes(job, None)
    return Delivery(mesh, truth, notes, pack(run) if (run / "run.json").is_file() else b"")


def _trained(attempt: _Attempt) -> tuple[Run, tuple[str, ...], int]:
    """Train a job to its end; return its run, notes, and the step that this attempt went on from."""
    from dmp.runs import Run, is_run_folder, record

    job, stop = attempt.job, attempt.stop
    folder = _free_folder(attempt.place.run_folder(job.name), stop, attempt.told)
    notes: tuple[str, ...] = ()
    run: Run
    if is_run_folder(folder):
        run = Run.open(folder)
    else:
        # What a kill left behind while the folder was being made.
        shutil.rmtree(folder, ignore_errors=True)
        run, notes = _created(job, folder, attempt.delivery)
    first = 0
    if run.state != "finished" and run.last_step < job.settings.steps:
        training = run.resume()
        first = training.step
        if run.settings.threads == 0 and run.recorded_threads is None and attempt.threads:
            training.threads = attempt.threads
        with closing(record(training, run)) as records:  # type: ignore[type-var]
            for item in records:
                attempt.told(item.step / job.settings.steps)
                if stop():
                    raise Interrupted
    elif run.state == "interrupted":
        run.acknowledge()
    if run.is_in_memory:
        raise RunError(run.warnings[-1] if run.warnings else f"The run folder {folder} could not be written.")
    return run, notes, first


def _created(job: BatchJob, folder: Path, delivery: Delivery | None) -> tuple[Run, tuple[str, ...]]:
    from dmp.completion import problem_for
    from dmp.runs import Run

    mesh, truth, notes = _meshes(job, delivery)
    problem = problem_for(mesh, job.settings, truth)
    folder.parent.mkdir(parents=True, exist_ok=True)
    run = Run.create(
        problem, job.settings, folder=folder, input_path=job.mesh, ground_truth_path=job.ground_truth, name=job.mesh.stem
    )
    return run, (*notes, *problem.notes)


def _free_folder(folder: Path, stop: Stop, told: Told) -> Path:
    """Return the run folder of a job as soon as nobody else writes into it; after long waiting another one beside it.

    An attempt that was given up may be alive: a process that was halted, or a machine that was cut off. Its lock tells.
    """
    from dmp.run_files import RunLock
    from dmp.run_folder import RunFolder

    number = 1
    while True:
        candidate = folder if number == 1 else folder.with_name(f"{folder.name}_{number}")
        deadline = time.monotonic() + LOCK_PATIENCE_SECONDS
        while RunLock(RunFolder(candidate)).is_held_by_anyone():
            if stop():
                raise Interrupted
            if time.monotonic() > deadline:
                break
            # Who waits is not stalled.
            told(0.0)
            time.sleep(0.2)
        else:
            return candidate
        number += 1


def chosen_step(run: Run, keep: str) -> tuple[int, str]:
    """Return the step to save and why; steps that only an interruption kept are no candidates.

    So a job that was interrupted gives the same result as one that was not.

    Raises:
        RunError: when the run has no snapshot to save.
    """
    from dmp.stopping import suggest

    settings, last = run.settings, run.last_step
    if not last:
        raise RunError(f"The run in {run.folder} has no snapshots.")
    steps = [step for step in run.snapshot_steps() if step and (step % settings.snapshot_every == 0 or step == last)]
    rows = [row for row in run.curve() if row["step"] in (0, 1, *steps) or row["step"] % settings.log_every == 0]
    if keep == "last":
        return last, "The last step."
    if keep == "best":
        name = "hole_distance" if settings.task == "complete" else "mad"
        measured = [row for row in rows if name in row and row["step"] in steps]
        if measured:
            return int(min(measured, key=lambda row: row[name])["step"]), "The step closest to the ground truth."
    suggestion = suggest(rows, steps)
    return (last, "The last step.") if suggestion is None else (suggestion.step, suggestion.reason)


def _picture(before: TriangleMesh, after: TriangleMesh) -> bytes:
    """Return the input beside the result as a PNG on white."""
    from dmp.thumbnails import png_bytes, thumbnail

    drawn = [thumbnail(mesh, _PICTURE_SIDE, _PICTURE_SIDE, _COLOUR) for mesh in (before, after)]
    pixels: FloatArray = np.hstack(drawn).astype(np.float64)
    alpha = pixels[..., 3:] / 255
    return png_bytes((pixels[..., :3] * alpha + 255 * (1 - alpha)).round().astype(np.uint8))
