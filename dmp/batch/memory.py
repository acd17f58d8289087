"""How much memory a job needs, foreseen from the size of its file, and how much there is."""

from __future__ import annotations

from dmp.batch.jobs import BatchJob
from dmp.memory import free_memory
from dmp.memory_needs import memory_needed
from dmp.settings import Settings

# Python, torch and dask in one worker process, before any mesh.
_PROCESS_BYTES = 400 * 2**20
# How few bytes of a file may stand for one vertex with its two faces, by format; text has more.
_FILE_BYTES_PER_VERTEX = {
    ".ply": 36,
    ".obj": 50,
    ".stl": 100,
    ".off": 40,
    ".glb": 24,
    ".gltf": 24,
    ".vtp": 15,
    ".vtk": 36,
    ".3mf": 8,
}
# The share of the free memory that is planned with.
_SHARE = 0.8
# Where the system does not say.
_UNKNOWN_FREE = 4 * 2**30


def most_vertices(job: BatchJob) -> int:
    """Return a number of vertices that the mesh of a job hardly has more of, judging by its file."""
    size = job.file_bytes
    if job.mesh.suffix.lower() == ".gltf":
        # The numbers lie beside it.
        size += sum(path.stat().st_size for path in job.mesh.parent.glob(f"{job.mesh.stem}*.bin"))
    return size // _FILE_BYTES_PER_VERTEX.get(job.mesh.suffix.lower(), 24)


def bytes_needed(n_vertices: int, settings: Settings) -> int:
    """Return about how many bytes a worker needs at most to train on a mesh of ``n_vertices``.

    A training that may take less than it likes to takes a longer way.
    """
    needed = _PROCESS_BYTES + memory_needed(settings, n_vertices)
    return min(needed, int(settings.memory * 1e9)) if settings.memory else needed


def free_bytes() -> int:
    """Return how many bytes can be planned with on this computer: most of what is free, within the limits set for us."""
    found = free_memory()
    return int(_SHARE * (_UNKNOWN_FREE if found is None else found))
