"""Trains on odd meshes of any size and place, with both methods and both tasks.

Each time: every number is finite, what belongs to no surface has not moved, a mesh that was only moved and scaled gives the
same result moved and scaled, and what comes back from the run folder is what was in memory.
"""

from __future__ import annotations

import tempfile
import traceback
import warnings
from pathlib import Path

import numpy as np

from dmp.completion import problem_for
from dmp.mesh import FloatArray, TriangleMesh
from dmp.runs import Run, record
from dmp.settings import settings_for
from dmp.topology import connected_vertices
from tests.odd_meshes import ODD_MESHES, with_a_holed_sheet
from tests.soak import Result

FULL_SIZE = 300
_STEPS = 4
# The share of the size that may differ. Adam's first steps are as long as the rate however small the gradient is, so there
# rounding shows.
_TOLERANCE = 1e-2
_DOUBLE = 2.3e-16
_NAMES = [name for name in ODD_MESHES if not name.startswith(("size", "1e7", "small"))]
_EVEN = ("Moebius strip", "flat square", "tetrahedron", "single triangle", "needles")


def run(size: int, seed: int) -> Result:
    """Train ``size`` times: an odd mesh, a method, a scale from 1e-6 to 1e7 and a place up to 1e7 from the origin by chance."""
    failures = []
    with tempfile.TemporaryDirectory(prefix="dmp-scales-") as name:
        for number in range(size):
            random = np.random.default_rng([seed, number])
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    warnings.filterwarnings("ignore", message="The given NumPy array is not writable")
                    wrong = _one(random, Path(name) / str(number))
            except Exception as error:
                wrong = f"{type(error).__name__}: {error} at {traceback.extract_tb(error.__traceback__)[-1].line}"
            if wrong:
                failures.append(f"{number}: {_described(np.random.default_rng([seed, number]))}: {wrong}")
    return Result("odd meshes of any size and place", size - len(failures), size, tuple(failures))


def _chosen(random: np.random.Generator) -> tuple[str, str, str, float, FloatArray]:
    name = _NAMES[int(random.integers(len(_NAMES)))]
    task, preset = ("denoise", "complete")[int(random.integers(2))], ("compact", "best")[int(random.integers(2))]
    scale = float(10 ** random.uniform(-6, 7))
    away = random.standard_normal(3)
    place = away / np.linalg.norm(away) * 10 ** random.uniform(-6, 7) if random.random() < 0.7 else np.zeros(3)
    # A mesh so small and so far away that its file cannot hold its shape is no subject.
    return name, task, preset, max(scale, float(np.abs(place).max()) * 1e-10), place


def _described(random: np.random.Generator) -> str:
    name, task, preset, scale, place = _chosen(random)
    return f"{name}, {task} {preset}, {scale:.2g} large, {np.linalg.norm(place):.2g} away"


def _one(random: np.random.Generator, folder: Path) -> str:
    name, task, preset, scale, place = _chosen(random)
    mesh = ODD_MESHES[name]()
    if name in _EVEN:
        # So that no choice between equals hangs on the last digit.
        mesh = mesh.with_vertices(mesh.vertices * (1 + 0.05 * random.standard_normal(mesh.vertices.shape)))
    if task == "complete":
        mesh = with_a_holed_sheet(mesh)
    moved = mesh.with_vertices(scale * mesh.vertices + place)
    here, (there, run) = _trained(mesh, task, preset, None)[0], _trained(moved, task, preset, folder)
    if not np.isfinite(there).all():
        return "positions are not finite"
    if not all(np.isfinite(list(row.values())).all() for row in run.curve()):
        return "measures are not finite"
    problem = run.problem()
    connected = connected_vertices(problem.mesh.faces, problem.mesh.n_vertices)
    if not np.array_equal(there[~connected], problem.target[~connected]):
        return "isolated vertices have moved"
    if len(here) != len(there):
        return f"hole filling inserted {len(there) - len(here):+} more vertices"
    size = float(np.ptp(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0).max())
    rounding = _DOUBLE * float(np.abs(place).max()) / scale / size
    off = float(np.abs((there - place) / scale - here)[connected].max()) / size
    # Rounding of the input is amplified by some thousand times in the first steps of a training.
    if off > _TOLERANCE + 1e4 * rounding:
        return f"the result is off by {off:.2g} of the size"
    stored = Run.open(run.folder).mesh_at(_STEPS).vertices
    if np.abs(stored - there)[connected].max() > 1e-6 * scale * size + 4 * _DOUBLE * np.abs(there[connected]).max():
        return "the run folder gives back other positions"
    if not np.array_equal(stored[~connected], there[~connected]):
        return "the run folder moves isolated vertices"
    return ""


def _trained(mesh: TriangleMesh, task: str, preset: str, folder: Path | None) -> tuple[FloatArray, Run]:
    quick = {"bilateral_layers": 2} if (task, preset) == ("denoise", "best") else {}
    settings = settings_for(task, preset, steps=_STEPS, snapshot_every=_STEPS, log_every=1, threads=1, **quick)
    problem = problem_for(mesh, settings)
    with tempfile.TemporaryDirectory(prefix="dmp-scales-") as name:
        run = Run.create(problem, settings, folder=folder or Path(name) / "run")
        *_, last = record(run.resume(), run)
    assert last.snapshot is not None
    return last.snapshot.vertices, run
