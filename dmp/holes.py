"""Fill the holes of a mesh: which boundaries are closed, which are left open and why, and what was inserted where."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from dmp.boundary import BoundaryLoop, boundary_loops, outer_rims
from dmp.errors import MeshError
from dmp.hole_filling.adoption import Proposal, adopted, meshlab_proposals
from dmp.hole_filling.checking import CannotCloseError
from dmp.hole_filling.closing import close_hole, finished, surroundings
from dmp.hole_filling.growth import FacesAtVertices, GrowingMesh
from dmp.hole_filling.patch import Patch, half_edges
from dmp.mesh import BoolArray, IntArray, TriangleMesh, read_only

Method = Literal["auto", "own", "meshlab"]

_MOST_REMARKS = 5

OUTER_RIM = "It is the outer rim of an open surface."


@dataclass(frozen=True, eq=False)
class FilledHole:
    """What closed one hole.

    Attributes:
        loop: the boundary that was there.
        vertices: indices of the inserted vertices in the filled mesh, (k,); none for a small hole.
        faces: indices of the inserted faces in the filled mesh, (m,).
        method: who triangulated and refined it, ``"own"`` or ``"meshlab"``; the fairing is always ours.
        remarks: what did not go as planned, as the end of a sentence that begins with "The hole".
    """

    loop: BoundaryLoop
    vertices: IntArray
    faces: IntArray
    method: Literal["own", "meshlab"]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class OpenBoundary:
    """A boundary that was left open, and why, in one sentence."""

    loop: BoundaryLoop
    reason: str


@dataclass(frozen=True, eq=False)
class FilledMesh:
    """A mesh with its holes filled.

    Attributes:
        mesh: the vertices and faces of the input first, unchanged and in their order, then the inserted ones.
        inserted_vertices: (V,) bool, True for inserted vertices.
        inserted_faces: (F,) bool, True for inserted faces.
        patches: one entry for each hole that was filled, in the order of the loops.
        left_open: one entry for each boundary that was not, in the order of the loops.
        notes: full sentences for the user about what was filled, what was left open, and every fallback.
    """

    mesh: TriangleMesh
    inserted_vertices: BoolArray
    inserted_faces: BoolArray
    patches: tuple[FilledHole, ...]
    left_open: tuple[OpenBoundary, ...]
    notes: tuple[str, ...] = field(default=())


def fill_holes(
    mesh: TriangleMesh,
    loops: Sequence[BoundaryLoop] | None = None,
    max_hole_edges: int | None = None,
    method: Method = "auto",
) -> FilledMesh:
    """Close the holes of ``mesh`` (Liepa 2003): triangulate, refine to the density around, make fair.

    Args:
        mesh: the mesh with holes.
        loops: the boundaries of ``mesh`` to close, from :func:`dmp.boundary.boundary_loops`; by default all but the outer
            rims of open surfaces.
        max_hole_edges: leave boundaries with more edges open; None for no limit.
        method: ``"own"`` and ``"auto"`` triangulate and refine here. ``"meshlab"`` asks MeshLab for that, and
            does it here, with a note, where MeshLab fails.

    Returns:
        the filled mesh; the input itself if there is nothing to fill.

    Raises:
        MeshError: when the mesh has no faces, ``loops`` do not belong to it, or ``method`` or ``max_hole_edges`` is
            none of the above.
    """
    if method not in ("auto", "own", "meshlab"):
        raise MeshError(f"Holes can be filled with the method auto, own or meshlab, not '{method}'.")
    if max_hole_edges is not None and max_hole_edges < 3:
        raise MeshError(f"The largest hole to be filled has to have at least 3 edges, not {max_hole_edges}.")
    if mesh.n_faces == 0:
        raise MeshError("The mesh has no faces, so it has no holes either.")
    candidates = boundary_loops(mesh) if loops is None else tuple(loops)
    if loops is not None:
        _check_loops(mesh, candidates)
    reasons = _reasons_to_leave(mesh, candidates, max_hole_edges, is_own_choice=loops is None)
    chosen = [index for index in range(len(candidates)) if index not in reasons]

    work = _Filling(mesh, method)
    results: dict[int, FilledHole] = {}
    for group in _separate(candidates, chosen):
        done, failed = work.fill({index: candidates[index] for index in group})
        results |= done
        reasons |= failed

    filled = work.growing.mesh()
    patches = tuple(results[index] for index in sorted(results))
    left_open = tuple(OpenBoundary(candidates[index], reasons[index]) for index in sorted(reasons))
    return FilledMesh(
        mesh=filled,
        inserted_vertices=read_only(np.arange(filled.n_vertices) >= mesh.n_vertices, np.bool_),
        inserted_faces=read_only(np.arange(filled.n_faces) >= mesh.n_faces, np.bool_),
        patches=patches,
        left_open=left_open,
        notes=_notes(patches, left_open, work.notes),
    )


def _check_loops(mesh: TriangleMesh, loops: Sequence[BoundaryLoop]) -> None:
    if not loops:
        return
    wanted = np.concatenate([loop.edges for loop in loops])
    is_proper = (mesh.faces != mesh.faces[:, [1, 2, 0]]).all(axis=1)
    start, end = half_edges(mesh.faces[is_proper])
    existing = start * mesh.n_vertices + end
    is_inside = wanted.size and wanted.min() >= 0 and wanted.max() < mesh.n_vertices
    if is_inside:
        keys = wanted[:, 0] * mesh.n_vertices + wanted[:, 1]
        reverse = wanted[:, 1] * mesh.n_vertices + wanted[:, 0]
        simple = np.concatenate([np.full(loop.n_edges, loop.is_simple) for loop in loops])
        is_inside = np.isin(keys, existing).all() and not np.isin(reverse[simple], existing).any()
    if not is_inside or len(np.unique(keys)) < len(keys):
        raise MeshError("The holes to be filled are no boundaries of this mesh. List the boundaries of the mesh itself again.")


def _reasons_to_leave(
    mesh: TriangleMesh, loops: Sequence[BoundaryLoop], max_hole_edges: int | None, is_own_choice: bool
) -> dict[int, str]:
    reasons = {index: loop.problem for index, loop in enumerate(loops) if not loop.is_simple}
    if is_own_choice:
        reasons |= dict.fromkeys(outer_rims(mesh, loops), OUTER_RIM)
    for index, loop in enumerate(loops):
        if index not in reasons and max_hole_edges is not None and loop.n_edges > max_hole_edges:
            reasons[index] = f"It has {loop.n_edges:,} edges, and only holes with up to {max_hole_edges:,} are to be filled."
    return reasons


def _separate(loops: Sequence[BoundaryLoop], chosen: list[int]) -> Iterator[list[int]]:
    """Yield groups of loops that share no vertex, so that the second of two touching holes sees how the first was filled."""
    waiting = chosen
    while waiting:
        used: set[int] = set()
        group, later = [], []
        for index in waiting:
            vertices = loops[index].vertices.tolist()
            if used.isdisjoint(vertices):
                group.append(index)
                used.update(vertices)
            else:
                later.append(index)
        yield group
        waiting = later


def _notes(patches: Sequence[FilledHole], left_open: Sequence[OpenBoundary], notes: Sequence[str]) -> tuple[str, ...]:
    if not patches and not left_open:
        return ("The mesh has no holes.",)
    n_vertices = sum(len(patch.vertices) for patch in patches)
    n_faces = sum(len(patch.faces) for patch in patches)
    what = f"{len(patches):,} {'hole' if len(patches) == 1 else 'holes'}"
    first = f"Filled {what} with {n_vertices:,} vertices and {n_faces:,} faces." if patches else "No hole was filled."
    by_reason: dict[str, list[OpenBoundary]] = {}
    for boundary in left_open:
        by_reason.setdefault(boundary.reason, []).append(boundary)
    open_notes = []
    for reason, group in by_reason.items():
        edges = f"{group[0].loop.n_edges:,} edges" if len(group) == 1 else f"up to {max(b.loop.n_edges for b in group):,} edges"
        who = "A boundary" if len(group) == 1 else f"{len(group):,} boundaries"
        open_notes.append(f"{who} of {edges} {'was' if len(group) == 1 else 'were'} left open: {reason}")
    remarks = [
        f"The hole of {patch.loop.n_edges:,} edges at vertex {int(patch.loop.vertices[0])} {remark}."
        for patch in patches
        for remark in patch.remarks
    ]
    if len(remarks) > _MOST_REMARKS:
        more = len(remarks) - _MOST_REMARKS
        remarks = [
            *remarks[:_MOST_REMARKS],
            f"There {'is' if more == 1 else 'are'} {more:,} more such remarks about single holes.",
        ]
    return (first, *open_notes, *notes, *remarks)


class _Filling:
    """One call of :func:`fill_holes` at work."""

    def __init__(self, mesh: TriangleMesh, method: Method) -> None:
        self.growing = GrowingMesh(mesh)
        self.method = method
        self.notes: list[str] = []

    def fill(self, loops: Mapping[int, BoundaryLoop]) -> tuple[dict[int, FilledHole], dict[int, str]]:
        """Fill loops that share no vertex; return what was filled, and the reasons why others were not."""
        mesh = self.growing.mesh()
        proposals: dict[int, Proposal] = {}
        if self.method == "meshlab":
            try:
                proposals = meshlab_proposals(mesh, loops)
            except MeshError as problem:
                self.notes.append(f"{problem} The holes were filled without it.")
        faces_at = FacesAtVertices(mesh.faces, np.concatenate([loop.vertices for loop in loops.values()]), mesh.n_vertices)
        filled, reasons = {}, {}
        for index, loop in loops.items():
            # The patch runs around its rim the other way than the faces outside.
            rim = loop.vertices[::-1]
            start, names = surroundings(mesh.vertices, faces_at(rim), rim)
            proposal = proposals.get(index)
            foreign = None if proposal is None else adopted(start, names, proposal, mesh.n_vertices)
            try:
                filled[index] = self._filled(loop, start, names, foreign)
            except CannotCloseError as problem:
                reasons[index] = str(problem)
        return filled, reasons

    def _filled(self, loop: BoundaryLoop, start: Patch, names: IntArray, foreign: Patch | None) -> FilledHole:
        if foreign is not None:
            with contextlib.suppress(CannotCloseError):
                patch, remarks = finished(foreign)
                return FilledHole(loop, *self.growing.add(patch, names), "meshlab", tuple(remarks))
        patch, remarks = close_hole(start)
        if self.method == "meshlab":
            remarks = ["was filled without MeshLab, which could not close it properly", *remarks]
        return FilledHole(loop, *self.growing.add(patch, names), "own", tuple(remarks))
