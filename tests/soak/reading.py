"""Injures good files of every kind thousands of times and reads them in a process with limits.

Each injured file must be refused in words, or be read as what its bytes say, within five seconds and one gigabyte. What
was read is compared with a second, plain reader that shares no code with the first (:mod:`tests.soak.plain_readers`),
where that has no opinion with trimesh, and where a file has lost its end, with the good file. A mesh that differs from
all of them, without a word to the user, is silent damage.

``python -m tests.soak.reading --mutations 2000 --seed 1`` reads 2,000 injured files of each kind.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import select
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.dmp.formats.samples import ALL_SAMPLES
from tests.soak import Result
from tests.soak.injuries import ENDINGS, injure
from tests.soak.plain_readers import read_plainly

FULL_SIZE = 2000
SECONDS = 5.0
MEMORY = 10**9
# Starting Python and loading NumPy, on a machine that is busy.
_STARTING_SECONDS = 60.0
_ROOT = Path(__file__).resolve().parents[2]
# Beyond twelve digits, placing a mesh is rounding.
_TOLERANCE = 1e-12
Mesh = tuple[np.ndarray, np.ndarray]
GOOD = ("refused", "unchanged", "as its bytes say", "as trimesh reads it", "told to be doubtful")
BAD = ("crash", "hang", "foreign exception", "silent damage")


@dataclass
class Tally:
    """What became of the injured files of one kind, and a sentence for each that went wrong."""

    counts: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)

    @property
    def total(self) -> int:
        """How many files were read."""
        return sum(self.counts.values())

    @property
    def passed(self) -> int:
        """How many of them were refused in words or read rightly."""
        return sum(self.counts[outcome] for outcome in GOOD)


class Child:
    """A process that reads files, started anew when it dies or takes too long."""

    def __init__(self, memory: int = MEMORY, seconds: float = SECONDS) -> None:
        self._memory, self._seconds = memory, seconds
        self._process: subprocess.Popen[bytes] | None = None

    def read(self, path: Path) -> dict[str, Any]:
        """Return what the process tells of a file; its outcome is "crash" or "hang" when it does not come so far."""
        if self._process is None:
            command = [sys.executable, "-m", "tests.soak.reading_child", str(self._memory)]
            environment = {**os.environ, "OMP_NUM_THREADS": "1"}
            self._process = subprocess.Popen(
                command, cwd=_ROOT, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
            limit = self._seconds + _STARTING_SECONDS
        else:
            limit = self._seconds
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(f"{path}\n".encode())
            self._process.stdin.flush()
        ready, _, _ = select.select([self._process.stdout], [], [], limit)
        line = self._process.stdout.readline() if ready else b""
        if line.endswith(b"\n"):
            found: dict[str, Any] = json.loads(line)
            return found if found["seconds"] < self._seconds else {**found, "outcome": "hang"}
        self.close()
        return {"outcome": "crash" if ready else "hang", "text": "", "notes": []}

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


def run(size: int, seed: int) -> Result:
    """Read ``size`` injured files of each kind."""
    tallies = read_injured(size, seed)
    failures = tuple(failure for tally in tallies.values() for failure in tally.failures)
    passed, total = (sum(getattr(tally, what) for tally in tallies.values()) for what in ("passed", "total"))
    return Result(f"injured files of {len(tallies)} kinds are refused in words or read rightly", passed, total, failures)


def read_injured(
    size: int, seed: int, names: tuple[str, ...] = tuple(ALL_SAMPLES), keep: Path | None = None
) -> dict[str, Tally]:
    """Read ``size`` injured files of each of the samples ``names``; files that go wrong are copied to ``keep``."""
    tallies: dict[str, Tally] = {}
    child = Child()
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            tallies[name] = tally = Tally()
            whole = _read_good(child, Path(folder), name)
            for index in range(size):
                content, injuries = injure(name, ALL_SAMPLES[name], seed, index)
                path = Path(folder) / name
                path.write_bytes(content)
                told = child.read(path)
                mesh = left_mesh(Path(folder)) if told["outcome"] == "read" else None
                outcome = judge(told, mesh, whole, content, name, injuries)
                tally.counts[outcome] += 1
                if outcome in BAD:
                    tally.failures.append(
                        f"{name}, seed {seed}, number {index} ({', '.join(injuries)}): {outcome}. {told['text']}"
                    )
                    if keep is not None:
                        keep.mkdir(parents=True, exist_ok=True)
                        (keep / f"{outcome.replace(' ', '_')}_{index}_{name}").write_bytes(content)
    child.close()
    return tallies


def _read_good(child: Child, folder: Path, name: str) -> Mesh:
    path = folder / name
    path.write_bytes(ALL_SAMPLES[name])
    told = child.read(path)
    if told["outcome"] != "read":
        raise AssertionError(f"the good file {name} is not read: {told}")
    return left_mesh(folder)


def left_mesh(folder: Path) -> Mesh:
    """Return the mesh that the process left in a folder."""
    with np.load(folder / "mesh.npz") as arrays:
        return arrays["vertices"], arrays["faces"]


def judge(told: dict[str, Any], mesh: Mesh | None, whole: Mesh, content: bytes, name: str, injuries: tuple[str, ...]) -> str:
    """Return one of the outcomes :data:`GOOD` and :data:`BAD`.

    Args:
        told: what the process told of the file.
        mesh: the vertices and faces that were read, None without any.
        whole: vertices and faces of the good file.
        content: the injured file.
        name: of the good file.
        injuries: the names of what was done to it.
    """
    if told["outcome"] == "foreign":
        return "foreign exception"
    if mesh is None:
        return str(told["outcome"])
    vertices, faces = mesh
    if not np.isfinite(vertices).all() or not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        return "silent damage"
    if vertices.shape == whole[0].shape and np.array_equal(vertices, whole[0]) and np.array_equal(faces, whole[1]):
        return "unchanged"
    if any(
        "cut off" in note or "may be damaged" in note or "does not tell what is to be built" in note for note in told["notes"]
    ):
        return "told to be doubtful"
    lost_its_end = set(injuries) <= {kind.__name__ for kind in ENDINGS}
    if lost_its_end and not _may_end_here(content):
        return "silent damage"
    try:
        points, polygons = read_plainly(content)
    except Exception:  # the plain reader may raise anything
        points, polygons = [], []
    if points and same_mesh(vertices, faces, np.array(points), polygons):
        return "as its bytes say"
    return "as trimesh reads it" if _trimesh_agrees(vertices, faces, content, name) else "silent damage"


def _may_end_here(content: bytes) -> bool:
    """Tell whether a file of this format may end just here: OBJ after any line, legacy VTK after any section."""
    is_sectioned = content.startswith(b"# vtk") or not content.startswith((b"ply", b"glTF", b"PK", b"<", b"{"))
    return is_sectioned and content.endswith(b"\n")


def same_mesh(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, polygons: list[list[int]]) -> bool:
    """Tell whether a mesh is what points (V, 3) and polygons say, in their order, without what has no area or no face.

    Faces with fewer than three different corners and points without a face may be missing from the mesh. A polygon with
    more than three corners may be split in any way: the edges of its triangles, each with a direction, must cancel out
    inside and leave the outline.
    """
    corners = [_without_repetitions(polygon) for polygon in polygons]
    corners = [polygon for polygon in corners if len(set(polygon)) >= 3]
    if any(not 0 <= corner < len(points) for polygon in corners for corner in polygon):
        return False
    soup = vertices[faces]
    taken = 0
    used: set[int] = set()
    for polygon in corners:
        found = _split_into(points, polygon, soup[taken : taken + len(polygon) - 2])
        if found is None:
            return False
        taken += found[0]
        # A polygon that comes back to a corner may fold up to nothing there; the others keep all of their corners.
        used |= set(polygon) if len(set(polygon)) == len(polygon) else found[1]
    scale = max(float(np.abs(points).max()), 1e-300)
    expected = points[sorted(used)]
    return (
        taken == len(faces)
        and expected.shape == vertices.shape
        and bool((np.abs(expected - vertices) <= _TOLERANCE * scale).all())
    )


def _without_repetitions(polygon: list[int]) -> list[int]:
    return [corner for position, corner in enumerate(polygon) if corner != polygon[(position + 1) % len(polygon)]]


def _split_into(points: np.ndarray, polygon: list[int], triangles: np.ndarray) -> tuple[int, set[int]] | None:
    """Return into how many of the triangles (n, 3, 3) a polygon was split, and their corners; None if they do not fit."""
    scale = max(float(np.abs(points).max()), 1e-300)
    corners = points[polygon]
    outline = Counter(zip(polygon, polygon[1:] + polygon[:1], strict=True))
    # Triangles that use a corner twice were left out, which leaves the outline as it is.
    for n in range(min(len(triangles), len(polygon) - 2), -1, -1):
        edges: Counter[tuple[int, int]] = Counter()
        for triangle in triangles[:n]:
            distances = np.abs(triangle[:, None] - corners[None]).max(axis=2)
            if (distances.min(axis=1) > _TOLERANCE * scale).any():
                break
            a, b, c = (polygon[int(row.argmin())] for row in distances)
            edges.update([(a, b), (b, c), (c, a)])
        else:
            if _net(edges, points) == _net(outline, points):
                return n, {corner for edge in edges for corner in edge}
    return None


def _net(edges: Counter[tuple[int, int]], points: np.ndarray) -> dict[tuple[tuple[float, ...], tuple[float, ...]], int]:
    """Return edges with their directions, opposite ones cancelled; corners are told apart by their places."""
    net: Counter[tuple[tuple[float, ...], tuple[float, ...]]] = Counter()
    for (a, b), times in edges.items():
        p, q = tuple(points[a].tolist()), tuple(points[b].tolist())
        if p != q:
            net[min((p, q), (q, p))] += times if p < q else -times
    return {edge: times for edge, times in net.items() if times}


def _trimesh_agrees(vertices: np.ndarray, faces: np.ndarray, content: bytes, name: str) -> bool:
    try:
        import trimesh

        other = trimesh.load(io.BytesIO(content), file_type=Path(name).suffix[1:], process=False)
        other = other.to_mesh() if hasattr(other, "to_mesh") else other
        theirs, ours = (_sorted_soup(points, corners) for points, corners in ((other.vertices, other.faces), (vertices, faces)))
    except Exception:  # it raises anything for damaged files, and does not know all formats
        return False
    return theirs.shape == ours.shape and np.allclose(theirs, ours, rtol=1e-6, atol=1e-6 * float(np.abs(ours).max()))


def _sorted_soup(vertices: Any, faces: Any) -> np.ndarray:
    """Return the corners of all triangles with an area, (F, 9), in an order that does not depend on that of the file."""
    soup = np.asarray(vertices, dtype=float)[np.asarray(faces)]
    a, b, c = soup[:, 0], soup[:, 1], soup[:, 2]
    different = (a != b).any(axis=1) & (b != c).any(axis=1) & (c != a).any(axis=1)
    flat = soup[different].reshape(-1, 9)
    return flat[np.lexsort(flat.round(4).T)]


def main() -> int:
    """Read injured files as the command line tells, print a table, and return 1 when anything went wrong."""
    parser = argparse.ArgumentParser(description="Read injured mesh files in a process with limits.")
    parser.add_argument("--mutations", type=int, default=FULL_SIZE, help="injured files of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", choices=tuple(ALL_SAMPLES), default=tuple(ALL_SAMPLES), help="kinds to read")
    parser.add_argument("--json", type=Path, help="write the numbers here")
    parser.add_argument("--keep", type=Path, help="copy files that go wrong to this folder")
    arguments = parser.parse_args()
    tallies = read_injured(arguments.mutations, arguments.seed, tuple(arguments.only), arguments.keep)
    for name, tally in tallies.items():
        outcomes = ", ".join(f"{count:,} {outcome}" for outcome, count in tally.counts.most_common())
        print(f"{name}: {tally.passed:,} of {tally.total:,} ({outcomes})")
    for tally in tallies.values():
        print(*tally.failures, sep="\n", end="\n" if tally.failures else "")
    passed, total = (sum(getattr(tally, what) for tally in tallies.values()) for what in ("passed", "total"))
    print(f"{passed:,} of {total:,}, seed {arguments.seed}")
    if arguments.json:
        numbers = {name: {**tally.counts, "failures": tally.failures} for name, tally in tallies.items()}
        content = {"seed": arguments.seed, "mutations": arguments.mutations, "passed": passed, "total": total, "kinds": numbers}
        arguments.json.write_text(json.dumps(content, indent=1), encoding="utf-8")
    return 0 if passed == total else 1


if __name__ == "__main__":
    sys.exit(main())
