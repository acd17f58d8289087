"""The function that does one job and keeps its record; it can be called in any process that sees the folder."""

from __future__ import annotations

import platform
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import datetime
from typing import TYPE_CHECKING, Any

from dmp import __version__
from dmp.errors import DmpError, RunError
from dmp.experiments.cases import meshes_of
from dmp.experiments.jobs import Job
from dmp.experiments.store import Chosen, JobRecord, Store, as_columns

if TYPE_CHECKING:
    from dmp.mesh import FloatArray
    from dmp.problem import Problem
    from dmp.runs import Run

Stop = Callable[[], bool]
Told = Callable[[float], object]


class Interrupted(Exception):  # noqa: N818
    """A job was asked to stop before its end; what it has is kept and used next time."""


def do_job(
    job: Job,
    store: Store,
    *,
    threads: int = 0,
    stop: Stop = lambda: False,
    told: Told = lambda _share: None,
) -> JobRecord:
    """Do a job unless it is done, keep its record, and return it.

    An error that a person can cause becomes the record's ``failure``.

    Args:
        job: what to do.
        store: where the result is kept.
        threads: processor threads of a training; 0 for as many as there are cores.
        stop: asked after each training step.
        told: called now and then with the share that is done, 0 to 1.

    Raises:
        Interrupted: when ``stop`` said so.
        RunError: when nothing can be written.
    """
    kept = store.read(job)
    if kept is not None and not kept.failure:
        return kept
    from dmp.devices import available_cores

    started = time.perf_counter()
    try:
        if job.settings is not None:
            done = _train(job, store, threads, stop, told)
        elif job.filter_name is not None:
            done = _filter(job, store)
        else:
            done = _untouched(job, store)
    except DmpError as error:
        done = JobRecord(failure=str(error))
    facts = {
        "program": f"dmp {__version__}",
        "machine": f"{platform.machine()}, {available_cores()} cores",
        "date": f"{datetime.now().astimezone():%Y-%m-%d}",
        **done.facts,
    }
    done = replace(done, facts=facts, seconds=done.seconds or time.perf_counter() - started)
    store.write(job, done)
    return done


def problem_of(job: Job, store: Store) -> Problem:
    """Return the problem of a job; for those without a training that of the default settings."""
    from dmp.completion import problem_for
    from dmp.settings import settings_for

    mesh, truth = meshes_of(job.case, store.shapes_folder)
    return problem_for(mesh, job.settings or settings_for(job.case.task), truth)


def result_vertices(job: Job, store: Store, choice: str) -> FloatArray:
    """Return the positions (V, 3) of one of the results of a job that is done, for its picture.

    Raises:
        DmpError: when its run folder is gone.
    """
    from dmp.filters import filtered
    from dmp.runs import Run

    record = store.read(job)
    chosen = None if record is None else record.results.get(choice)
    if chosen is None:
        raise RunError(f"There is no result of {job.title}.")
    if job.settings is not None:
        return Run.open(store.run_folder(job)).mesh_at(chosen.step or 0).vertices
    problem = problem_of(job, store)
    return filtered(problem.mesh, job.filter_name, **(chosen.parameters or {})) if job.filter_name else problem.target


def _train(job: Job, store: Store, threads: int, stop: Stop, told: Told) -> JobRecord:
    from dmp.runs import Run, is_run_folder, record

    assert job.settings is not None
    folder = store.run_folder(job)
    if is_run_folder(folder):
        run = Run.open(folder)
    else:
        # What a kill left behind while the folder was being made.
        shutil.rmtree(folder, ignore_errors=True)
        settings = replace(job.settings, threads=threads or job.settings.threads)
        run = Run.create(problem_of(job, store), settings, folder=folder, name=job.title)
    if run.state != "finished" and run.last_step < job.settings.steps:
        records = record(run.resume(), run)
        try:
            for item in records:
                told(item.step / job.settings.steps)
                if stop():
                    raise Interrupted
        finally:
            records.close()  # type: ignore[attr-defined]
    if run.is_in_memory:
        raise RunError(run.warnings[-1] if run.warnings else f"The run folder {folder} could not be written.")
    return _outcome(run)


def _outcome(run: Run) -> JobRecord:
    from dmp.stopping import suggest

    problem, settings = run.problem(), run.settings
    last = run.last_step
    if not last:
        raise RunError(f"The run in {run.folder} has no snapshots.")
    # An interruption keeps its step as well, but must not change what is chosen or measured.
    steps = [step for step in run.snapshot_steps() if step and (step % settings.snapshot_every == 0 or step == last)]
    curve = [row for row in run.curve() if row["step"] in (0, 1, *steps) or row["step"] % settings.log_every == 0]
    name = "hole_distance" if settings.task == "complete" else "mad"
    best = int(min((row for row in curve if row["step"] in steps), key=lambda row: row[name])["step"])
    suggestion = suggest(curve, steps)
    chosen = {"with_truth": best, "without_truth": last if suggestion is None else suggestion.step, "last": last}
    measures = {step: _measures(problem, run.mesh_at(step).vertices) for step in sorted(set(chosen.values()))}
    return JobRecord(
        results={choice: Chosen(f"step {step}", measures[step], step=step) for choice, step in chosen.items()},
        curve=as_columns(curve),
        seconds=curve[-1]["seconds"],
        facts={
            "device": run.device,
            "threads": run.recorded_threads,
            "steps": int(curve[-1]["step"]),
            # What losses have to be multiplied with to be in mean edge lengths of the truth.
            "unit": problem.unit / problem.ground_truth.edge_length if problem.ground_truth is not None else None,
        },
    )


def _filter(job: Job, store: Store) -> JobRecord:
    from dmp.filters import filter_named, filtered, tuned
    from dmp.metrics import GroundTruth

    assert job.filter_name is not None
    problem = problem_of(job, store)
    assert isinstance(problem.ground_truth, GroundTruth)
    parameters: Mapping[str, Any]
    if job.is_tuned:
        found = tuned(problem.mesh, problem.ground_truth, job.filter_name)
        vertices, parameters = found.vertices, found.parameters
    else:
        parameters = filter_named(job.filter_name).checked({})
        vertices = filtered(problem.mesh, job.filter_name)
    what = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in parameters.items())
    choice = "with_truth" if job.is_tuned else "without_truth"
    return JobRecord(results={choice: Chosen(what, _measures(problem, vertices), parameters=dict(parameters))})


def _untouched(job: Job, store: Store) -> JobRecord:
    problem = problem_of(job, store)
    what = "as it is" if job.case.task == "denoise" else "holes filled, nothing else"
    return JobRecord(results={"without_truth": Chosen(what, _measures(problem, problem.target))})


def _measures(problem: Problem, vertices: FloatArray) -> dict[str, float]:
    from dmp.metrics import GroundTruth

    truth = problem.ground_truth
    assert truth is not None
    values = truth.full_measures(vertices) if isinstance(truth, GroundTruth) else truth.measures(vertices)
    return {name: float(value) for name, value in values.items()}
