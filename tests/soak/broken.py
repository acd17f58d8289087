"""Reads every broken or odd file of :mod:`tests.dmp.formats.broken_files` in a process with limits."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tests.dmp.formats.broken_files import Broken, broken_files
from tests.dmp.formats.samples import ALL_SAMPLES
from tests.soak import Result
from tests.soak.reading import Child, Mesh, left_mesh

FULL_SIZE = 1


def run(size: int, seed: int) -> Result:
    """Read all files ``size`` times; the seed means nothing."""
    child = Child()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def read(path: Path) -> tuple[dict[str, Any], Mesh | None]:
            told = child.read(path)
            return told, left_mesh(folder) if told["outcome"] == "read" else None

        total, failures = check(folder, read, (file for _ in range(size) for file in broken_files()))
    child.close()
    return Result(
        "broken and odd files of every known kind are refused in words or read rightly", total - len(failures), total, failures
    )


def check(
    folder: Path, read: Callable[[Path], tuple[dict[str, Any], Mesh | None]], files: Iterable[Broken]
) -> tuple[int, tuple[str, ...]]:
    """Read files and compare what happens with what must happen.

    Args:
        folder: where the files are written, one at a time.
        read: reads one; returns what happened as :func:`tests.soak.reading_child.answer` tells it, and the mesh.
        files: what to read.

    Returns:
        How many files there were, and a sentence for each with which something else happened.
    """
    good: dict[str, Mesh | None] = {"": None}
    for name, content in ALL_SAMPLES.items():
        (folder / name).write_bytes(content)
        good[name] = read(folder / name)[1]
    total, failures = 0, []
    for name, content, expected, origin in files:
        path = folder / name
        path.write_bytes(content)
        told, mesh = read(path)
        path.unlink()
        total += 1
        if not _is_as_expected(told, mesh, expected, good[origin]):
            failures.append(
                f"{name}: {told['outcome']} instead of {expected}. {told['text']} {' '.join(told['notes'])}".strip()
            )
    return total, tuple(failures)


def _is_as_expected(told: dict[str, Any], mesh: Mesh | None, expected: str, good: Mesh | None) -> bool:
    if told["outcome"] == "refused":
        return expected != "same"
    if mesh is None or expected == "refused":
        return False
    same = good is None or (np.array_equal(mesh[0], good[0]) and np.array_equal(mesh[1], good[1]))
    if expected == "same":
        return same
    doubtful = any("cut off" in note or "may be damaged" in note for note in told["notes"])
    return (same and good is not None) or doubtful
