"""What is done with runs that are kept: how each was trained in short, its shape for a small picture, and its removal."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from dmp.errors import RunError, SettingsError
from dmp.files import in_words
from dmp.mesh import TriangleMesh
from dmp.run_folder import RunFolder
from dmp.run_manifest import MANIFEST
from dmp.runs import Run, is_run_folder
from dmp.settings import Settings, settings_for

_FILES = (
    "input.ply", "ground_truth.ply", "base.npy", "curve.csv", "checkpoint.pt", "kept.json", "bookmarks.json", "remote.json",
    "run.lock",
)  # fmt: skip
_SNAPSHOT = re.compile(r"[0-9]{6,9}\.npy")
# Where and how often it is written say nothing about how the result came to be.
_NOT_TOLD = ("task", "preset", "steps", "snapshot_every", "log_every", "device", "threads")


def changed_settings(settings: Settings) -> dict[str, Any]:
    """Return the settings that differ from those of the preset, by name; where it computes and how often it writes apart."""
    try:
        usual = settings_for(settings.task, settings.preset)
    except SettingsError:
        # A preset that this task has no longer: then everything is compared with the usual one.
        usual = settings_for(settings.task)
    names = (item.name for item in fields(Settings) if item.name not in _NOT_TOLD)
    return {name: getattr(settings, name) for name in names if getattr(settings, name) != getattr(usual, name)}


@dataclass(frozen=True)
class KeptRuns:
    """What lies in a folder of runs.

    Attributes:
        runs: those that can be read, newest first.
        unreadable: folders that hold a ``run.json`` that does not describe a run, with the reason.
    """

    runs: tuple[Run, ...]
    unreadable: tuple[tuple[Path, str], ...]


def kept_runs(folder: Path) -> KeptRuns:
    """Return the runs in a folder, and what looks like one without being one; a folder that is missing holds none."""
    runs: list[Run] = []
    unreadable: list[tuple[Path, str]] = []
    try:
        candidates = sorted(folder.iterdir())
    except OSError:
        candidates = []
    for candidate in candidates:
        if is_run_folder(candidate):
            try:
                runs.append(Run.open(candidate))
            except RunError as error:
                unreadable.append((candidate, str(error)))
    return KeptRuns(tuple(sorted(runs, key=lambda run: run.created, reverse=True)), tuple(unreadable))


def shape_of(run: Run, step: int | None) -> TriangleMesh:
    """Return the predicted mesh of a step for a small picture, without setting up what a training needs.

    Args:
        run: whose folder is read.
        step: of a snapshot; None takes the input.

    Raises:
        RunError: when a file is missing or damaged.
    """
    files = RunFolder(run.folder)
    mesh = files.read_mesh("input.ply")
    if step is None:
        return mesh
    shape = (mesh.n_vertices, 3)
    displacement = files.read_array(f"snapshots/{step:06d}.npy", shape)
    with np.errstate(all="ignore"):
        vertices = files.read_array("base.npy", shape) + displacement
    if not np.isfinite(vertices).all():
        raise RunError(f"Step {step} of the run in {run.folder} is damaged: it holds positions beyond all numbers.")
    return mesh.with_vertices(vertices)


def is_part_of_run(file: Path, folder: Path) -> bool:
    """Tell whether a file would take the place of one that this program writes into a run folder."""
    place, run = (os.path.realpath(path) for path in (file.absolute().parent, folder))
    return (place == run and file.name in (*_FILES, MANIFEST)) or place == os.path.realpath(folder / "snapshots")


def refuse_removal(folder: Path) -> None:
    """Refuse what must not be removed.

    Raises:
        RunError: when the folder is no run, is a link to one, or is being trained right now.
    """
    if folder.is_symlink():
        raise RunError(f"{folder} is a link to a run elsewhere. Remove the link yourself, or name the folder it leads to.")
    if not is_run_folder(folder):
        raise RunError(f"{folder} is not a run folder: there is no run.json in it. Nothing was removed.")
    try:
        state = Run.open(folder).state
    except RunError:
        # A damaged run is not being trained by this version; it may go.
        return
    if state == "running":
        raise RunError(f"The run in {folder} is being trained right now. Stop its training first.")


def remove_run(folder: Path | str) -> list[str]:
    """Remove a run for good: its own files, and its folder when nothing else lies there.

    What this program did not write there, such as a mesh that was saved beside the run, is left. ``run.json`` goes last, so
    that a removal that was cut off can be asked for again.

    Returns:
        Names of what was left in the folder, sorted; empty when the folder is gone.

    Raises:
        RunError: when it is no run, is a link, is being trained, or a file cannot be removed.
    """
    folder = Path(folder)
    refuse_removal(folder)
    files = RunFolder(folder)
    files.clear_leftovers()
    names = [f"snapshots/{name}" for name in files.names("snapshots") if _SNAPSHOT.fullmatch(name)]
    try:
        for name in (*names, *_FILES):
            (folder / name).unlink(missing_ok=True)
        snapshots = folder / "snapshots"
        if snapshots.is_dir() and not snapshots.is_symlink() and not any(snapshots.iterdir()):
            snapshots.rmdir()
        (folder / MANIFEST).unlink()
        left = sorted(item.name for item in folder.iterdir())
        if not left:
            folder.rmdir()
    except OSError as error:
        raise RunError(f"The run in {folder} cannot be removed whole: {in_words(error)}.") from error
    return left
