"""The run folder: one training with its settings, written as it goes, that can be reopened, resumed and exported from.

A folder holds ``run.json``, ``input.ply``, ``ground_truth.ply`` (when there is one), ``base.npy``, ``curve.csv``,
``snapshots/000050.npy``, ``checkpoint.pt`` and ``kept.json``. Each file but the curve is written whole under another name and
then moved into place, so that a crash leaves the old one or the new one. Snapshots hold displacements from the base in
single precision; the base is in double precision, so nothing is lost for a mesh far from the origin.

What cannot be written stays in memory, is told once, and is written as soon as that works again. What is read is checked
first (:mod:`dmp.run_folder`, :mod:`dmp.run_manifest`): a run folder may come from anybody.
"""

from __future__ import annotations

import re
import shutil
import uuid
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from dmp.devices import device_description
from dmp.errors import DmpError, MeshError, RunError
from dmp.mesh import TriangleMesh
from dmp.meshio import write_mesh
from dmp.methods import training_for
from dmp.problem import Problem, check_trainable
from dmp.run_files import (
    CHECKPOINT,
    CurveFile,
    RunLock,
    checkpoint_bytes,
    most_checkpoint_bytes,
    parse_checkpoint,
    read_checkpoint,
)
from dmp.run_folder import RunFolder, plain_text
from dmp.run_manifest import Described, check_digests, new_manifest, read_manifest, take_digests, write_manifest
from dmp.run_outbox import Outbox, cause_of
from dmp.settings import Settings, validated
from dmp.snapshot import Snapshot, StepRecord
from dmp.stopping import Suggestion, suggest
from dmp.training import Training

_SNAPSHOT_NAME = re.compile(r"([0-9]{6,9})\.npy")
_INPUT, _TRUTH, _BASE, _KEPT = "input.ply", "ground_truth.ply", "base.npy", "kept.json"


def default_runs_folder() -> Path:
    """Return where runs are kept unless told otherwise: ``runs`` in the user's data folder."""
    return platformdirs.user_data_path("dmp-viewer", appauthor=False) / "runs"


def is_run_folder(path: Path | str) -> bool:
    """Tell whether ``path`` is a folder with a run in it."""
    try:
        return (Path(path) / "run.json").is_file()
    except OSError:
        return False


def list_runs(folder: Path | None = None) -> list[Run]:
    """Return the readable runs in ``folder`` (default: :func:`default_runs_folder`), newest first."""
    runs = []
    with suppress(OSError):
        for candidate in (folder or default_runs_folder()).iterdir():
            if is_run_folder(candidate):
                with suppress(RunError):
                    runs.append(Run.open(candidate))
    return sorted(runs, key=lambda run: run.created, reverse=True)


class Run(Described):
    """One run folder. Make one with :meth:`create` or :meth:`open`.

    Attributes:
        folder: where it lies.
        settings: what it was trained with.
        warnings: sentences about what could not be written, and what is odd; training goes on in memory meanwhile.
    """

    def __init__(self, folder: Path, manifest: dict[str, Any], settings: Settings) -> None:
        super().__init__(manifest)
        self.folder = folder
        self.settings = settings
        self.warnings: list[str] = []
        self._files = RunFolder(folder)
        self._lock = RunLock(self._files)
        self._curve = CurveFile(self._files)
        self._problem: Problem | None = None
        self._outbox = Outbox(folder, self.warnings)
        self._needs_first_files = False
        self._is_training = False
        self._input_change_told = False

    # -- making and opening ---------------------------------------------------------------------------------------

    @classmethod
    def create(
        cls,
        problem: Problem,
        settings: Settings,
        *,
        folder: Path | str | None = None,
        input_path: Path | str | None = None,
        ground_truth_path: Path | str | None = None,
        name: str | None = None,
        in_memory: bool = False,
    ) -> Run:
        """Make a run folder for a problem that is about to be trained on.

        Args:
            problem: what to fit.
            settings: how.
            folder: a folder that is empty or not there yet; by default a new one in :func:`default_runs_folder`.
            input_path: the file that the mesh was read from, for the record.
            ground_truth_path: likewise for the ground truth.
            name: what to call it; by default after the file.
            in_memory: whether a folder that cannot be written is no obstacle: the run then stays in memory, and says so
                in its warnings.

        Raises:
            RunError: when the folder holds something already, or cannot be written and ``in_memory`` is False.
        """
        run_id = uuid.uuid4().hex
        source, truth = (None if path is None else Path(path) for path in (input_path, ground_truth_path))
        stem = name or (source.stem if source else "mesh")
        if folder is None:
            plain = re.sub(r"[^\w.-]+", "_", stem)[:60] or "mesh"
            folder = default_runs_folder() / f"{datetime.now().astimezone():%Y%m%d-%H%M%S}_{plain}_{run_id[:6]}"
        folder = Path(folder)
        manifest = new_manifest(problem, settings, name=stem, input_path=source, ground_truth_path=truth, run_id=run_id)
        run = cls(folder, manifest, settings)
        run._problem = problem
        run._curve.start([])
        is_new = not folder.exists()
        try:
            if not is_new and any(folder.iterdir()):
                raise RunError(
                    f"{folder} is not empty. Name another folder for the run, or go on with it by 'dmp resume {folder}'."
                )
            run._write_first_files()
            run._curve.finish()
        except (OSError, MeshError) as error:
            if is_new:
                # Half a run would only be in the way.
                shutil.rmtree(folder, ignore_errors=True)
            if not in_memory:
                raise RunError(f"The run folder {folder} cannot be written: {cause_of(error)}. Name another one.") from error
            run._needs_first_files = True
            run._outbox.tell(cause_of(error))
        return run

    def _write_first_files(self) -> None:
        problem = self.problem()
        self._files.make()
        write_mesh(self._files / _INPUT, _with_mask(problem))
        if problem.ground_truth is not None:
            # As it was given: aligning it a second time would change the last digits of what is measured.
            write_mesh(self._files / _TRUTH, problem.ground_truth.source)
        self._files.write_array(_BASE, problem.base)
        take_digests(self._files, self._manifest, (_INPUT, _TRUTH, _BASE))
        self._write_manifest()
        self._needs_first_files = False

    @classmethod
    def open(cls, folder: Path | str) -> Run:
        """Open a run folder, also one whose training was killed.

        Raises:
            RunError: when there is no run in it or its description is damaged.
        """
        folder = Path(folder)
        manifest, settings, notes = read_manifest(RunFolder(folder))
        run = cls(folder, manifest, settings)
        run.warnings += notes
        return run

    # -- what it is -------------------------------------------------------------------------------------------------

    @property
    def state(self) -> str:
        """``running``, ``finished``, ``stopped``, ``failed``, or ``interrupted`` when its process ended without a word."""
        state = str(self._manifest["state"])
        if state != "running" or self._is_being_trained:
            return state
        # Killed after its last snapshot it lacks nothing but the word.
        return "finished" if self.settings.steps in self.snapshot_steps() else "interrupted"

    @property
    def _is_being_trained(self) -> bool:
        return self._is_training or self._lock.is_held_by_anyone()

    @property
    def last_step(self) -> int:
        """The highest step that is kept."""
        return max([0, *self.snapshot_steps()])

    @property
    def is_in_memory(self) -> bool:
        """Whether something that it has learnt could not be written to its folder."""
        return not self._outbox.is_empty

    def rename(self, name: str) -> None:
        """Call the run something else, also while it is trained here.

        Raises:
            RunError: when the name has nothing to show, another process trains the run, or that cannot be written.
        """
        text, before = plain_text(" ".join(name.split())).strip(), self._manifest["name"]
        if not text:
            raise RunError("A run needs a name.")
        if not self._is_training and self.state == "running":
            raise RunError(f"“{self.name}” is being trained by another window or command. Rename it when that has ended.")
        self._manifest["name"] = text
        try:
            if not self._needs_first_files:
                self._write_manifest()
        except OSError as error:
            self._manifest["name"] = before
            raise RunError(f"The name cannot be written to {self.folder}: {cause_of(error)}.") from error

    # -- what is in it ----------------------------------------------------------------------------------------------

    def problem(self) -> Problem:
        """Return the problem that was trained on, from the files of the folder.

        Raises:
            RunError: when they are missing, damaged or don't fit together.
        """
        if self._problem is not None:
            return self._problem
        files = self._files
        check_digests(files, self._manifest, (_INPUT, _TRUTH, _BASE))
        mesh = files.read_mesh(_INPUT)
        n_faces = self._manifest.get("input_faces")
        try:
            check_trainable(mesh)
            inserted = mesh.vertex_attributes.get("inserted")
            if inserted is not None and inserted.ndim != 1:
                raise RunError(f"{files / _INPUT} is damaged: it does not say which vertices were inserted.")
            with np.errstate(all="ignore"):
                problem = Problem.from_base(
                    mesh,
                    self.settings,
                    base=files.read_array(_BASE, (mesh.n_vertices, 3)).astype(np.float64),
                    known=None if inserted is None else np.asarray(inserted) == 0,
                    ground_truth=files.read_mesh(_TRUTH) if files.size(_TRUTH) is not None else None,
                    n_input_faces=n_faces if type(n_faces) is int and 0 < n_faces <= mesh.n_faces else None,
                )
        except RunError:
            raise
        except MeshError as error:
            raise RunError(f"The run in {self.folder} cannot be opened: {error}") from error
        self._problem = problem
        return problem

    def curve(self) -> list[dict[str, float]]:
        """Return the logged steps in ascending order; each has ``step``, ``seconds`` and what was measured.

        Raises:
            RunError: when there is a file of that name that cannot be the curve.
        """
        return [dict(row) for row in self._curve.rows()]

    def snapshot_steps(self) -> list[int]:
        """Return the steps whose mesh is kept, ascending."""
        names = (_SNAPSHOT_NAME.fullmatch(name) for name in self._files.names("snapshots"))
        return sorted({int(match[1]) for match in names if match} | self._outbox.snapshots.keys())

    def snapshot(self, step: int) -> Snapshot:
        """Return the predicted mesh at a kept step (raises :class:`RunError` when it is missing or damaged)."""
        if step in self._outbox.snapshots:
            return self._outbox.snapshots[step]
        base = self.problem().base
        displacement = self._files.read_array(_snapshot_name(step), (len(base), 3))
        row = next((row for row in self._curve.rows() if row["step"] == step), {})
        metrics = {name: value for name, value in row.items() if name not in ("step", "seconds")}
        with np.errstate(all="ignore"):
            vertices = base + displacement
        if not np.isfinite(vertices).all():
            raise RunError(f"{self._files / _snapshot_name(step)} is damaged: it holds positions beyond all numbers.")
        return Snapshot(self.run_id, step, vertices, metrics, row.get("seconds", 0.0))

    @property
    def kept_step(self) -> int | None:
        """The step that a person chose to keep, or None."""
        if self._outbox.choice is not None:
            return self._outbox.choice[0]
        try:
            step = self._files.read_json(_KEPT).get("step") if self._files.size(_KEPT) is not None else None
        except RunError:
            return None
        return step if type(step) is int and step in self.snapshot_steps() else None

    def keep(self, step: int | None) -> None:
        """Remember the step that a person chose; None forgets it.

        What cannot be written is remembered as long as this object lives, with a sentence in ``warnings``.

        Raises:
            RunError: when the run has no snapshot of it.
        """
        if step is not None and step not in self.snapshot_steps():
            raise RunError(f"Step {step} is not kept in this run. Its snapshots are: {_listed(self.snapshot_steps())}.")
        self._outbox.choice = (step,)
        if self._outbox.attempt(lambda: self._save_choice(step)):
            self._outbox.choice = None

    def _save_choice(self, step: int | None) -> None:
        if step is None:
            (self._files / _KEPT).unlink(missing_ok=True)
        else:
            self._files.write_json(_KEPT, {"step": step, "chosen": datetime.now().astimezone().isoformat(timespec="seconds")})

    def suggestion(self) -> Suggestion | None:
        """Return the step that the curve suggests, with its reason."""
        return suggest(self.curve(), self.snapshot_steps())

    def suggested_step(self) -> int | None:
        """Return the step that the curve suggests, or None without snapshots."""
        suggestion = self.suggestion()
        return None if suggestion is None else suggestion.step

    def mesh_at(self, step: int) -> TriangleMesh:
        """Return the predicted mesh at a step with the input's attributes and ``displacement`` from the base, (V, 3).

        A completion also carries ``inserted``, (V,) uint8, 1 for the vertices that hole filling inserted.
        """
        problem = self.problem()
        vertices = problem.exact(self.snapshot(step).vertices)
        return _with_mask(problem).with_vertices(vertices).with_attributes(displacement=vertices - problem.base)

    # -- training ---------------------------------------------------------------------------------------------------

    def resume(self, steps: int | None = None) -> Training:
        """Return the training as it was at the last checkpoint, ready to go on.

        Args:
            steps: train until this step instead of the one in the settings.

        Raises:
            RunError: when the run is being trained right now, is complete, or has no usable checkpoint.
        """
        if self._is_being_trained:
            raise RunError(f"The run in {self.folder} is being trained by another window or command.")
        if steps is not None:
            self.settings = validated(replace(self.settings, steps=steps))
        training = training_for(self.problem(), self.settings, run_id=self.run_id)
        threads = self.recorded_threads
        if self.settings.threads == 0 and threads is not None:
            # Sums over another number of threads differ in their last digits.
            training.threads = min(threads, training.threads)
        state = self._last_state(training)
        if state is not None:
            if state.get("run_id", self.run_id) != self.run_id:
                raise RunError(f"{self._files / CHECKPOINT} belongs to another run.")
            training.load_state(state)
        if self._manifest["state"] == "running":
            # Cut off at its very end: what is left to do is to say that it is done.
            return training
        if training.step >= self.settings.steps:
            raise RunError(f"The run has reached step {training.step} already. To go on, give a higher number with --steps.")
        if training.is_done:
            raise RunError("The run has come to rest already: its inserted vertices hardly move any more.")
        return training

    def _last_state(self, training: Training) -> dict[str, Any] | None:
        if self._outbox.checkpoint is not None:
            return parse_checkpoint(self._outbox.checkpoint, self.folder)
        if self._needs_first_files or self._files.size(CHECKPOINT) is None:
            return None
        return read_checkpoint(self._files, most_checkpoint_bytes(training.n_parameters, self.problem().mesh.n_vertices))

    def acknowledge(self) -> None:
        """Take note that the training was interrupted: from now on it counts as stopped, and can be continued."""
        if self.state == "interrupted":
            self._manifest["state"] = "stopped"
            self._outbox.attempt(self._write_manifest)

    def _begin(self, training: Training) -> None:
        self._manifest["device"] = device_description(training.device)
        self._manifest["threads"] = training.threads
        self._manifest["settings"] = asdict(self.settings)
        self._manifest["state"] = "running"
        # Steps after the checkpoint are trained again; their old lines would come before the new ones.
        rows = [row for row in self.curve() if row["step"] <= training.step] if training.step else []
        if not self._needs_first_files:
            try:
                is_ours = self._lock.acquire()
            except OSError as error:
                # Whoever cannot write disturbs nobody.
                self._outbox.tell(cause_of(error))
            else:
                if not is_ours:
                    raise RunError(f"The run in {self.folder} is being trained by another window or command.")
        self._is_training = True
        self._curve.start(rows)
        if self._needs_first_files or self._outbox.has_trouble:
            return
        self._files.clear_leftovers()
        self._outbox.attempt(self._write_manifest)
        self._outbox.attempt(self._curve.finish)

    def _write(self, record: StepRecord, training: Training) -> None:
        self.warnings += [text for text in training.warnings if text not in self.warnings]
        if record.metrics:
            self._curve.hold({"step": record.step, "seconds": record.seconds, **record.metrics})
            if not self._needs_first_files:
                self._outbox.attempt(self._curve.write)
        if record.snapshot is not None:
            self._outbox.snapshots[record.snapshot.step] = record.snapshot
            self._outbox.checkpoint = checkpoint_bytes(training.state())
            self._send()
            change = None if self._input_change_told else self.change_of_input()
            if change is not None:
                self._input_change_told = True
                self.warnings.append(change)

    def _send(self) -> None:
        def save_checkpoint(content: bytes) -> None:
            self._files.write(CHECKPOINT, content)

        if self._needs_first_files and not self._outbox.attempt(self._write_first_files):
            return
        self._outbox.send(self._save_snapshot, self._curve.finish, save_checkpoint, self._save_choice)

    def _end(self, training: Training, state: str, *, keeps_step: bool, reason: str = "") -> None:
        if keeps_step and training.step and training.step not in self.snapshot_steps():
            # What was on the screen when the person said stop is kept, whatever the interval.
            reached = training.current()
            if reached is not None:
                self._write(reached, training)
        self._manifest.pop("reason", None)
        if reason:
            self._manifest["reason"] = reason
        self._manifest["state"] = state
        if self.is_in_memory:
            self._send()
        if not self._needs_first_files:
            self._outbox.attempt(self._write_manifest)
        self._is_training = False
        self._lock.release()

    # -- files ------------------------------------------------------------------------------------------------------

    def _write_manifest(self) -> None:
        self._manifest["last_step"] = self.last_step
        write_manifest(self._files, self._manifest)

    def _save_snapshot(self, snapshot: Snapshot) -> None:
        displacement = (snapshot.vertices - self.problem().base).astype(np.float32)
        self._files.write_array(_snapshot_name(snapshot.step), displacement)


def record(training: Training, run: Run) -> Iterator[StepRecord]:
    """Train, and write the run folder as training goes; yields the records of :meth:`Training.steps` unchanged.

    Closing the iterator ends the run as ``stopped``, with a snapshot and a checkpoint of the step reached. A file that
    cannot be written becomes a sentence in ``run.warnings``; its snapshots stay in memory and are written when it works again.

    Raises:
        RunError: when another training holds the folder.
        TrainingError: see :meth:`Training.steps`.
    """
    run._begin(training)
    try:
        for item in training.steps():
            run._write(item, training)
            yield item
    except GeneratorExit:
        # Closed where a record was handed out, so between two steps.
        run._end(training, "stopped", keeps_step=True)
        raise
    except BaseException as error:
        # Anywhere within a step: weights and averages may be half of one and half of the next, and are not kept.
        is_failure = isinstance(error, Exception)
        reason = str(error) if isinstance(error, DmpError) else f"{type(error).__name__}: {error}"
        run._end(training, "failed" if is_failure else "stopped", keeps_step=False, reason=reason if is_failure else "")
        raise
    run._end(training, "finished", keeps_step=False)


def _snapshot_name(step: int) -> str:
    return f"snapshots/{step:06d}.npy"


def _with_mask(problem: Problem) -> TriangleMesh:
    return problem.mesh if problem.known.all() else problem.mesh.with_attributes(inserted=(~problem.known).astype(np.uint8))


def _listed(steps: list[int], most: int = 12) -> str:
    if len(steps) <= most:
        return ", ".join(map(str, steps)) or "none"
    return f"{', '.join(map(str, steps[: most // 2]))}, …, {', '.join(map(str, steps[-most // 2 :]))}"
