"""``dmp batch`` and ``dmp serve``: many meshes, and other machines."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from dmp.commands.common import EXIT_DONE, EXIT_INTERRUPTED, say
from dmp.commands.options import PLACE, DenoiseOptions, Quiet, Scheduler, TlsFile, given
from dmp.durations import duration
from dmp.errors import SettingsError
from dmp.interruption import interruption
from dmp.settings import settings_for

if TYPE_CHECKING:
    from dmp.batch.conducting import Watcher
    from dmp.batch.folder import Outcome
    from dmp.batch.jobs import BatchJob

EXIT_FAILURES = 3


def batch(
    *sources: Annotated[
        str,
        Parameter(help="Mesh files, folders, patterns such as 'scans/*.ply', or CSV tables (mesh, ground_truth, settings)."),
    ],
    out: Annotated[Path, Parameter(help="Folder for run folders, results and summaries; what is done in it is skipped.")],
    ground_truth: Annotated[Path | None, Parameter(help="Folder with clean meshes of the same names, to measure by.")] = None,
    task: Annotated[Literal["denoise", "complete"], Parameter(help="What to do: remove noise, or fill holes.")] = "denoise",
    keep: Annotated[
        Literal["auto", "last", "best"], Parameter(help="Which step to save: suggested, last, or best (by ground truth).")
    ] = "auto",
    format_: Annotated[
        Literal["ply", "obj", "stl", "off", "vtp"], Parameter(name="--format", help="File format of the restored meshes.")
    ] = "ply",
    scheduler: Scheduler = "",
    jobs: Annotated[int, Parameter(group=PLACE, help="Worker processes on this computer; 0 chooses by itself.")] = 0,
    tls_ca_file: TlsFile = None,
    tls_cert: TlsFile = None,
    tls_key: TlsFile = None,
    patience: Annotated[
        float, Parameter(group=PLACE, help="Minutes to wait for a scheduler or workers that are gone, before giving up.")
    ] = 5.0,
    stall: Annotated[
        float, Parameter(group=PLACE, help="Minutes without any step after which a worker is started anew.")
    ] = 15.0,
    options: DenoiseOptions = None,
    quiet: Quiet = False,
) -> int:
    """Restore many meshes: one run folder for each, the results, and a summary with pictures.

    Interrupted, the same command goes on where it stopped. A mesh that cannot be restored does not hold up the others: OUT has
    summary.csv, summary.md and summary.html, which say what was done, what failed and why. Exit code 3: something failed.

    With --device cuda each job goes to a worker that has a GPU of its own ('dmp serve' starts them so).
    """
    from dmp.batch.cluster import certificates
    from dmp.batch.conducting import Place, run_batch
    from dmp.batch.jobs import jobs_from_files
    from dmp.batch.summary import MARKDOWN, write_summary

    if jobs < 0 or patience < 0 or stall <= 0:
        raise SettingsError("--jobs and --patience must be 0 or more, and --stall more than 0.")
    named = given(options)
    settings = settings_for(task, **named)
    todo = jobs_from_files(sources, settings, ground_truth, named)
    if keep == "best" and not all(job.ground_truth for job in todo):
        raise SettingsError("--keep best needs a ground truth for each mesh. Use --keep auto without one.")
    gpu = bool(scheduler) and any(job.settings.device == "cuda" for job in todo)
    place = Place(scheduler, certificates(tls_ca_file, tls_cert, tls_key), jobs, settings.threads, gpu)
    with interruption() as stop, _shown(todo, out, quiet) as watcher:
        counted = run_batch(
            todo, out, place, suffix=f".{format_}", keep=keep, stop=stop, watcher=watcher,
            patience_seconds=60 * patience, stall_seconds=60 * stall,
        )  # fmt: skip
    page = write_summary(todo, out)
    failed = _failed(todo, out)
    if failed:
        say(f"{failed} of {len(todo)} jobs failed, see {MARKDOWN}; the same command tries them again.", quiet)
    print(page)
    if counted.interrupted:
        say("Stopped. The same command goes on from here.", quiet)
        return EXIT_INTERRUPTED
    return EXIT_FAILURES if failed else EXIT_DONE


def _failed(jobs: list[BatchJob], out: Path) -> int:
    from dmp.batch.folder import BatchFolder

    return sum(bool(outcome.failure) for _, outcome in BatchFolder(out).outcomes(job.name for job in jobs))


def serve(
    *,
    host: Annotated[
        str, Parameter(help="Address to listen on. Whoever reaches it can run any program as you; read docs/batch.md before.")
    ] = "127.0.0.1",
    port: Annotated[int, Parameter(help="Port of the scheduler.")] = 8786,
    workers: Annotated[
        int, Parameter(help="Worker processes that use the processor; by default one a core without a GPU.")
    ] = 0,
    gpus: Annotated[bool, Parameter(negative="--no-gpus", help="A worker for each GPU.")] = True,
    tls_ca_file: TlsFile = None,
    tls_cert: TlsFile = None,
    tls_key: TlsFile = None,
) -> int:
    """Lend this computer's GPUs and cores: start a scheduler with workers, for 'dmp batch --scheduler' and the window.

    It listens on this computer only, unless --host says otherwise; from elsewhere it is reached through an SSH tunnel:
    ssh -L 8786:127.0.0.1:8786 SERVER dmp serve
    """
    from dmp.batch.cluster import certificates
    from dmp.batch.serving import Service, serving

    if not 0 <= port <= 65535 or workers < 0:
        raise SettingsError(f"--port must be 0 to 65535 and --workers 0 or more, not {port} and {workers}.")
    tls = certificates(tls_ca_file, tls_cert, tls_key)
    if host not in ("127.0.0.1", "localhost", "::1") and tls is None:
        say(f"Warning: whoever can reach {host}:{port} can run any program on this computer as you. Use TLS, or a tunnel.")
    with interruption() as stop, serving(Service(host, port, workers, gpus, tls)) as (address, words):
        kinds = ", ".join(f"{words.count(kind)} × {kind}" for kind in dict.fromkeys(words))
        print(f"Scheduler: {address}\nWorkers: {kinds}\nCtrl-C ends it; trainings keep what they learnt.", flush=True)
        while not stop.wait(0.5):
            pass
        say("Ending …")
    return EXIT_DONE


class _Clock:
    """Foresees the time left from the share of the work that was done since the start."""

    def __init__(self, todo: list[BatchJob]) -> None:
        self._work = {job.name: job.work for job in todo}
        self._under_way: dict[str, tuple[float, float]] = {}
        self._done = self._fresh = 0.0
        self._total = sum(self._work.values()) or 1.0
        self._started = time.monotonic()

    def begin(self) -> None:
        """Count the time from now on: workers are there."""
        self._started = time.monotonic()

    def note(self, name: str, share: float) -> None:
        """Take note that ``share`` of a job is done; what an earlier call of the command did is not counted as fast work."""
        first = self._under_way.get(name, (share, 0.0))[0]
        self._under_way[name] = (min(first, share), share)

    def end(self, name: str) -> None:
        """Take note that a job has ended."""
        first = self._under_way.pop(name, (0.0, 0.0))[0]
        self._done += self._work[name]
        self._fresh += self._work[name] * (1 - first)

    @property
    def share(self) -> float:
        """The share of all work that is done, 0 to 1."""
        return (self._done + sum(self._work[name] * now for name, (_, now) in self._under_way.items())) / self._total

    @property
    def left(self) -> str:
        """How long it will take, in words; empty while that cannot be told."""
        fresh = self._fresh + sum(self._work[name] * (now - first) for name, (first, now) in self._under_way.items())
        elapsed = time.monotonic() - self._started
        if fresh <= 0 or elapsed < 2 or self.share >= 1:
            return ""
        seconds = (1 - self.share) * self._total * elapsed / fresh
        return f"about {duration(max(1.0, seconds))} left"


@contextmanager
def _shown(todo: list[BatchJob], out: Path, quiet: bool) -> Iterator[Watcher]:
    """Yield who shows progress: a bar on a terminal, elsewhere a line for each job that ended."""
    from dmp.batch.conducting import Watcher
    from dmp.batch.folder import BatchFolder
    from dmp.batch.summary import measures

    store = BatchFolder(out)
    waiting = [job for job in todo if not store.is_done(job.name)]
    n_ended = len(todo) - len(waiting)
    say(f"{len(todo)} job{'s' if len(todo) != 1 else ''}, {n_ended} of them done before. Results: {out}", quiet)
    clock = _Clock(waiting)
    console = Console(stderr=True, highlight=False, quiet=quiet, soft_wrap=True)
    columns = (BarColumn(), TextColumn("{task.fields[counted]}"), TimeElapsedColumn(), TextColumn("{task.fields[left]}"))
    with Progress(*columns, console=console, disable=not console.is_terminal or quiet) as bar:
        line = bar.add_task("", total=1.0, counted=f"{n_ended}/{len(todo)}", left="")

        def update() -> None:
            bar.update(line, completed=clock.share, counted=f"{n_ended}/{len(todo)}", left=clock.left)

        def began(count: int) -> None:
            clock.begin()
            bar.console.print(f"{count} worker{'s' if count != 1 else ''}.", markup=False)

        def told(name: str, share: float) -> None:
            clock.note(name, share)
            update()

        def ended(name: str, outcome: Outcome) -> None:
            nonlocal n_ended
            n_ended += 1
            clock.end(name)
            update()
            left = f"  ({clock.left})" if clock.left and not console.is_terminal else ""
            facts = [measures(outcome), f"step {outcome.step}", duration(outcome.wall_seconds)]
            what = outcome.failure or ", ".join(fact for fact in facts if fact)
            bar.console.print(f"{n_ended}/{len(todo)}  {name}: {what}{left}", markup=False)

        yield Watcher(began, told, ended, lambda text: bar.console.print(text, markup=False))
