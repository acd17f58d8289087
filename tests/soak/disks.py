"""Trains and saves on a small disk that is filled and cleared at random moments, made read-only, and taken away.

Nothing raises, it is told, whatever stands on the disk is whole at any time, and once there is room everything is there,
equal to what an undisturbed training wrote.
"""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from dmp.errors import DmpError
from dmp.files import atomic_write_bytes
from dmp.mesh import TriangleMesh
from dmp.meshio import WRITABLE_SUFFIXES, read_mesh, write_mesh
from dmp.problem import denoising
from dmp.runs import Run, record
from dmp.settings import Settings, settings_for
from tests.meshes import sphere_mesh
from tests.soak import Result

FULL_SIZE = 100
_DISK_BYTES = 1 << 20
_STEPS, _INTERVAL = 12, 2


def run(size: int, seed: int) -> Result:
    """Do ``size`` trainings with their exports; without the right to mount a disk there is nothing to try."""
    with tempfile.TemporaryDirectory(prefix="dmp-disks-") as name:
        with _disk(Path(name)) as disk:
            if disk is None:
                return Result("full, read-only and vanished disks", 0, 0, ("a disk can be mounted by the superuser only",))
        mesh = _mesh()
        settings = _settings()
        whole = Run.create(denoising(mesh, settings), settings, folder=Path(name) / "whole")
        list(record(whole.resume(), whole))
        failures = []
        for number in range(size):
            random = np.random.default_rng([seed, number])
            kind = ("full", "read-only", "vanished")[int(random.integers(3))]
            try:
                with _disk(Path(name)) as disk:
                    assert disk is not None
                    wrong = _train(disk, kind, mesh, Run.open(whole.folder), random) + _export(disk, mesh, random)
            except Exception as error:
                where = traceback.extract_tb(error.__traceback__)[-1]
                wrong = [f"{type(error).__name__}: {error} at {where.filename}:{where.lineno}"]
            if wrong:
                failures.append(f"{number}, {kind}: {'; '.join(wrong)}")
    return Result("full, read-only and vanished disks", size - len(failures), size, tuple(failures))


def _mesh() -> TriangleMesh:
    ball = sphere_mesh(2)
    return ball.with_vertices(ball.vertices + 0.03 * np.random.default_rng(0).standard_normal(ball.vertices.shape))


def _settings() -> Settings:
    return settings_for("denoise", steps=_STEPS, snapshot_every=_INTERVAL, log_every=1, threads=1, width_divisor=32)


@contextmanager
def _disk(place: Path) -> Iterator[Path | None]:
    """Mount a disk of a megabyte in memory; None where that is not allowed."""
    folder = Path(tempfile.mkdtemp(dir=place))
    if (
        not hasattr(os, "geteuid")
        or os.geteuid() != 0
        or not _mount("-t", "tmpfs", "-o", f"size={_DISK_BYTES}", "tmpfs", folder)
    ):
        yield None
        return
    try:
        yield folder
    finally:
        _unmount(folder)


def _make_read_only(folder: Path) -> None:
    """Lay the folder over itself without the right to write; files that are open for writing would forbid it otherwise."""
    assert _mount("--bind", folder, folder) and _mount("-o", "remount,bind,ro", folder)


def _unmount(folder: Path) -> None:
    subprocess.run(["umount", "-l", str(folder)], check=False, capture_output=True)


def _mount(*arguments: object) -> bool:
    try:
        return subprocess.run(["mount", *map(str, arguments)], check=False, capture_output=True).returncode == 0
    except OSError:
        return False


def _train(disk: Path, kind: str, mesh: TriangleMesh, whole: Run, random: np.random.Generator) -> list[str]:
    """Train with trouble from one random step to another, and look at the disk after each step."""
    wrong: list[str] = []
    begins, ends = np.sort(random.integers(0, _STEPS + 3, 2)).tolist()
    settings = _settings()
    run = Run.create(denoising(mesh, settings), settings, folder=disk / "run", in_memory=True)
    away = disk / "away"
    trouble: dict[str, tuple[Callable[[], object], Callable[[], object]]] = {
        "full": (lambda: _fill(disk, int(random.integers(0, 6000))), lambda: (disk / "filler").unlink(missing_ok=True)),
        "read-only": (lambda: _make_read_only(run.folder), lambda: _unmount(run.folder)),
        "vanished": (lambda: run.folder.rename(away), lambda: away.rename(run.folder)),
    }
    in_trouble = False
    for item in record(run.resume(), run):
        if in_trouble and item.step >= ends:
            trouble[kind][1]()
            in_trouble = False
        elif not in_trouble and begins <= item.step < ends:
            trouble[kind][0]()
            in_trouble = True
        wrong += _partly(whole, away if away.exists() else run.folder, item.step)
    if in_trouble:
        last = max((step for step in range(_STEPS + 1) if step % _INTERVAL == 0 and step > begins), default=None)
        if last is not None and kind != "full" and not run.is_in_memory:
            wrong.append("nothing is in memory although nothing could be written")
        if run.is_in_memory and not run.warnings:
            wrong.append("nothing was told")
        elsewhere = disk.parent / "elsewhere.ply"
        write_mesh(elsewhere, run.mesh_at(_STEPS))
        if not np.allclose(read_mesh(elsewhere).vertices, whole.mesh_at(_STEPS).vertices, atol=1e-6):
            wrong.append("what was saved elsewhere is something else")
        trouble[kind][1]()
        # A step more, and all of it is there.
        list(record(run.resume(_STEPS + 1), run))
    return wrong + _partly(whole, run.folder, _STEPS, all_of_it=True)


def _partly(whole: Run, folder: Path, reached: int, *, all_of_it: bool = False) -> list[str]:
    """Return what on the disk is not what an undisturbed training wrote."""
    if not (folder / "run.json").exists():
        return ["there is no run"] if all_of_it else []
    run = Run.open(folder)
    wrong = []
    expected = [step for step in whole.snapshot_steps() if step <= reached]
    steps = [step for step in run.snapshot_steps() if step <= _STEPS]
    if (steps != expected) if all_of_it else not set(steps) <= set(expected):
        wrong.append(f"at step {reached} there are the snapshots {steps}")
    if any(not np.array_equal(run.snapshot(step).vertices, whole.snapshot(step).vertices) for step in steps):
        wrong.append(f"at step {reached} a snapshot is damaged")
    rows = {int(row["step"]): {k: v for k, v in row.items() if k != "seconds"} for row in whole.curve()}
    found = {int(row["step"]): {k: v for k, v in row.items() if k != "seconds"} for row in run.curve()}
    if any(rows.get(step) != row for step, row in found.items() if step <= _STEPS) or (
        all_of_it and not rows.keys() <= found.keys()
    ):
        wrong.append(f"at step {reached} the curve is damaged")
    return wrong


def _export(disk: Path, mesh: TriangleMesh, random: np.random.Generator) -> list[str]:
    """Let every writer meet a disk that fills up; the old file stays until the new one is whole."""
    wrong = []
    ball = sphere_mesh(1)
    for suffix in WRITABLE_SUFFIXES:
        target = disk / f"result{suffix}"
        write_mesh(target, ball)
        old = target.read_bytes()
        _fill(disk, int(random.integers(0, 3000)))
        try:
            write_mesh(target, mesh)
        except DmpError as error:
            if "the disk is full" not in str(error):
                wrong.append(f"{suffix}: it says {error}")
            if target.read_bytes() != old:
                wrong.append(f"{suffix}: the old file is gone")
        else:
            wrong.append(f"{suffix}: it was written on a full disk")
        (disk / "filler").unlink()
        write_mesh(target, mesh)
        if read_mesh(target).n_faces != mesh.n_faces:
            wrong.append(f"{suffix}: it was not written in the end")
        target.unlink()
    kept = disk / "window.json"
    atomic_write_bytes(kept, b"{}")
    _fill(disk, 0)
    try:
        atomic_write_bytes(kept, b"x" * 10_000)
        wrong.append("settings were written on a full disk")
    except OSError as error:
        if error.errno != errno.ENOSPC or kept.read_bytes() != b"{}":
            wrong.append("the old settings are gone")
    (disk / "filler").unlink()
    if left := [path.name for path in disk.iterdir() if path.name.endswith(".dmp-part")]:
        wrong.append(f"parts were left behind: {left}")
    return wrong


def _fill(disk: Path, free: int) -> None:
    """Fill a disk until about ``free`` bytes are left."""
    with (disk / "filler").open("wb", buffering=0) as file:
        try:
            while file.write(b"\0" * 4096) == 4096:
                pass
        except OSError:
            pass
        size = file.tell()
        if free and shutil.disk_usage(disk).free < free:
            file.truncate(max(0, size - free))
