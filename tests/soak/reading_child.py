"""Reads files one after the other in a process of its own, with a limit for memory; what happens is told line by line.

Each line on the standard input is the path of a file; each line on the standard output a JSON object about it. A mesh
that was read is left beside the file as ``mesh.npz``.
"""

from __future__ import annotations

import json
import resource
import sys
import time
import traceback
from pathlib import Path

import numpy as np

from dmp.errors import MeshFileError
from dmp.meshio import read_mesh_with_notes


def main(memory: int) -> None:
    """Answer until the input ends; ``memory`` is how many bytes may be taken beyond those at the start."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + memory,) * 2)
    for line in sys.stdin:
        print(json.dumps(answer(Path(line.rstrip("\n")))), flush=True)


def answer(path: Path) -> dict[str, object]:
    """Read one file and return what happened."""
    start = time.perf_counter()
    found: dict[str, object] = {"notes": []}
    try:
        mesh, notes = read_mesh_with_notes(path)
    except MeshFileError as error:
        # A reader that meets an error that it did not foresee tells its class; so does a lack of memory.
        foreign = "the file cannot be read (" in str(error) or "not enough memory" in str(error)
        found |= {"outcome": "foreign" if foreign else "refused", "text": f"{error.cause}. {error.remedy}"}
    except BaseException:
        found |= {"outcome": "foreign", "text": traceback.format_exc(limit=-3)}
    else:
        np.savez(path.parent / "mesh.npz", vertices=mesh.vertices, faces=mesh.faces)
        found |= {"outcome": "read", "notes": list(notes), "text": ""}
    found["seconds"] = time.perf_counter() - start
    return found


if __name__ == "__main__":
    main(int(sys.argv[1]))
