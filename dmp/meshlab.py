"""The only way to MeshLab: pymeshlab in a child process, with a limit of time and memory.

pymeshlab is never imported here. It brings a Qt of its own, which on Windows breaks other users of Qt in the process,
some filters end the process on unlucky meshes, some never end, and its licence (GPL-3) is not ours: the two programs only
exchange files. Whatever happens to the child becomes one sentence.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dmp.boundary import BoundaryLoop
from dmp.errors import MeshError
from dmp.files import in_words
from dmp.mesh import FloatArray, IntArray, TriangleMesh

TIME_LIMIT = 20.0  # seconds; no undamaged mesh of the size meant for this program has needed more than 2
MEMORY_LIMIT = 6 * 2**30  # bytes; ten times what such a mesh needs

_SAID = "said.txt"
_LAST_WORDS = 4096
_LARGEST_FILE = 2 * 2**30
_SIGNS_OF_NO_MEMORY = ("MemoryError", "bad_alloc", "llocate memory", "out of memory")
_WORKER = Path(__file__).with_name("meshlab_worker.py")

Filter = tuple[str, Mapping[str, Any]]


def run_filters(
    mesh: TriangleMesh,
    filters: Sequence[Filter],
    *,
    face_values: FloatArray | None = None,
    time_limit: float = TIME_LIMIT,
    memory_limit: int = MEMORY_LIMIT,
) -> tuple[FloatArray, IntArray]:
    """Apply MeshLab filters to ``mesh``, one after the other.

    Args:
        mesh: what to start from; vertex attributes do not travel.
        filters: names and parameters as pymeshlab's ``apply_filter`` takes them. A length is written
            ``{"length": x}``, a share of the diagonal ``{"percentage": x}``.
        face_values: (F,) a number for each face, which conditions of filters know as ``fq``.
        time_limit: seconds after which the child is ended.
        memory_limit: bytes of address space; not enforced on Windows.

    Returns:
        vertices (V', 3) and faces (F', 3).

    Raises:
        MeshError: when MeshLab is missing, refuses, crashes, takes too long or too much memory, or gives no valid mesh.
    """
    if mesh.n_faces == 0:
        raise MeshError("MeshLab was not asked, because the mesh has no faces.")
    values = np.zeros(mesh.n_faces) if face_values is None else np.asarray(face_values, dtype=np.float64)
    try:
        # The child's folder and everything in it goes whatever happens.
        with tempfile.TemporaryDirectory(prefix="dmp-meshlab-", ignore_cleanup_errors=True) as name:
            folder = Path(name)
            np.savez(folder / "input.npz", vertices=mesh.vertices, faces=mesh.faces, face_values=values)
            (folder / "job.json").write_text(
                json.dumps([[filter_name, dict(given)] for filter_name, given in filters]), encoding="utf-8"
            )
            _run_child(folder, time_limit, memory_limit)
            result = _read_result(folder / "output.npz")
    except OSError as problem:
        raise MeshError(
            f"MeshLab could not be given the mesh, because {in_words(problem)} ({tempfile.gettempdir()})."
        ) from problem
    return result.vertices, result.faces


def close_holes(
    mesh: TriangleMesh,
    loops: Sequence[BoundaryLoop],
    edge_length: float,
    *,
    time_limit: float = TIME_LIMIT,
    memory_limit: int = MEMORY_LIMIT,
) -> tuple[FloatArray, IntArray]:
    """Close the given holes with MeshLab's ``meshing_close_holes``, refined to edges of about ``edge_length``.

    Which of the holes are closed is up to MeshLab: it leaves those that it cannot close without self-intersection.

    Returns:
        vertices and faces; those of ``mesh`` come first, unchanged.

    Raises:
        MeshError: as for :func:`run_filters`, and when MeshLab changed the mesh around the holes.
    """
    at_rim = np.zeros(mesh.n_vertices, dtype=bool)
    for loop in loops:
        at_rim[loop.vertices] = True
    values: FloatArray = np.where(at_rim[mesh.faces].any(axis=1), 1.0, 0.0)
    largest = max((loop.n_edges for loop in loops), default=0)
    filters: list[Filter] = [
        ("compute_selection_by_condition_per_face", {"condselect": "fq > 0.5"}),
        (
            "meshing_close_holes",
            {
                "maxholesize": largest + 1,
                "selected": True,
                "selfintersection": True,
                "refinehole": True,
                "refineholeedgelen": {"length": edge_length},
            },
        ),
    ]
    vertices, faces = run_filters(mesh, filters, face_values=values, time_limit=time_limit, memory_limit=memory_limit)
    is_kept = np.array_equal(faces[: mesh.n_faces], mesh.faces) and np.array_equal(vertices[: mesh.n_vertices], mesh.vertices)
    if not is_kept:
        raise MeshError("MeshLab changed the mesh around the holes.")
    return vertices, faces


def _read_result(path: Path) -> TriangleMesh:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return TriangleMesh(arrays["vertices"], arrays["faces"])
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile, MemoryError, MeshError) as problem:
        raise MeshError("MeshLab returned no valid mesh.") from problem


def _run_child(folder: Path, time_limit: float, memory_limit: int) -> None:
    # -P keeps the folder of this package, with its modules of plain names, off the child's import path.
    command = [sys.executable, "-P", str(_WORKER), str(folder), str(memory_limit)]
    # Each BLAS thread reserves address space, which the limit counts.
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    try:
        # Into a file: whatever a child gone wild says, this process does not hold it in memory.
        with (folder / _SAID).open("wb") as said:
            child = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=said, cwd=folder, env=environment
            )
    except OSError as problem:
        raise MeshError(f"MeshLab could not be started: {in_words(problem)}.") from problem
    try:
        _limit(child.pid, memory_limit)
        code = child.wait(time_limit)
    except subprocess.TimeoutExpired as problem:
        raise MeshError(f"MeshLab was stopped, because it took longer than {time_limit:g} seconds.") from problem
    finally:
        if child.poll() is None:
            child.kill()
        child.wait()
    if code == 0:
        return
    words = _last_words(folder / _SAID)
    if code == 5 or (code not in (3, 4) and any(sign in words for sign in _SIGNS_OF_NO_MEMORY)):
        raise MeshError(f"MeshLab needed more than {memory_limit / 2**30:.3g} GB of memory.")
    if code not in (3, 4):
        raise MeshError(f"MeshLab crashed ({_cause_of_death(code)}).")
    lines = words.strip().splitlines()
    said_last = lines[-1].strip().rstrip(".") if lines else "it gave no reason"
    if code == 3:
        raise MeshError(f"MeshLab cannot be used here ({said_last}). Install it with 'pip install pymeshlab'.")
    raise MeshError(f"MeshLab could not do it: {said_last}.")


def _limit(process: int, memory_limit: int) -> None:
    """Limit a child from outside as well, where the system can: in memory, and in what it may write to a file."""
    if sys.platform != "linux":
        return
    import resource

    for kind, most in ((resource.RLIMIT_AS, memory_limit), (resource.RLIMIT_FSIZE, _LARGEST_FILE)):
        try:
            hard = resource.prlimit(process, kind)[1]
            resource.prlimit(process, kind, (most if hard < 0 else min(most, hard), hard))
        except (OSError, ValueError):
            return  # it has ended already


def _last_words(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _LAST_WORDS))
        return file.read(_LAST_WORDS).decode("utf-8", errors="replace")


def _cause_of_death(exit_code: int) -> str:
    try:
        return signal.Signals(-exit_code).name
    except ValueError:
        return f"exit code {exit_code}"
