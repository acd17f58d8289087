"""Mends what can be mended in a mesh without changing its shape, and says what was done.

What is always done loses nothing of the surface: vertices at the same place become one, except where that would make the
surface branch; faces that are there twice or have no area go, faces look the same way as their neighbours and closed pieces
outwards, and vertices without a face go. What changes the mesh as such is done when it is asked for. Repairing a repaired mesh
in the same way changes nothing more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from dmp.cap_removal import remove_flat_faces
from dmp.errors import MeshError
from dmp.geometry import mean_edge_length
from dmp.joining import duplicate_rows, join_copies, take_apart
from dmp.mesh import BoolArray, IntArray, TriangleMesh
from dmp.orientation import orientation
from dmp.topology import adjacency, connected_vertices, unique_edges

_MOST_ROUNDS = 12


@dataclass(frozen=True)
class RepairOptions:
    """What to do beyond what is always done.

    Attributes:
        weld: vertices nearer than this, in mean edge lengths, become one; 0 joins only those at the very same place.
        split: take branching surfaces apart, so that each edge has at most two faces and each vertex one fan of them.
        keep_pieces: keep only so many separate pieces, those with the most faces; 0 keeps all.
        fewest_faces: drop separate pieces with fewer faces.
    """

    weld: float = 0.0
    split: bool = False
    keep_pieces: int = 0
    fewest_faces: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.weld < 1:
            raise MeshError(
                f"The distance within which vertices are joined is {self.weld:g}; it must be at least 0 and below 1."
            )
        if self.keep_pieces < 0 or self.fewest_faces < 0:
            raise MeshError("The numbers of pieces and faces to keep must not be negative.")


@dataclass(frozen=True)
class Change:
    """One thing that repair did: a name for code, how often, and a sentence about it."""

    kind: str
    count: int
    text: str


@dataclass(frozen=True, eq=False)
class Repaired:
    """A mended mesh.

    Attributes:
        mesh: the mesh; the one that was given when nothing had to be done.
        changes: what was done, in the order of doing.
        vertex_source: the vertex of the given mesh that each vertex comes from, (V,) int64.
    """

    mesh: TriangleMesh
    changes: tuple[Change, ...]
    vertex_source: IntArray


def repair(mesh: TriangleMesh, options: RepairOptions | None = None) -> Repaired:
    """Mend ``mesh`` as ``options`` say; positions stay as they are, attributes go with their vertices.

    Raises:
        MeshError: when no face would be left.
    """
    options = options or RepairOptions()
    done = _Work(mesh, mesh.faces, np.arange(mesh.n_vertices))
    for _ in range(_MOST_ROUNDS):
        # One thing mended can bring about another: without a dropped piece the mean edge may be longer, and more is welded.
        work = _Work(mesh, done.faces, done.source)
        _mend(work, options)
        if work.equals(done):
            # Vertices that were split are joined and split again; in the end nothing has changed.
            break
        work.take_notes_of(done)
        done = work
    attributes = {name: values[done.source] for name, values in mesh.vertex_attributes.items()}
    changes = done.changes()
    return Repaired(TriangleMesh(done.positions, done.faces, attributes) if changes else mesh, changes, done.source)


def _mend(work: _Work, options: RepairOptions) -> None:
    for _ in range(_MOST_ROUNDS):
        before = len(work.faces), work.n_vertices, work.n_done
        _merge_vertices(work, options.weld)
        _drop_collapsed(work)
        _drop_duplicates(work)
        _drop_flat(work)
        if (len(work.faces), work.n_vertices, work.n_done) == before:
            break
    if not len(work.faces):
        smaller = " Join only vertices that are nearer to each other." if options.weld else ""
        raise MeshError(f"Nothing would be left of this mesh: no face would have an area.{smaller}")
    if options.split:
        _take_apart(work)
    _drop_pieces(work, options)
    _orient(work)
    _drop_isolated(work)


class _Work:
    """A mesh in the making: faces over vertices that each stand for one of the given mesh."""

    def __init__(self, mesh: TriangleMesh, faces: IntArray, source: IntArray) -> None:
        self.given = mesh
        self.faces = faces
        self.source = source
        self._counts: dict[str, int] = {}
        self._texts: dict[str, tuple[str, str]] = {}

    @property
    def n_vertices(self) -> int:
        return len(self.source)

    @property
    def positions(self) -> NDArray[np.float64]:
        return self.given.vertices[self.source]

    @property
    def n_done(self) -> int:
        return sum(self._counts.values())

    def note(self, kind: str, count: int, one: str, many: str) -> None:
        if count:
            self._counts[kind] = self._counts.get(kind, 0) + count
            self._texts[kind] = (one, many)

    def keep_faces(self, kept: BoolArray) -> None:
        self.faces = self.faces[kept]

    def keep_vertices(self, kept: BoolArray) -> None:
        self.faces = (np.cumsum(kept) - 1)[self.faces]
        self.source = self.source[kept]

    def equals(self, other: _Work) -> bool:
        """Whether both are the same mesh: copies of a vertex at its place, with its values, are one as good as the other."""
        if not np.array_equal(self.faces, other.faces) or self.n_vertices != other.n_vertices:
            return False
        values = (self.given.vertices, *self.given.vertex_attributes.values())
        return all(np.array_equal(each[self.source], each[other.source]) for each in values)

    def take_notes_of(self, earlier: _Work) -> None:
        """Add what was done before."""
        counts = {**earlier._counts}
        for kind, count in self._counts.items():
            counts[kind] = counts.get(kind, 0) + count
        self._counts, self._texts = counts, {**earlier._texts, **self._texts}

    def changes(self) -> tuple[Change, ...]:
        """Return what was done, in sentences."""
        changes = []
        for kind, count in self._counts.items():
            one, many = self._texts[kind]
            changes.append(Change(kind, count, f"{one if count == 1 else many.format(f'{count:,}')}."))
        return tuple(changes)


def _merge_vertices(work: _Work, weld: float) -> None:
    positions = work.positions
    target, repeated = duplicate_rows(positions)
    edges = unique_edges(work.faces)
    if weld > 0 and len(edges):
        first = np.setdiff1d(np.arange(len(positions)), repeated)
        distance = weld * mean_edge_length(positions, edges)
        nearest = _first_within(positions[first], distance)
        target = first[nearest][np.searchsorted(first, target)]
    target = join_copies(positions, work.faces, target)
    merged = target != np.arange(len(positions))
    # A vertex without a face is dropped and not merged, so that the counts tell what there was.
    merged &= connected_vertices(work.faces, work.n_vertices)
    if not merged.any():
        return
    differing = sum(
        bool((values[work.source[merged]] != values[work.source[target[merged]]]).any())
        for values in work.given.vertex_attributes.values()
    )
    where = "at the same place" if weld == 0 else f"nearer than {weld:g} mean edge lengths"
    work.note(
        "merged vertices",
        int(merged.sum()),
        f"Joined 1 vertex with another one {where}",
        f"Joined {{}} vertices with others {where}",
    )
    if differing:
        kept = "Of joined vertices with different colours or other values the first one's were kept"
        work.note("differing attributes", differing, kept, kept)
    work.faces = np.where(merged, target, np.arange(len(positions)))[work.faces]
    work.keep_vertices(~merged)


def _first_within(points: NDArray[np.float64], distance: float) -> IntArray:
    """Return for each point (N, 3) the earliest one within ``distance`` that stays itself, (N,).

    Not in chains: whatever is joined to a point lies within the distance of that very point.
    """
    target = np.arange(len(points))
    pairs = cKDTree(points).query_pairs(distance, output_type="ndarray")
    for a, b in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].tolist():
        if target[a] == a and target[b] == b:
            target[b] = a
    return target


def _drop_collapsed(work: _Work) -> None:
    faces = work.faces
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    work.note("degenerate faces", int((~proper).sum()), "Removed 1 face without area", "Removed {} faces without area")
    work.keep_faces(proper)


def _drop_duplicates(work: _Work) -> None:
    repeated = duplicate_rows(np.sort(work.faces, axis=1))[1]
    work.note("duplicate faces", len(repeated), "Removed 1 face that was there twice", "Removed {} faces that were there twice")
    kept = np.ones(len(work.faces), dtype=bool)
    kept[repeated] = False
    work.keep_faces(kept)


def _drop_flat(work: _Work) -> None:
    faces, n_flat = remove_flat_faces(work.positions, work.faces)
    work.note("degenerate faces", n_flat, "Removed 1 face without area", "Removed {} faces without area")
    work.faces = faces


def _take_apart(work: _Work) -> None:
    work.faces, copied = take_apart(work.positions, work.faces, np.ones(work.n_vertices, dtype=bool))
    count = len(copied) - work.n_vertices
    work.source = work.source[copied]
    work.note(
        "split vertices", count, "Split 1 vertex where the surface branches", "Split {} vertices where the surface branches"
    )


def _drop_pieces(work: _Work, options: RepairOptions) -> None:
    if not (options.keep_pieces or options.fewest_faces) or not len(work.faces):
        return
    labels = connected_components(adjacency(work.faces, work.n_vertices), directed=False)[1][work.faces[:, 0]]
    pieces, first, sizes = np.unique(labels, return_index=True, return_counts=True)
    kept = sizes >= options.fewest_faces
    if options.keep_pieces:
        # Of equally large ones those that come first in the file.
        rank = np.empty(len(pieces), dtype=np.int64)
        rank[np.lexsort((first, -sizes))] = np.arange(len(pieces))
        kept &= rank < options.keep_pieces
    if not kept.any():
        raise MeshError(f"No piece of this mesh has {options.fewest_faces:,} faces; the largest has {sizes.max():,}.")
    if kept.all():
        return
    kept_faces = kept[np.searchsorted(pieces, labels)]
    n_faces = int((~kept_faces).sum())
    word = "face" if n_faces == 1 else "faces"
    text = f"with {n_faces:,} {word} in all"
    work.note("dropped pieces", int((~kept).sum()), f"Dropped 1 separate piece {text}", f"Dropped {{}} separate pieces {text}")
    work.keep_faces(kept_faces)


def _orient(work: _Work) -> None:
    turned = orientation(work.positions, work.faces)
    single = int((turned.flips & ~turned.inside_out).sum())
    work.note(
        "turned faces", single, "Turned 1 face round, like those around it", "Turned {} faces round, like those around them"
    )
    work.note(
        "turned pieces",
        turned.n_inside_out,
        "Turned 1 closed piece, which was inside out",
        "Turned {} closed pieces, which were inside out",
    )
    faces = work.faces.copy()
    faces[turned.flips] = faces[turned.flips][:, [0, 2, 1]]
    work.faces = faces


def _drop_isolated(work: _Work) -> None:
    used = np.zeros(work.n_vertices, dtype=bool)
    used[work.faces.ravel()] = True
    count = int((~used).sum())
    work.note("isolated vertices", count, "Removed 1 vertex without a face", "Removed {} vertices without a face")
    work.keep_vertices(used)
