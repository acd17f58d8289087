"""One training on a worker that a window elsewhere watches: what runs over there.

The run folder over there is the truth. Whoever asks is told what is new since the last time; nothing is sent unasked, so
nothing piles up when a connection breaks, and the training goes on.
"""

from __future__ import annotations

import re
import threading
import time
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from dmp.errors import DmpError, RunError

# How much one answer carries, so that catching up after a break comes in pieces.
_MOST_ANSWER_BYTES = 16 * 2**20
_PAUSE_SECONDS = 0.05
_FINAL_FILES = ("run.json", "curve.csv", "checkpoint.pt")


@dataclass(eq=False)
class _Live:
    """A training that this process does, or did last.

    Attributes:
        attempt: another number for each attempt; rows of one may be repeated by the next.
        rows: its logged steps so far, each with ``step``, ``seconds`` and what was measured.
    """

    folder: Path
    attempt: float = field(default_factory=time.time)
    rows: list[dict[str, float]] = field(default_factory=list)
    step: int = 0
    seconds: float = 0.0
    device: str = ""
    error: str = ""
    warnings: list[str] = field(default_factory=list)
    may_run: threading.Event = field(default_factory=threading.Event)
    stop: threading.Event = field(default_factory=threading.Event)
    is_done: bool = False


@dataclass(frozen=True, eq=False)
class Answer:
    """What is new of a run over there.

    Attributes:
        state: ``training``, ``paused``, ``waiting`` (nobody does it right now), ``finished``, ``stopped`` or ``failed``.
        attempt: identifies the attempt; when it is another one, its rows are to be asked for from the beginning.
        step, seconds: how far it is.
        rows: the logged steps after those that are known.
        snapshots: content of files by step, after those that are known; not necessarily all.
        has_more: whether there are more snapshots, to be asked for at once.
        device: where it computes.
        error: why it failed.
        warnings: sentences about what could not be written over there.
    """

    state: str
    attempt: float = 0.0
    step: int = 0
    seconds: float = 0.0
    rows: tuple[dict[str, float], ...] = ()
    snapshots: tuple[tuple[int, bytes], ...] = ()
    has_more: bool = False
    device: str = ""
    error: str = ""
    warnings: tuple[str, ...] = ()


_LIVE: dict[str, _Live] = {}


def folder_over_there(name: str, run_id: str) -> Path:
    """Return the folder of a run among the runs of the user who started the worker."""
    from dmp.runs import default_runs_folder

    plain = re.sub(r"[^\w.-]+", "_", name).strip("._")[:60] or "mesh"
    return default_runs_folder() / f"{plain}_{run_id[:12]}"


def train_run(name: str, run_id: str, parcel: bytes, steps: int | None, workers_by_host: dict[str, int]) -> str:
    """Train a run on this worker, from its parcel or from what is left of an earlier attempt; return how it ended.

    Args:
        name: what to call its folder.
        run_id: of the run.
        parcel: its folder as :func:`dmp.batch.parcel.pack` made it.
        steps: train until this step instead of the one in its settings.
        workers_by_host: how many workers share the cores of a machine.
    """
    from dmp.batch.attending import one_at_a_time

    live = _LIVE[run_id] = _Live(folder_over_there(name, run_id))
    live.may_run.set()
    try:
        with one_at_a_time(live.stop.is_set) as is_our_turn:
            if is_our_turn:
                _train(live, run_id, parcel, steps, workers_by_host)
    except (DmpError, OSError, MemoryError) as error:
        live.error = str(error) if isinstance(error, DmpError) else f"{type(error).__name__}: {error}."
    except Exception as error:
        live.error = f"This is a fault of the program or of the worker: {type(error).__name__}: {error}."
    finally:
        live.is_done = True
    return live.error


def _train(live: _Live, run_id: str, parcel: bytes, steps: int | None, workers_by_host: dict[str, int]) -> None:
    from dmp.batch.attending import threads_here
    from dmp.batch.parcel import unpack
    from dmp.devices import device_description
    from dmp.run_files import RunLock
    from dmp.run_folder import RunFolder
    from dmp.runs import Run, is_run_folder, record

    while RunLock(RunFolder(live.folder)).is_held_by_anyone():
        # An attempt that was given up may be alive.
        if live.stop.wait(0.2):
            return
    if not is_run_folder(live.folder):
        if not parcel:
            raise RunError(f"{live.folder} is not there any more.")
        unpack(parcel, live.folder)
    run = Run.open(live.folder)
    if run.run_id != run_id:
        raise RunError(f"{live.folder} holds another run.")
    if run.state == "finished" and (steps is None or steps <= run.last_step):
        return
    training = run.resume(steps)
    if run.settings.threads == 0 and run.recorded_threads is None:
        training.threads = threads_here(workers_by_host)
    live.warnings = run.warnings
    live.device = device_description(training.device)
    live.rows = [dict(row) for row in run.curve() if row["step"] <= training.step] if training.step else []
    live.step, live.seconds = training.step, training.seconds
    with closing(record(training, run)) as records:  # type: ignore[type-var]
        for item in records:
            if item.metrics:
                live.rows.append({"step": item.step, "seconds": item.seconds, **item.metrics})
            live.step, live.seconds = item.step, item.seconds
            while not live.may_run.wait(_PAUSE_SECONDS) and not live.stop.is_set():
                pass
            if live.stop.is_set():
                return


def find(run_id: str, name: str) -> Path | None:
    """Return the folder of a run on this machine, None when it is not here."""
    from dmp.runs import Run, is_run_folder

    folder = folder_over_there(name, run_id)
    try:
        return folder if is_run_folder(folder) and Run.open(folder).run_id == run_id else None
    except RunError:
        return None


async def answer(run_id: str, name: str, attempt: float, since_step: int, since_snapshot: int) -> Answer | None:
    """Tell what is new of a run; None when it is not known here.

    Args:
        run_id: of the run.
        name: what its folder is called after.
        attempt: of the last answer; when it is another one by now, all rows are told.
        since_step: the last logged step that is known, -1 for none.
        since_snapshot: likewise the last snapshot.
    """
    import asyncio

    # The loop that everything else of this worker goes through must not wait for a disk.
    return await asyncio.to_thread(_answer, run_id, name, attempt, since_step, since_snapshot)


def _answer(run_id: str, name: str, attempt: float, since_step: int, since_snapshot: int) -> Answer | None:
    from dmp.run_folder import RunFolder
    from dmp.runs import Run

    live = _LIVE.get(run_id)
    folder = live.folder if live is not None else find(run_id, name)
    if folder is None:
        return None
    if live is not None and live.error:
        return Answer("failed", live.attempt, error=live.error)
    is_ours = live is not None and not live.is_done
    # Before the names: the mesh of a step is written before its row is there, so that the two arrive together.
    rows = list(live.rows) if live is not None and is_ours else []
    run: Run | None = None
    try:
        run = Run.open(folder)
        state, names = run.state, [step for step in run.snapshot_steps() if step > since_snapshot]
    except RunError as error:
        if not is_ours:
            return Answer("failed", error=str(error))
        state, names = "training", []
    if is_ours and live is not None:
        state, number = "training" if live.may_run.is_set() else "paused", live.attempt
        names = [step for step in names if rows and step <= rows[-1]["step"]]
    else:
        state, number = state if state in ("finished", "stopped", "failed") else "waiting", 0.0
        rows = run.curve() if run is not None else []
    known = since_step if number == attempt else -1
    snapshots: list[tuple[int, bytes]] = []
    for step in names:
        if sum(len(content) for _, content in snapshots) > _MOST_ANSWER_BYTES:
            break
        try:
            content = RunFolder(folder).read(f"snapshots/{step:06d}.npy", 2**33)
        except RunError:
            continue
        snapshots.append((step, content))
    step, seconds = (live.step, live.seconds) if live is not None else (0, 0.0)
    return Answer(
        state, number, step, seconds,
        tuple(row for row in rows if row["step"] > known),
        tuple(snapshots),
        bool(snapshots) and snapshots[-1][0] != names[-1],
        live.device if live is not None else (run.device or "" if run is not None else ""),
        run.reason if run is not None and state == "failed" else "",
        tuple(live.warnings) if live is not None else (),
    )  # fmt: skip


async def final_files(run_id: str, name: str) -> dict[str, bytes]:
    """Return the files of a run that has ended and that change while it is trained: description, curve and checkpoint."""
    import asyncio

    return await asyncio.to_thread(_final_files, run_id, name)


def _final_files(run_id: str, name: str) -> dict[str, bytes]:
    from dmp.run_folder import RunFolder

    folder = find(run_id, name)
    if folder is None:
        return {}
    found = {}
    for file in _FINAL_FILES:
        if RunFolder(folder).size(file) is not None:
            found[file] = RunFolder(folder).read(file, 2**34)
    return found


async def command(run_id: str, what: str) -> bool:
    """Let the training of a run ``pause``, ``resume`` or ``stop``; tell whether it is done here."""
    live = _LIVE.get(run_id)
    if live is None or live.is_done:
        return False
    if what == "pause":
        live.may_run.clear()
    elif what == "resume":
        live.may_run.set()
    elif what == "stop":
        live.stop.set()
        live.may_run.set()
    return True
