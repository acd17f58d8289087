"""One training on a worker elsewhere, watched from here: its run folder here becomes a copy of the one over there.

What arrives is what a training here would yield, so whoever shows trainings need not know where they are done. The copy is
an ordinary run folder: it can be looked at, exported from and reopened when the connection is gone, and says where its
training is (:data:`LINK`).
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmp.batch.asking import Workers, start_anew
from dmp.batch.cluster import GPU, Certificates, ClusterError, connect, full_address, wait_for_workers
from dmp.batch.parcel import pack
from dmp.batch.remote_worker import Answer, answer, command, final_files, train_run
from dmp.batch.versions import check_versions
from dmp.errors import DmpError, RunError, TrainingError
from dmp.files import atomic_write_bytes, in_words
from dmp.run_files import CURVE, curve_text
from dmp.run_folder import RunFolder
from dmp.run_manifest import read_manifest
from dmp.runs import Run
from dmp.snapshot import Snapshot, StepRecord

if TYPE_CHECKING:
    from distributed import Client

LINK = "remote.json"
_POLL_SECONDS = 0.15
_ANSWER_SECONDS, _COMMAND_SECONDS = 20.0, 5.0
# A worker that trains the run and did not answer for so long is started anew.
_STALL_SECONDS = 60.0
# After so long without a step a worker that answers is told of as well.
_STILL_SECONDS = 300.0
_RETRY_SECONDS = 1.0
# So long a run that nobody trains over there waits to be taken up by another worker before it is handed out anew.
_ORPHAN_SECONDS = 45.0
_STOP_SECONDS = 60.0
_ENDED = ("finished", "stopped", "failed")


@dataclass(frozen=True)
class Link:
    """Where a run is trained: the address of a scheduler, and what the run's folder over there is called after."""

    address: str
    name: str


def read_link(folder: Path) -> Link | None:
    """Return where the training of a run folder is, None for one that is nowhere else."""
    try:
        values = json.loads((folder / LINK).read_text(encoding="utf-8"))
        # Whatever stands there is only ever connected to when a person says so.
        return Link(full_address(str(values["address"])), str(values["name"]))
    except (OSError, ValueError, KeyError, TypeError, ClusterError):
        return None


def forget_link(folder: Path) -> None:
    """Let a run folder belong to this computer alone."""
    with suppress(OSError):
        (folder / LINK).unlink()


def reach(link: Link, tls: Certificates | None = None) -> tuple[Client, tuple[str, ...]]:
    """Connect, and compare the versions at both ends, before anything is made or begun.

    Returns:
        The connection, and sentences on what may change the last digits.

    Raises:
        ClusterError: when nobody answers, there is no worker, or a version differs that must not.
    """
    client = connect(link.address, tls)
    try:
        return client, _checked(client, link.address)
    except BaseException:
        _close(client)
        raise


def _checked(client: Client, address: str) -> tuple[str, ...]:
    if not wait_for_workers(client, 10.0):
        raise ClusterError(f"There is no worker at {address}. Start one over there: dmp serve.")
    return check_versions(client)


@dataclass(frozen=True)
class _Silence:
    """A worker that does not answer: which one, since when by our clock, and the attempt that it was at."""

    worker: str
    since: float
    attempt: float


class RemoteTraining:
    """A run that is trained elsewhere.

    Args:
        run: its copy here, opened from its folder.
        link: where it is.
        client: the connection to it, from :func:`reach`.
        tls: files for an encrypted connection.
        steps: train until this step instead of the one in its settings.

    Attributes:
        warnings: sentences about the connection, and about what is wrong over there.
        device: where it computes, as far as it is known.
    """

    def __init__(
        self, run: Run, link: Link, client: Client, *, tls: Certificates | None = None, steps: int | None = None
    ) -> None:
        self.run, self.link = run, link
        self.warnings: list[str] = run.warnings
        self.device = ""
        self._tls, self._steps = tls, steps
        self._client: Client | None = client
        self._worker: str | None = None
        self._stays = threading.Event()
        self._attempt = -1.0
        self._rows = {int(row["step"]): row for row in run.curve()}
        self._told: set[str] = set()
        self._orphan_since: float | None = None
        self._silence: _Silence | None = None
        # The attempt and its last step, and since when it is that one.
        self._still = ((-1.0, -1), 0.0)
        self._workers = Workers()
        self._is_lost = self._is_held = False
        self._problem = run.problem()

    # -- beginning ------------------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Send the run over there and have it trained (raises :class:`DmpError`)."""
        self._write_link()
        self._submit(pack(self.run.folder, without_snapshots=True))

    def attach(self) -> None:
        """Find the run over there again; go on from its copy here when it is known to nobody any more."""
        self._command("resume")
        if self._ask() is None:
            self._submit(pack(self.run.folder, without_snapshots=True))

    def _submit(self, parcel: bytes) -> None:
        from distributed import fire_and_forget

        client = self._client
        assert client is not None
        hosts: dict[str, int] = {}
        workers = client.scheduler_info(n_workers=-1)["workers"].values()
        for worker in workers:
            hosts[worker["host"]] = hosts.get(worker["host"], 0) + 1
        has_gpus = any(worker["resources"].get(GPU, 0) for worker in workers)
        wants_gpu = has_gpus and self.run.settings.device != "cpu"
        future = client.submit(
            train_run, self.link.name, self.run.run_id, parcel, self._steps, hosts,
            key=f"dmp-run-{self.run.run_id}-{time.time():.3f}", pure=False,
            resources={GPU: 1} if wants_gpu else None,
        )  # fmt: skip
        # It goes on when we are gone.
        fire_and_forget(future)

    def _write_link(self) -> None:
        content = json.dumps({"address": self.link.address, "name": self.link.name}).encode()
        try:
            atomic_write_bytes(self.run.folder / LINK, content)
        except OSError as error:
            raise RunError(f"{self.run.folder / LINK} cannot be written: {in_words(error)}.") from error

    # -- while it goes on -------------------------------------------------------------------------------------------------

    def leave(self) -> None:
        """Let the training go on over there when :meth:`records` is closed."""
        self._stays.set()

    def hold(self, paused: bool) -> None:
        """Pause or resume the training over there, without waiting for an answer."""
        self._is_held = paused
        what = "pause" if paused else "resume"
        threading.Thread(target=self._command, args=(what,), daemon=True).start()

    def records(self) -> Iterator[StepRecord]:
        """Yield the records of the training as they arrive, those that were missed included.

        A broken connection is told in ``warnings``, and tried to be made again; meanwhile the last record is repeated now and
        then. Closing the iterator stops the training over there, unless :meth:`leave` was called before.

        Raises:
            TrainingError: when the training failed over there.
        """
        known = self.run.snapshot_steps()
        since_snapshot = max(known) if known else -1
        newest = self._rows[max(self._rows)] if self._rows else {"step": 0, "seconds": 0.0}
        last = StepRecord(int(newest["step"]), newest["seconds"])
        try:
            while True:
                found = self._answer(since_snapshot)
                if found is None:
                    yield last
                    continue
                for record in self._taken(found):
                    if record.snapshot is not None:
                        since_snapshot = max(since_snapshot, record.step)
                    last = StepRecord(record.step, record.seconds)
                    yield record
                if found.has_more:
                    continue
                if found.state in _ENDED:
                    break
                if found.state == "paused" and not self._is_held:
                    # The word to go on was lost with a connection.
                    self._command("resume")
                time.sleep(_POLL_SECONDS)
        except GeneratorExit:
            self._end_early(since_snapshot)
            raise
        else:
            self._write_curve()
            self._finish(found)
        finally:
            self._write_curve()
            client, self._client = self._client, None
            if client is not None:
                _close(client)

    def _taken(self, found: Answer) -> Iterator[StepRecord]:
        """Write what an answer brought, and yield it as records in order of their steps."""
        # Another attempt makes steps after its checkpoint again; what is known of them may stay, because it is the same.
        self._attempt = found.attempt
        self.device = found.device or self.device
        for text in found.warnings:
            if text not in self._told:
                self._told.add(text)
                self.warnings.append(f"{self.link.address}: {text}")
        fresh = [row for row in found.rows if int(row["step"]) not in self._rows]
        self._rows.update({int(row["step"]): row for row in found.rows})
        meshes = {step: self._kept(step, content) for step, content in found.snapshots}
        if meshes:
            self._write_curve()
        steps = {int(row["step"]) for row in fresh} | {step for step, mesh in meshes.items() if mesh is not None}
        for step in sorted(steps):
            row = self._rows.get(step, {"step": step, "seconds": 0.0})
            metrics = {name: value for name, value in row.items() if name not in ("step", "seconds")}
            mesh = meshes.get(step)
            if mesh is not None:
                mesh = replace(mesh, metrics=metrics, seconds=row["seconds"])
            yield StepRecord(step, row["seconds"], metrics, mesh)
        if found.step > max(steps, default=-1) and found.state not in _ENDED:
            yield StepRecord(found.step, found.seconds)

    def _kept(self, step: int, content: bytes) -> Snapshot | None:
        """Write a snapshot as it came, and return it; None with a warning when it cannot be."""
        name = f"snapshots/{step:06d}.npy"
        files = RunFolder(self.run.folder)
        try:
            (self.run.folder / "snapshots").mkdir(exist_ok=True)
            atomic_write_bytes(self.run.folder / name, content, follow_link=False)
            displacement = files.read_array(name, (len(self._problem.base), 3))
        except (OSError, RunError) as error:
            self._warn_once(f"A snapshot that came from {self.link.address} cannot be kept: {_words(error)}.")
            return None
        return Snapshot(self.run.run_id, step, self._problem.base + displacement)

    def _write_curve(self) -> None:
        rows = [self._rows[step] for step in sorted(self._rows)]
        if rows:
            try:
                atomic_write_bytes(self.run.folder / CURVE, curve_text(rows).encode())
            except OSError as error:
                self._warn_once(f"The curve cannot be written to {self.run.folder}: {in_words(error)}.")

    # -- asking -----------------------------------------------------------------------------------------------------------

    def _answer(self, since_snapshot: int) -> Answer | None:
        """Return what is new; None after a while without an answer, with the connection made again if it was lost."""
        if self._is_lost and not self._reconnected():
            return None
        found = self._ask(since_snapshot)
        self._look_after_worker(found)
        if found is None:
            if not self._is_connected():
                self._lose()
            time.sleep(_POLL_SECONDS)
            self._take_up_orphan(None)
            return None
        self._take_up_orphan(found)
        if found.state in _ENDED and self._is_pending():
            # That was an earlier attempt; the one that was asked for has not begun, or not told its end yet.
            time.sleep(_POLL_SECONDS)
            return replace(found, state="waiting")
        return found

    def _look_after_worker(self, found: Answer | None) -> None:
        """Tell of a worker that makes no steps; have one that does not even answer started anew when it stays so."""
        silence, client, now = self._silence, self._client, time.monotonic()
        mark = (-1.0, -1) if found is None or found.state != "training" else (found.attempt, found.step)
        if mark != self._still[0]:
            self._still = (mark, now)
        elif mark[0] >= 0 and now - self._still[1] > _STILL_SECONDS:
            self._warn_once(
                f"The worker at {self.link.address} answers, but has made no step for {_STILL_SECONDS / 60:.0f} minutes, at "
                f"step {mark[1]:,}. Wait, or stop the training and go on with it elsewhere."
            )
        if silence is None:
            return
        if found is not None and found.state not in ("waiting", "failed"):
            self._silence = None
            what = "answers again" if found.attempt == silence.attempt else "is replaced, and the training goes on"
            self.warnings.append(f"The worker at {self.link.address} {what}.")
        elif now - silence.since > _STALL_SECONDS and client is not None and client.status == "running":
            self._silence = replace(silence, since=now)
            start_anew(client, silence.worker)

    def _take_up_orphan(self, found: Answer | None) -> None:
        """Hand the run out anew when its worker is gone and no other one has taken it up."""
        if self._is_lost or (found is not None and found.state != "waiting"):
            self._orphan_since = None
            return
        now = time.monotonic()
        self._orphan_since = self._orphan_since or now
        if now - self._orphan_since > _ORPHAN_SECONDS and not self._is_pending():
            self._orphan_since = None
            self._warn_once(
                f"The worker that trained the run is gone; it goes on from its last checkpoint at {self.link.address}."
            )
            with suppress(Exception):
                self._submit(pack(self.run.folder, without_snapshots=True))

    def _is_pending(self) -> bool:
        """Tell whether the scheduler has the run on its list."""
        client, name = self._client, f"dmp-run-{self.run.run_id}"
        try:
            assert client is not None
            return bool(client.run_on_scheduler(_is_on_list, name))
        except Exception:  # an answer of whatever kind of trouble is no answer
            return True

    def _ask(self, since_snapshot: int = -1) -> Answer | None:
        since = max(self._rows) if self._rows else -1
        known = self._worker
        arguments = (self.run.run_id, self.link.name, self._attempt, since, since_snapshot)
        answers = self._call(answer, *arguments, workers=None if known is None else [known], seconds=_ANSWER_SECONDS)
        found = {worker: item for worker, item in answers.items() if isinstance(item, Answer)}
        if not found:
            if known is not None and not answers and self._is_connected():
                self._note_silence(known)
            self._worker = None
            return None
        # Workers of one machine see the same folder; one of them is doing the work.
        worker = min(found, key=lambda item: (found[item].state not in ("training", "paused"), item))
        self._worker = worker if found[worker].state in ("training", "paused") else None
        return found[worker]

    def _note_silence(self, worker: str) -> None:
        """Tell that the worker which trains the run does not answer, unless it is only gone from the scheduler's list."""
        client = self._client
        if self._silence is not None or client is None or worker not in self._workers.present(client):
            return
        self._silence = _Silence(worker, time.monotonic(), self._attempt)
        self.warnings.append(
            f"The worker at {self.link.address} that trains this run does not answer. If it stays so for {_STALL_SECONDS:.0f} "
            "seconds, it is started anew and the training goes on from its last checkpoint."
        )

    def _command(self, what: str) -> bool:
        """Let the training ``pause``, ``resume`` or ``stop`` over there; tell whether the one who does it was reached."""
        answers = self._call(command, self.run.run_id, what, seconds=_COMMAND_SECONDS, everybody=True)
        return any(value is True for value in answers.values())

    def _call(self, function: Callable[..., Any], *arguments: Any, **how: Any) -> dict[str, Any]:
        """Ask workers as :meth:`dmp.batch.asking.Workers.ask` does; return their answers, none when the connection is gone."""
        client = self._client
        if client is None or client.status != "running":
            return {}
        try:
            return self._workers.ask(client, function, *arguments, **how)
        except Exception:  # the connection broke, or the worker went: the next look tells which
            self._worker = None
            return {}

    def _is_connected(self) -> bool:
        client = self._client
        if client is None or client.status != "running":
            return False
        try:
            client.sync(client.scheduler.identity, callback_timeout=3)
        except Exception:  # of whatever kind: nobody answers
            return False
        return True

    def _lose(self) -> None:
        if not self._is_lost:
            self._is_lost = True
            self.warnings.append(
                f"The connection to {self.link.address} is lost. The training goes on over there; trying to connect again …"
            )
        if self._client is not None:
            _close(self._client)
            self._client = None

    def _reconnected(self) -> bool:
        try:
            self._client = connect(self.link.address, self._tls, timeout=2.0)
        except ClusterError:
            time.sleep(_RETRY_SECONDS)
            return False
        self._is_lost, self._worker = False, None
        self.warnings.append(f"The connection to {self.link.address} is there again, and nothing is missing.")
        return True

    def _warn_once(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self.warnings.append(text)

    # -- ending -----------------------------------------------------------------------------------------------------------

    def _end_early(self, since_snapshot: int) -> None:
        if self._stays.is_set():
            return
        stopped = self._command("stop")
        deadline = time.monotonic() + _STOP_SECONDS
        while time.monotonic() < deadline and not self._is_lost:
            found = self._answer(since_snapshot)
            if found is None:
                if self._is_lost:
                    break
                continue
            for record in self._taken(found):
                if record.snapshot is not None:
                    since_snapshot = max(since_snapshot, record.step)
            if found.state in _ENDED and not found.has_more:
                self._write_curve()
                self._finish(found)
                return
            if not stopped:
                stopped = self._command("stop")
            time.sleep(_POLL_SECONDS)
        self._is_lost = True
        self.warnings.append(
            f"{self.link.address} does not answer, so the training goes on over there. Open this run again to find it."
        )

    def _finish(self, found: Answer) -> None:
        """Take over what is changed last over there: description, curve and checkpoint. From then on nothing is elsewhere."""
        files: dict[str, bytes] = {}
        for item in self._call(final_files, self.run.run_id, self.link.name).values():
            if isinstance(item, dict) and len(item) > len(files):
                files = item
        client, self._client = self._client, None
        if client is not None:
            _close(client)
        try:
            # The description last: it says that the rest is there.
            for name in sorted(files, key=lambda name: name == "run.json"):
                if name in ("run.json", CURVE, "checkpoint.pt"):
                    atomic_write_bytes(self.run.folder / name, files[name], follow_link=False)
            if "run.json" in files:
                _read_again(self.run)
                forget_link(self.run.folder)
        except (OSError, DmpError) as error:
            self.warnings.append(f"The end of the run cannot be written to {self.run.folder}: {_words(error)}.")
        if found.state == "failed":
            raise TrainingError(found.error or f"The training failed at {self.link.address}.")


def _read_again(run: Run) -> None:
    """Let a run take over what its description says by now."""
    run._manifest, run.settings, _ = read_manifest(RunFolder(run.folder))


def _is_on_list(name: str, dask_scheduler: Any = None) -> bool:
    """Tell whether a task whose key begins so is waited for, asked of the scheduler."""
    return any(
        str(key).startswith(name) and task.state in ("processing", "waiting", "queued", "no-worker")
        for key, task in dask_scheduler.tasks.items()
    )


def _words(error: BaseException) -> str:
    return in_words(error) if isinstance(error, OSError) else str(error).rstrip(".")


def _close(client: Client) -> None:
    with suppress(Exception):
        client.close(timeout=2)
