"""What a batch has to do: one job for each mesh and settings, named so that the same job is found again."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dmp.errors import MeshFileError, SettingsError
from dmp.files import in_words
from dmp.settings import Settings

# Where and with how many threads something is computed; the thread count changes the last digits, not the job.
_WITHOUT_EFFECT = ("device", "threads", "precision", "memory")


@dataclass(frozen=True)
class BatchJob:
    """One mesh to restore.

    Attributes:
        name: of its run folder and its result: the stem of the file, and a digest of all that decides the result.
        mesh: the file, absolute.
        settings: how.
        ground_truth: the clean mesh to measure by, absolute, or None.
        file_bytes: size of the mesh file, to foresee memory and time.
    """

    name: str
    mesh: Path
    settings: Settings
    ground_truth: Path | None = None
    file_bytes: int = 0

    @property
    def work(self) -> float:
        """About how long it takes; only ratios of it mean anything."""
        return (1e5 + self.file_bytes) * self.settings.steps


def job_for(mesh: Path, settings: Settings, ground_truth: Path | None = None, name: str | None = None) -> BatchJob:
    """Return the job of a mesh file.

    Its name changes when the file, the ground truth or a setting changes that the result depends on, so that what is done
    is not done again, and what is no longer right is.

    Raises:
        MeshFileError: when a file is not there.
    """
    files: dict[str, Any] = {}
    for role, path in (("mesh", mesh), ("ground_truth", ground_truth)):
        if path is not None:
            try:
                status = path.stat()
            except OSError as error:
                raise MeshFileError(path, f"it cannot be read: {in_words(error)}", "Correct its name.") from error
            # Not where it lies: a moved batch is still the same. Whole seconds, because not every disk keeps more.
            files[role] = [path.name, status.st_size, int(status.st_mtime)]
    values = {key: value for key, value in asdict(settings).items() if key not in _WITHOUT_EFFECT}
    digest = hashlib.sha256(json.dumps([files, values], sort_keys=True).encode()).hexdigest()[:10]
    stem = re.sub(r"[^\w.-]+", "_", name or mesh.stem).strip("._")[:60] or "mesh"
    truth = None if ground_truth is None else ground_truth.absolute()
    return BatchJob(f"{stem}-{digest}", mesh.absolute(), settings, truth, files["mesh"][1])


def distinct(jobs: Sequence[BatchJob]) -> list[BatchJob]:
    """Return the jobs without those that would repeat an earlier one; files of one name in several folders are kept apart."""
    found: dict[str, BatchJob] = {}
    for job in jobs:
        name, number = job.name, 2
        while name in found and (found[name].mesh, found[name].ground_truth) != (job.mesh, job.ground_truth):
            name, number = f"{job.name}-{number}", number + 1
        if name not in found:
            found[name] = BatchJob(name, job.mesh, job.settings, job.ground_truth, job.file_bytes)
    return list(found.values())


def jobs_from_files(
    sources: Sequence[str], settings: Settings, ground_truths: Path | None, changes: Mapping[str, Any] | None = None
) -> list[BatchJob]:
    """Return the jobs of what a person named.

    Args:
        sources: mesh files, folders with meshes (not their subfolders), patterns such as ``scans/**/*.ply``, and CSV tables.
        settings: of all jobs; a table may say otherwise for each of its rows.
        ground_truths: a folder with clean meshes of the same names, or None.
        changes: the settings that were named, which rows with another task or preset take over too.

    Raises:
        MeshFileError: when nothing is found there, or a file is missing.
        SettingsError: for a wrong value in a table.
    """
    from dmp.batch.table import jobs_from_table

    if ground_truths is not None and not ground_truths.is_dir():
        raise MeshFileError(ground_truths, "there is no such folder", "Name a folder with clean meshes of the same file names.")
    jobs: list[BatchJob] = []
    for source in sources:
        path = Path(source)
        if path.suffix.lower() == ".csv" and path.is_file():
            jobs += jobs_from_table(path, settings, changes or {})
            continue
        for mesh in _meshes_in(source):
            jobs.append(job_for(mesh, settings, _truth_for(mesh, ground_truths)))
    if not jobs:
        raise SettingsError("There is nothing to do: name mesh files, folders, patterns or a CSV table.")
    return distinct(jobs)


def _meshes_in(source: str) -> list[Path]:
    from dmp.meshio import READABLE_SUFFIXES

    path = Path(source)
    found: Iterator[Path]
    if path.is_file():
        return [path]
    if path.is_dir():
        found = path.iterdir()
        what = "there are no mesh files in this folder"
    else:
        anchor = Path(path.anchor) if path.anchor else Path()
        pattern = str(path.relative_to(path.anchor)) if path.anchor else source
        try:
            found = anchor.glob(pattern) if any(letter in pattern for letter in "*?[") else iter(())
        except (ValueError, NotImplementedError):
            found = iter(())
        what = "there is no such file or folder, and no mesh fits it as a pattern"
    meshes = sorted(item for item in found if item.suffix.lower() in READABLE_SUFFIXES and item.is_file())
    if not meshes:
        raise MeshFileError(source, what, "Name mesh files, folders, patterns such as 'scans/*.ply', or a CSV table.")
    return meshes


def _truth_for(mesh: Path, folder: Path | None) -> Path | None:
    if folder is None:
        return None
    same = folder / mesh.name
    if same.is_file():
        return same
    others = sorted(folder.glob(f"{mesh.stem}.*"))
    return others[0] if others else None
