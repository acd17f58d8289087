"""The run folder: one training with its settings, written as it goes, that can be reopened, resumed and exported from.

A folder holds ``run.json``, ``input.ply``, ``ground_truth.ply`` (when there is one), ``base.npy``, ``curve.csv``,
``snapshots/000050.npy``, ``checkpoint.pt`` and ``kept.json``. Each file but the curve is written whole under another name and
then moved into place, so that a crash leaves the old one or the new one. Snapshots hold displacements from the base in
single precision; the base is in double precision, so nothing is lost for a mesh far from the origin.
"""

from __future__ import annotations

import hashlib
import json
import platform
import re
import sys
import uuid
from collections.abc import Iterator
from dataclasses import asdict, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from dmp.errors import DmpError, MeshError, RunError
from dmp.files import atomic_write, atomic_write_bytes
from dmp.mesh import FloatArray, TriangleMesh
from dmp.meshio import read_mesh, write_mesh
from dmp.methods import training_for
from dmp.problem import Problem
from dmp.run_files import CurveFile, RunLock, curve_line, curve_text, read_checkpoint, write_checkpoint
from dmp.settings import Settings, from_mapping, validated
from dmp.snapshot import Snapshot, StepRecord
from dmp.stopping import Suggestion, suggest
from dmp.training import Training

RUN_FORMAT = 1
_SNAPSHOT_NAME = re.compile(r"(\d{6,12})\.npy")


def default_runs_folder() -> Path:
    """Return where runs are kept unless told otherwise: ``runs`` in the user's data folder."""
    return platformdirs.user_data_path("dmp-viewer", appauthor=False) / "runs"


def is_run_folder(path: Path | str) -> bool:
    """Tell whether ``path`` is a folder with a run in it."""
    return (Path(path) / "run.json").is_file()


def list_runs(folder: Path | None = None) -> list[Run]:
    """Return the readable runs in ``folder`` (default: :func:`default_runs_folder`), newest first."""
    root = folder or default_runs_folder()
    runs = []
    for candidate in root.iterdir() if root.is_dir() else ():
        if is_run_folder(candidate):
            try:
                runs.append(Run.open(candidate))
            except RunError:
                continue
    return sorted(runs, key=lambda run: run.created, reverse=True)


class Run:
    """One run folder. Make one with :meth:`create` or :meth:`open`.

    Attributes:
        folder: where it lies.
        settings: what it was trained with.
        warnings: sentences about what could not be written; training goes on in memory meanwhile.
    """

    def __init__(self, folder: Path, manifest: dict[str, Any], settings: Settings) -> None:
        self.folder = folder
        self.settings = settings
        self.warnings: list[str] = []
        self._manifest = manifest
        self._lock = RunLock(folder / "run.lock")
        self._unsaved: dict[int, Snapshot] = {}
        self._base: FloatArray | None = None
        self._problem: Problem | None = None
        self._curve = CurveFile(folder / "curve.csv")

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
    ) -> Run:
        """Make a run folder for a problem that is about to be trained on.

        Args:
            problem: what to fit.
            settings: how.
            folder: a folder that is empty or not there yet; by default a new one in :func:`default_runs_folder`.
            input_path: the file that the mesh was read from, for the record.
            ground_truth_path: likewise for the ground truth.

        Raises:
            RunError: when the folder holds something already or cannot be written.
        """
        now = datetime.now().astimezone()
        run_id = uuid.uuid4().hex
        stem = Path(input_path).stem if input_path else "mesh"
        if folder is None:
            plain = re.sub(r"[^\w.-]+", "_", stem)[:60] or "mesh"
            folder = default_runs_folder() / f"{now:%Y%m%d-%H%M%S}_{plain}_{run_id[:6]}"
        folder = Path(folder)
        manifest = {
            "format": RUN_FORMAT,
            "run_id": run_id,
            "name": f"{stem}, {now:%Y-%m-%d %H:%M}",
            "created": now.isoformat(timespec="seconds"),
            "settings": asdict(settings),
            "versions": _versions(),
            "input": _origin(input_path),
            "ground_truth": _origin(ground_truth_path) if problem.ground_truth else None,
            "vertices": problem.mesh.n_vertices,
            "faces": problem.mesh.n_faces,
            "state": "stopped",
            "last_step": 0,
        }
        run = cls(folder, manifest, settings)
        try:
            if folder.exists() and any(folder.iterdir()):
                raise RunError(
                    f"{folder} is not empty. Name another folder for the run, or go on with it by 'dmp resume {folder}'."
                )
            (folder / "snapshots").mkdir(parents=True, exist_ok=True)
            write_mesh(folder / "input.ply", _with_mask(problem))
            if problem.ground_truth is not None:
                # As it was given: aligning it a second time would change the last digits of what is measured.
                write_mesh(folder / "ground_truth.ply", problem.ground_truth.source)
            _save_array(folder / "base.npy", problem.base)
            atomic_write_bytes(folder / "curve.csv", curve_text([]).encode())
            run._write_manifest()
        except (OSError, MeshError) as error:
            raise RunError(f"The run folder {folder} cannot be written: {_cause(error)}. Name another one.") from error
        run._base = problem.base
        run._problem = problem
        return run

    @classmethod
    def open(cls, folder: Path | str) -> Run:
        """Open a run folder, also one whose training was killed.

        Raises:
            RunError: when there is no run in it or its description is damaged.
        """
        folder = Path(folder)
        try:
            manifest = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        except OSError as error:
            raise RunError(f"{folder} is not a run folder: run.json cannot be read ({error.strerror}).") from error
        except ValueError as error:
            raise RunError(f"{folder / 'run.json'} is damaged ({error}).") from error
        try:
            if manifest["format"] != RUN_FORMAT:
                raise RunError(f"{folder} was written in format {manifest['format']}; this version reads format {RUN_FORMAT}.")
            settings = from_mapping(manifest["settings"])
            for key, kind in (("run_id", str), ("name", str), ("created", str), ("state", str), ("last_step", int)):
                if not isinstance(manifest[key], kind):
                    raise TypeError(f"{key} is {manifest[key]!r}")
        except (KeyError, TypeError, DmpError) as error:
            raise RunError(f"{folder / 'run.json'} does not describe a run ({_cause(error)}).") from error
        return cls(folder, manifest, settings)

    # -- what it is -------------------------------------------------------------------------------------------------

    @property
    def run_id(self) -> str:
        """Identifies this run in its snapshots."""
        return str(self._manifest["run_id"])

    @property
    def name(self) -> str:
        """The name shown to the user."""
        return str(self._manifest["name"])

    @property
    def created(self) -> str:
        """When it was made, ISO 8601."""
        return str(self._manifest["created"])

    @property
    def state(self) -> str:
        """``running``, ``finished``, ``stopped``, ``failed``, or ``interrupted`` when its process ended without a word."""
        state = str(self._manifest["state"])
        if state == "running" and not self._lock.is_held_by_anyone():
            return "interrupted"
        return state

    @property
    def last_step(self) -> int:
        """The highest step that is kept."""
        return max([0, *self.snapshot_steps()])

    @property
    def input_path(self) -> Path | None:
        """The file that the input was read from, if it is known; it may have gone since."""
        origin = self._manifest.get("input")
        return Path(origin["path"]) if isinstance(origin, dict) and isinstance(origin.get("path"), str) else None

    @property
    def device(self) -> str | None:
        """Where it was trained last."""
        return self._manifest.get("device")

    # -- what is in it ----------------------------------------------------------------------------------------------

    def problem(self) -> Problem:
        """Return the problem that was trained on, from the files of the folder.

        Raises:
            RunError: when they are missing, damaged or don't fit together.
        """
        if self._problem is not None:
            return self._problem
        try:
            mesh = read_mesh(self.folder / "input.ply")
            truth_path = self.folder / "ground_truth.ply"
            truth = read_mesh(truth_path) if truth_path.is_file() else None
            inserted = mesh.vertex_attributes.get("inserted")
            problem = Problem.from_base(
                mesh,
                self.settings,
                base=self._read_base(mesh.n_vertices),
                known=None if inserted is None else np.asarray(inserted) == 0,
                ground_truth=truth,
            )
        except MeshError as error:
            raise RunError(f"The run in {self.folder} cannot be opened: {error}") from error
        self._problem = problem
        return problem

    def curve(self) -> list[dict[str, float]]:
        """Return the logged steps in ascending order; each has ``step``, ``seconds`` and what was measured."""
        return [dict(row) for row in self._curve.rows()]

    def snapshot_steps(self) -> list[int]:
        """Return the steps whose mesh is kept, ascending."""
        folder = self.folder / "snapshots"
        names = (_SNAPSHOT_NAME.fullmatch(path.name) for path in (folder.iterdir() if folder.is_dir() else ()))
        return sorted({int(match[1]) for match in names if match} | self._unsaved.keys())

    def snapshot(self, step: int) -> Snapshot:
        """Return the predicted mesh at a kept step (raises :class:`RunError` when it is missing or damaged)."""
        if step in self._unsaved:
            return self._unsaved[step]
        base = self._base if self._base is not None else self._read_base(None)
        path = self._snapshot_path(step)
        displacement = _load_array(path, (len(base), 3))
        row = next((row for row in self._curve.rows() if row["step"] == step), {})
        metrics = {name: value for name, value in row.items() if name not in ("step", "seconds")}
        return Snapshot(self.run_id, step, base + displacement, metrics, row.get("seconds", 0.0))

    @property
    def kept_step(self) -> int | None:
        """The step that a person chose to keep, or None."""
        try:
            step = json.loads((self.folder / "kept.json").read_text(encoding="utf-8"))["step"]
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return step if isinstance(step, int) else None

    def keep(self, step: int | None) -> None:
        """Remember the step that a person chose; None forgets it.

        Raises:
            RunError: when the run has no snapshot of it, or the choice cannot be written.
        """
        if step is not None and step not in self.snapshot_steps():
            raise RunError(f"Step {step} is not kept in this run. Its snapshots are: {_listed(self.snapshot_steps())}.")
        try:
            if step is None:
                (self.folder / "kept.json").unlink(missing_ok=True)
            else:
                note = {"step": step, "chosen": datetime.now().astimezone().isoformat(timespec="seconds")}
                atomic_write_bytes(self.folder / "kept.json", json.dumps(note).encode())
        except OSError as error:
            raise RunError(f"The choice cannot be written to {self.folder}: {_cause(error)}.") from error

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
        vertices = self.snapshot(step).vertices
        return _with_mask(problem).with_vertices(vertices).with_attributes(displacement=vertices - problem.base)

    # -- training ---------------------------------------------------------------------------------------------------

    def resume(self, steps: int | None = None) -> Training:
        """Return the training as it was at the last checkpoint, ready to go on.

        Args:
            steps: train until this step instead of the one in the settings.

        Raises:
            RunError: when the run is being trained right now, is complete, or has no usable checkpoint.
        """
        if self._lock.is_held_by_anyone():
            raise RunError(f"The run in {self.folder} is being trained by another window or command.")
        if steps is not None:
            self.settings = validated(replace(self.settings, steps=steps))
        training = training_for(self.problem(), self.settings, run_id=self.run_id)
        if (self.folder / "checkpoint.pt").exists():
            training.load_state(read_checkpoint(self.folder / "checkpoint.pt"))
        if training.step >= self.settings.steps:
            raise RunError(f"The run has reached step {training.step} already. To go on, give a higher number with --steps.")
        if training.is_done:
            raise RunError("The run has come to rest already: its inserted vertices hardly move any more.")
        return training

    def _begin(self, training: Training) -> None:
        if not self._lock.acquire():
            raise RunError(f"The run in {self.folder} is being trained by another window or command, or cannot be written.")
        from dmp.devices import device_description

        self._manifest["device"] = device_description(training.device)
        self._manifest["threads"] = training.threads
        self._manifest["settings"] = asdict(self.settings)
        # Steps after the checkpoint are trained again; their old lines would come before the new ones.
        rows = [row for row in self.curve() if row["step"] <= training.step] if training.step else []
        self._try("run.json", lambda: self._set_state("running"))
        self._try("curve.csv", lambda: atomic_write_bytes(self.folder / "curve.csv", curve_text(rows).encode()))

    def _write(self, record: StepRecord, training: Training) -> None:
        if record.metrics:
            line = curve_line({"step": record.step, "seconds": record.seconds, **record.metrics})
            self._try("curve.csv", lambda: self._append_to_curve(line))
        if record.snapshot is not None:
            self._keep_snapshot(record.snapshot, training)

    def _keep_snapshot(self, snapshot: Snapshot, training: Training) -> None:
        self._unsaved[snapshot.step] = snapshot
        for step, unsaved in sorted(self._unsaved.items()):
            if self._try(f"snapshot {step}", lambda unsaved=unsaved: self._save_snapshot(unsaved)):
                del self._unsaved[step]
        self._try("checkpoint.pt", lambda: write_checkpoint(self.folder / "checkpoint.pt", training.state()))

    def _end(self, training: Training, state: str) -> None:
        if state == "stopped" and training.step and training.step not in self.snapshot_steps():
            # What was on the screen when the person said stop is kept, whatever the interval.
            reached = training.current()
            if reached is not None:
                self._write(reached, training)
        self._try("run.json", lambda: self._set_state(state))
        self._lock.release()

    def _try(self, what: str, write: Any) -> bool:
        try:
            write()
        except (OSError, DmpError) as error:
            sentence = f"{what} could not be written to {self.folder}: {_cause(error)}. The training goes on in memory."
            if sentence not in self.warnings:
                self.warnings.append(sentence)
            return False
        return True

    # -- files ------------------------------------------------------------------------------------------------------

    def _set_state(self, state: str) -> None:
        self._manifest["state"] = state
        self._manifest["last_step"] = self.last_step
        self._write_manifest()

    def _write_manifest(self) -> None:
        atomic_write_bytes(self.folder / "run.json", json.dumps(self._manifest, indent=2).encode())

    def _append_to_curve(self, line: str) -> None:
        with (self.folder / "curve.csv").open("a", encoding="ascii", newline="") as file:
            file.write(line)

    def _snapshot_path(self, step: int) -> Path:
        return self.folder / "snapshots" / f"{step:06d}.npy"

    def _save_snapshot(self, snapshot: Snapshot) -> None:
        base = self._base if self._base is not None else self._read_base(None)
        _save_array(self._snapshot_path(snapshot.step), (snapshot.vertices - base).astype(np.float32))

    def _read_base(self, n_vertices: int | None) -> FloatArray:
        if n_vertices is None:
            n_vertices = self.problem().mesh.n_vertices
        self._base = _load_array(self.folder / "base.npy", (n_vertices, 3)).astype(np.float64)
        return self._base


def record(training: Training, run: Run) -> Iterator[StepRecord]:
    """Train, and write the run folder as training goes; yields the records of :meth:`Training.steps` unchanged.

    Closing the iterator ends the run as ``stopped``, with a snapshot and a checkpoint of the step reached. A file that
    cannot be written becomes a sentence in ``run.warnings``; its snapshots stay in memory and are written when it works again.

    Raises:
        RunError: when another training holds the folder.
        TrainingError: see :meth:`Training.steps`.
    """
    run._begin(training)
    state = "stopped"
    try:
        for item in training.steps():
            run._write(item, training)
            yield item
        state = "finished"
    except Exception:
        state = "failed"
        raise
    finally:
        run._end(training, state)


def _with_mask(problem: Problem) -> TriangleMesh:
    return problem.mesh if problem.known.all() else problem.mesh.with_attributes(inserted=(~problem.known).astype(np.uint8))


def _save_array(path: Path, array: np.ndarray) -> None:
    with atomic_write(path) as file:
        np.save(file, array, allow_pickle=False)


def _load_array(path: Path, shape: tuple[int, int]) -> FloatArray:
    try:
        # Mapped first, so that a lying header allocates nothing.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except FileNotFoundError as error:
        raise RunError(f"{path} is missing from the run.") from error
    except (OSError, ValueError, EOFError, SyntaxError) as error:
        raise RunError(f"{path} is damaged ({_cause(error)}).") from error
    if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype not in (np.float32, np.float64):
        raise RunError(f"{path} does not belong to this run: {shape[0]} rows of 3 numbers are needed.")
    values = np.array(array)
    if not np.isfinite(values).all():
        raise RunError(f"{path} is damaged: it holds numbers that are not finite.")
    return values


def _origin(path: Path | str | None) -> dict[str, str] | None:
    if path is None:
        return None
    path = Path(path).absolute()
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return {"path": str(path)}
    return {"path": str(path), "sha256": digest}


def _versions() -> dict[str, str]:
    import scipy
    import torch

    import dmp

    return {
        "dmp": dmp.__version__,
        "torch": torch.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
        "platform": f"{sys.platform} {platform.machine()}",
    }


def _cause(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error).rstrip(".") or type(error).__name__


def _listed(steps: list[int], most: int = 12) -> str:
    if len(steps) <= most:
        return ", ".join(map(str, steps)) or "none"
    return f"{', '.join(map(str, steps[: most // 2]))}, …, {', '.join(map(str, steps[-most // 2 :]))}"
