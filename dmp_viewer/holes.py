"""The holes of the open mesh as the window offers them: which there are, and which are to be filled. No widgets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from psygnal import Signal

from dmp.boundary import BoundaryLoop, boundary_loops, outer_rims
from dmp.mesh import FloatArray, TriangleMesh
from dmp.problem import Problem
from dmp.topology import edge_face_counts


@dataclass(frozen=True, eq=False)
class Holes:
    """All boundaries of a mesh.

    Attributes:
        loops: the boundaries, longest first.
        rims: indices of those that are the outer rim of an open surface.
        chosen_at_first: indices of those to be filled unless the user says otherwise.
    """

    loops: tuple[BoundaryLoop, ...] = ()
    rims: frozenset[int] = frozenset()
    chosen_at_first: frozenset[int] = frozenset()

    @property
    def usual_choice(self) -> frozenset[int]:
        """All that can be filled, but no outer rim."""
        return frozenset(index for index, loop in enumerate(self.loops) if loop.is_simple) - self.rims


@dataclass(frozen=True)
class HoleState:
    """What happens to a hole.

    Attributes:
        is_filled: whether it is to be filled.
        can_be_filled: whether the user has the choice.
        text: one or two words; empty for a hole that is simply filled.
        reason: why it is not filled, in full sentences; may be empty.
    """

    is_filled: bool
    can_be_filled: bool
    text: str = ""
    reason: str = ""


class HoleChoice:
    """Which holes of the open mesh are to be filled, and which one is looked at.

    Attributes:
        found: the holes.
        chosen: indices of those that the user wants filled.
        most_edges: larger holes stay open; 0 for no limit.
        failed: indices of those that could not be closed, with the reason.
        pointed: index of the one that is looked at, or None.
    """

    changed = Signal()
    pointed_changed = Signal()

    def __init__(self) -> None:
        self.found = Holes()
        self.chosen: frozenset[int] = frozenset()
        self.most_edges = 0
        self.failed: Mapping[int, str] = {}
        self.pointed: int | None = None

    def set_found(self, found: Holes) -> None:
        """Take in the holes of another mesh with the usual choice."""
        if found is not self.found:
            self.found, self.chosen, self.failed, self.pointed = found, found.chosen_at_first, {}, None
            self.changed.emit()
            self.pointed_changed.emit()

    def set_failed(self, failed: Mapping[int, str]) -> None:
        """Say which holes could not be closed, and why."""
        if dict(failed) != dict(self.failed):
            self.failed = dict(failed)
            self.changed.emit()

    def set_limit(self, most_edges: int) -> bool:
        """Leave larger holes open; tells whether that changes what is filled."""
        before = self.filled
        if most_edges == self.most_edges:
            return False
        self.most_edges = most_edges
        self.changed.emit()
        return self.filled != before

    def choose(self, indices: frozenset[int]) -> None:
        """Fill these holes and no others."""
        if indices != self.chosen:
            self.chosen = indices
            self.changed.emit()

    def switch(self, index: int, filled: bool) -> None:
        """Fill one more hole, or one less."""
        self.choose(self.chosen | {index} if filled else self.chosen - {index})

    def point_at(self, index: int | None) -> None:
        """Look at a hole."""
        if index != self.pointed:
            self.pointed = index
            self.pointed_changed.emit()

    @property
    def filled(self) -> frozenset[int]:
        """Indices of the holes that will be filled."""
        return frozenset(index for index in self.chosen if self._obstacle(index) is None)

    def loops_to_fill(self) -> tuple[BoundaryLoop, ...] | None:
        """Return the loops to fill, or None for the usual choice."""
        # The library makes the usual choice itself, and then also tells what it left open.
        if self.chosen == self.found.usual_choice:
            return None
        return tuple(self.found.loops[index] for index in sorted(self.filled))

    def state(self, index: int) -> HoleState:
        """Return what happens to a hole."""
        obstacle = self._obstacle(index)
        if obstacle is not None:
            return HoleState(False, False, *obstacle)
        if index in self.chosen:
            if index in self.failed:
                return HoleState(True, True, "cannot be filled", self.failed[index])
            return HoleState(True, True)
        if index in self.found.rims:
            return HoleState(False, True, "outer rim", "It is the outer rim of an open surface and is left open.")
        return HoleState(False, True, "left open", "It is left open.")

    def _obstacle(self, index: int) -> tuple[str, str] | None:
        loop = self.found.loops[index]
        if not loop.is_simple:
            return "cannot be filled", f"It cannot be filled: {loop.problem[0].lower()}{loop.problem[1:]}"
        if self.most_edges and loop.n_edges > self.most_edges:
            return "too large", f"It is left open, because only holes with up to {self.most_edges:,} edges are to be filled."
        return None


def find_holes(mesh: TriangleMesh) -> Holes:
    """Find the boundaries of a mesh; takes seconds on a large one."""
    loops = boundary_loops(mesh)
    holes = Holes(loops, frozenset(outer_rims(mesh, loops)))
    return Holes(loops, holes.rims, holes.usual_choice)


def still_open(holes: Holes, mesh: TriangleMesh) -> frozenset[int]:
    """Return which holes are still boundaries of ``mesh``, whose first vertices are those of the mesh with the holes."""
    edges, counts = edge_face_counts(mesh.faces)
    single = edges[counts == 1]
    if not holes.loops or not len(single):
        return frozenset()
    # All at once: a scan can have thousands.
    rims = np.concatenate([loop.edges for loop in holes.loops])
    keys = rims.min(axis=1) * mesh.n_vertices + rims.max(axis=1)
    is_open = np.isin(keys, single[:, 0] * mesh.n_vertices + single[:, 1])
    owner = np.repeat(np.arange(len(holes.loops)), [loop.n_edges for loop in holes.loops])
    return frozenset(np.unique(owner[is_open]).tolist())


def failures(holes: Holes, wanted: frozenset[int], problem: Problem) -> dict[int, str]:
    """Return the wanted holes that were not closed, with the reason as far as it is known."""
    reasons = {note.partition("left open: ")[2] for note in problem.notes if "left open: " in note}
    reason = reasons.pop() if len(reasons) == 1 else "It could not be closed; the message above the meshes says why."
    return dict.fromkeys(sorted(wanted & still_open(holes, problem.mesh)), reason)


def outward(vertices: FloatArray, loop: BoundaryLoop, *, is_rim: bool) -> FloatArray | None:
    """Return the direction out of a hole, (3,) of length 1, or None when the loop has none.

    Faces run around the hole that they surround the other way than around themselves, so the area of a hole points inwards;
    an outer rim surrounds the surface.
    """
    positions = vertices[loop.edges] - loop.center
    area = np.cross(positions[:, 0], positions[:, 1]).sum(axis=0)
    length = float(np.linalg.norm(area))
    if length <= 1e-6 * loop.size**2:
        return None
    return area / length if is_rim else -area / length


@dataclass(frozen=True, eq=False)
class Seam:
    """Where inserted faces meet those of the input.

    Attributes:
        edges: vertex indices of the edges there, (n, 2).
    """

    edges: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))

    @classmethod
    def between(cls, opened: TriangleMesh, filled: TriangleMesh) -> Seam:
        """Return the seam of a filled mesh, whose first faces are those of the opened one."""
        inserted = filled.faces[opened.n_faces :]
        if not len(inserted):
            return cls()
        edges, counts = edge_face_counts(inserted)
        return cls(edges[counts == 1])
