"""The program that :mod:`dmp.meshlab` runs in a process of its own: apply MeshLab filters to one mesh.

It is started by its path and imports nothing of this project, so that a crash, a hang or a clash of libraries here
reaches nobody else. ``meshlab_worker.py FOLDER MEMORY`` reads ``job.json`` and ``input.npz`` in FOLDER and writes
``output.npz``; MEMORY is the most address space in bytes. Exit codes: 0 done, 3 pymeshlab cannot be imported, 4 MeshLab
refused, with the reason as the last line on stderr, 5 out of memory.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any


def main(folder: Path, memory: int) -> int:
    """Do the job described in ``folder`` and return the exit code."""
    _limit_memory(memory)
    try:
        import numpy as np
        import pymeshlab
    except ImportError as problem:
        print(problem, file=sys.stderr)
        # How the loader of shared libraries tells that it got no memory.
        return 5 if "failed to map" in str(problem) or "llocate memory" in str(problem) else 3
    except MemoryError:
        return 5
    job = json.loads((folder / "job.json").read_text(encoding="utf-8"))
    try:
        with np.load(folder / "input.npz", allow_pickle=False) as arrays:
            mesh = pymeshlab.Mesh(
                vertex_matrix=arrays["vertices"], face_matrix=arrays["faces"], f_scalar_array=arrays["face_values"]
            )
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(mesh)
        for name, parameters in job:
            meshes.apply_filter(name, **{key: _value(pymeshlab, value) for key, value in parameters.items()})
        result = meshes.current_mesh()
        np.savez(folder / "output.npz", vertices=result.vertex_matrix(), faces=result.face_matrix())
    except MemoryError:
        return 5
    except Exception as problem:  # MeshLab raises classes of its own, and the caller only passes the text on
        print(problem, file=sys.stderr)
        return 4
    return 0


def _value(pymeshlab: Any, value: Any) -> Any:
    """Turn ``{"length": x}`` and ``{"percentage": x}`` into MeshLab's types; all else stays."""
    if isinstance(value, dict):
        (kind, number), *_ = value.items()
        return pymeshlab.PureValue(number) if kind == "length" else pymeshlab.PercentageValue(number)
    return value


def _limit_memory(memory: int) -> None:
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (memory if hard < 0 else min(memory, hard), hard))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), int(sys.argv[2])))
