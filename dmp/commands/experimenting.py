"""``dmp experiment``: the experiments of the paper, and some more, on any mesh with a ground truth."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar

from dmp.commands.common import EXIT_DONE, EXIT_INTERRUPTED, say
from dmp.commands.options import Quiet, Scheduler, TlsFile
from dmp.errors import SettingsError
from dmp.experiments.catalogue import EXPERIMENTS
from dmp.filters import FILTERS
from dmp.settings import SETTING_FIELDS, Preset, check, setting_value

if TYPE_CHECKING:
    from dmp.experiments.jobs import Job
    from dmp.experiments.running import Progress
    from dmp.experiments.store import JobRecord, Store

FilterName: Any = Literal[tuple(FILTERS)]
ExperimentName: Any = Literal[tuple(EXPERIMENTS)]


def experiment(
    name: Annotated[ExperimentName | None, Parameter(help="Which one; without a name they are listed.")] = None,
    /,
    *meshes: Annotated[
        Path,
        Parameter(
            help="Meshes to work on: files, folders with a 'noisy' and a 'ground_truth' mesh, or names of samples and of "
            "generated shapes. By default samples of this program."
        ),
    ],
    ground_truth: Annotated[
        list[Path] | None,
        Parameter(help="Clean versions of the mesh files, in the same order; without them the files are clean and get noise."),
    ] = None,
    noise: Annotated[
        Literal["normal", "gaussian", "uniform", "impulsive", "scanner"], Parameter(help="Kind of noise for clean meshes.")
    ] = "gaussian",
    level: Annotated[float, Parameter(help="Noise for clean meshes, in mean edge lengths.")] = 0.3,
    noise_seed: Annotated[int, Parameter(help="Seed of that noise.")] = 1,
    levels: Annotated[
        tuple[float, float], Parameter(help="Weak and strong noise of the learning curves, in mean edge lengths.")
    ] = (0.2, 0.6),
    seeds: Annotated[
        list[int] | None, Parameter(consume_multiple=True, help="Seeds of the trainings; tables show means [42].")
    ] = None,
    preset: Annotated[Preset, Parameter(help="Settings of Deep Mesh Prior; 'paper' are the published ones.")] = "compact",
    steps: Annotated[int | None, Parameter(help="Steps of each training; by default as the preset says.")] = None,
    set_: Annotated[
        list[str] | None,
        Parameter(name="--set", help="Another setting of Deep Mesh Prior, NAME=VALUE as in `dmp denoise --help`; repeatable."),
    ] = None,
    rivals: Annotated[
        list[FilterName] | None, Parameter(consume_multiple=True, help="Which filters to compare with; by default all.")
    ] = None,
    out: Annotated[
        Path, Parameter(help="Folder for records, runs, tables and pictures; results in it are not done again.")
    ] = Path("experiments"),
    jobs: Annotated[int, Parameter(help="Processes that work at once.")] = 1,
    threads: Annotated[int, Parameter(help="Processor threads of each training; 0 divides the cores among the processes.")] = 0,
    scheduler: Scheduler = "",
    tls_ca_file: TlsFile = None,
    tls_cert: TlsFile = None,
    tls_key: TlsFile = None,
    device: Annotated[str, Parameter(help="Where to train: auto, cpu, cuda or cuda:N.")] = "auto",
    tables_only: Annotated[bool, Parameter(help="Do nothing new: write the tables of what is done so far.")] = False,
    quiet: Quiet = False,
) -> int:
    """Repeat an experiment of the paper, or all of them, and write tables, charts and pictures.

    Interrupted, the same command goes on where it stopped. The report is OUT/report.md; each experiment has a folder with
    Markdown and CSV tables, PNG and SVG charts, and OUT/runs has a run folder for each training, which `dmp-viewer` opens.
    """
    if name is None:
        width = max(map(len, EXPERIMENTS))
        for item in EXPERIMENTS.values():
            print(f"{item.name:{width}}  {item.sentence}")
        return EXIT_DONE
    from dmp.batch.cluster import certificates
    from dmp.experiments.conducting import cases_from, experiment_named, jobs_for, plans_for, write_reports
    from dmp.experiments.plan import Plan
    from dmp.experiments.running import run_jobs
    from dmp.experiments.store import Store

    if jobs < 1 or threads < 0:
        raise SettingsError(f"--jobs must be 1 or more and --threads 0 or more, not {jobs} and {threads}.")
    if preset == "best":
        raise SettingsError("--preset best is in the tables anyway. Choose how Deep Mesh Prior is trained: compact or paper.")
    plan = Plan(
        cases=cases_from(meshes, ground_truth or [], noise, level, noise_seed),
        seeds=tuple(dict.fromkeys(seeds or [42])),
        preset=preset,
        steps=steps,
        filters=tuple(FILTERS if rivals is None else rivals),
        changes=_changes(set_ or []),
        noise=noise,
        levels=levels,
        device=device,
    )
    plans = plans_for(experiment_named(name), plan)
    todo, store = jobs_for(plans), Store(out)
    finished = tables_only
    if not tables_only:
        with _shown(todo, store, jobs, quiet) as told:
            finished = run_jobs(
                todo, store, n_processes=jobs, threads=threads, scheduler=scheduler,
                tls=certificates(tls_ca_file, tls_cert, tls_key), told=told,
            )  # fmt: skip
    if not finished:
        n_done = sum(store.is_done(job) for job in todo)
        say(f"Stopped with {n_done} of {len(todo)} jobs done. The same command goes on from here.", quiet)
        return EXIT_INTERRUPTED
    say("Writing tables and pictures …", quiet)
    page = write_reports(plans, store, shlex.join(["dmp", *sys.argv[1:]]) if sys.argv[1:2] == ["experiment"] else "")
    n_failed = sum(not store.is_done(job) for job in todo)
    if n_failed:
        say(f"{n_failed} of {len(todo)} jobs have no result; below the tables stands why.", quiet)
    print(page)
    return EXIT_DONE


experiment.__doc__ = "\n".join(
    [f"{experiment.__doc__}\n", *(f"- **{item.name}**: {item.sentence}" for item in EXPERIMENTS.values())]
)


def _changes(texts: Sequence[str]) -> dict[str, Any]:
    """Return the settings in texts such as ``laplacian_weight=0.2``."""
    found: dict[str, Any] = {}
    for text in texts:
        name, separator, value = text.partition("=")
        name = name.strip().removeprefix("--").replace("-", "_")
        if not separator or name not in SETTING_FIELDS:
            raise SettingsError(
                f"--set {text}: it must be NAME=VALUE with the name of a setting, such as laplacian-weight=0.2."
            )
        if name in ("task", "preset", "seed", "steps", "device", "threads"):
            raise SettingsError(f"--set {text}: this has an option of its own.")
        found[name] = check(name, setting_value(value.strip()))
    return found


class _Clock:
    """Foresees the time left from the share of the work that is done since the start."""

    def __init__(self, todo: Sequence[Job]) -> None:
        self._work = {job.name: job.work for job in todo}
        self._shares = dict.fromkeys(self._work, 0.0)
        self._first: dict[str, float] = {}
        self._started = time.monotonic()

    def note(self, job: Job, share: float) -> None:
        """Take note that ``share`` of a job is done."""
        # A training that goes on where it stopped has not done its first part in this session.
        if 0.0 < share < 1.0:
            self._first.setdefault(job.name, share)
        self._shares[job.name] = share

    @property
    def share(self) -> float:
        """The share of all work that is done, 0 to 1."""
        total = sum(self._work.values())
        return sum(self._work[name] * share for name, share in self._shares.items()) / total if total else 1.0

    @property
    def seconds_left(self) -> float | None:
        """How long it will take, or None while that cannot be told."""
        fresh = sum(self._work[name] * (share - self._first.get(name, 0.0)) for name, share in self._shares.items())
        left = sum(self._work[name] * (1 - share) for name, share in self._shares.items())
        elapsed = time.monotonic() - self._started
        return left * elapsed / fresh if fresh > 0 and elapsed > 1 else None


def _in_words(seconds: float | None) -> str:
    if seconds is None:
        return ""
    if seconds < 90:
        return f"about {max(1, round(seconds))} s left"
    return f"about {round(seconds / 60)} min left" if seconds < 5400 else f"about {seconds / 3600:.1f} h left"


@contextmanager
def _shown(todo: Sequence[Job], store: Store, n_processes: int, quiet: bool) -> Iterator[Any]:
    """Yield what shows progress: a bar on a terminal, elsewhere a line for each job that is done."""
    waiting = [job for job in todo if not store.is_done(job)]
    at_once = f", {n_processes} at once" if n_processes > 1 else ""
    say(f"{len(todo)} jobs, {len(todo) - len(waiting)} of them done before{at_once}. Results: {store.folder}", quiet)
    clock, n_done = _Clock(waiting), len(todo) - len(waiting)
    console = Console(stderr=True, highlight=False, quiet=quiet, soft_wrap=True)
    columns = (
        BarColumn(), TextColumn("{task.fields[counted]}"), TimeElapsedColumn(), TextColumn("{task.fields[left]}"),
        TextColumn("{task.description}", markup=False),
    )  # fmt: skip
    with Bar(*columns, console=console, disable=not console.is_terminal or quiet) as bar:
        task = bar.add_task("", total=1.0, counted="", left="")

        def told(progress: Progress) -> None:
            nonlocal n_done
            clock.note(progress.job, progress.share)
            if progress.record is not None:
                n_done += 1
            counted = f"{n_done}/{len(todo)}"
            bar.update(
                task, completed=clock.share, counted=counted, left=_in_words(clock.seconds_left), description=progress.job.title
            )
            if progress.record is not None:
                line = f"{counted}  {progress.job.title}: {_outcome(progress.record)}"
                left = "" if console.is_terminal else _in_words(clock.seconds_left)
                bar.console.print(line + (f"  ({left})" if left and n_done < len(todo) else ""), markup=False)

        yield told


def _outcome(record: JobRecord) -> str:
    if record.failure:
        return record.failure
    chosen = record.results.get("with_truth") or record.results["without_truth"]
    texts = {"mad": "MAD {:.2f}", "hole_distance": "distance {:.3f}"}
    found = [text.format(chosen.measures[name]) for name, text in texts.items() if name in chosen.measures]
    return ", ".join([*found, chosen.what, f"{record.seconds:.0f} s"])
