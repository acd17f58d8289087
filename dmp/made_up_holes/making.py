"""Make up holes in the known part of a mesh that resemble the real ones."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dmp.mesh import BoolArray, IntArray

# Rings between two made-up holes, and between one and a real hole, so that each is surrounded by true positions.
_MARGIN = 3
# A hole that fits only this often teaches little; smaller ones are made then.
_ENOUGH = 6
_SMALLEST_RADIUS = 2


def ring_distances(adjacency: sparse.csr_array, sources: BoolArray, most: int = 2**31) -> IntArray:
    """Return the number of edges from each vertex to the nearest source, (V,); -1 beyond ``most`` or out of reach."""
    distances = np.where(sources, 0, -1).astype(np.int64)
    front = np.flatnonzero(sources)
    ring = 0
    while len(front) and ring < most:
        ring += 1
        reached = np.unique(_neighbours(adjacency, front))
        front = reached[distances[reached] < 0]
        distances[front] = ring
    return distances


def _neighbours(adjacency: sparse.csr_array, vertices: IntArray) -> IntArray:
    starts, ends = adjacency.indptr[vertices], adjacency.indptr[vertices + 1]
    counts = ends - starts
    offsets = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return adjacency.indices[np.repeat(starts, counts) + offsets].astype(np.int64)


class HoleMaker:
    """Makes up holes: balls of vertices with about the depth of the real holes, none touching another.

    Attributes:
        depth: rings from the rim of the deepest real hole to its middle.
    """

    def __init__(self, adjacency: sparse.csr_array, known: BoolArray) -> None:
        """Prepare for a graph (V, V) whose ``known`` vertices (V,) hold true positions."""
        self._adjacency = adjacency
        from_known = ring_distances(adjacency, known)
        self.depth = max(1, int(from_known.max(initial=1)))
        self._from_holes = ring_distances(adjacency, ~known)

    def make(self, generator: np.random.Generator) -> BoolArray:
        """Return the vertices of a new set of made-up holes, (V,) bool; empty when not even small ones fit."""
        radius = self.depth
        best = np.zeros(len(self._from_holes), dtype=bool)
        while radius >= _SMALLEST_RADIUS:
            holes, count = self._pack(radius, generator)
            if count >= _ENOUGH:
                return holes
            if holes.any() and not best.any():
                best = holes
            radius //= 2
        return best

    def _pack(self, radius: int, generator: np.random.Generator) -> tuple[BoolArray, int]:
        largest = radius + 1
        # A vertex that is not blocked has room around it for the largest hole, so that none is tried in vain.
        blocked = (self._from_holes >= 0) & (self._from_holes <= largest + _MARGIN)
        holes = np.zeros(len(blocked), dtype=bool)
        count = 0
        for center in generator.permutation(np.flatnonzero(~blocked)):
            if blocked[center]:
                continue
            size = int(generator.integers(max(_SMALLEST_RADIUS, radius - 2), largest + 1))
            holes[self._ball(int(center), size)] = True
            blocked[self._ball(int(center), size + largest + _MARGIN)] = True
            count += 1
        return holes, count

    def _ball(self, center: int, radius: int) -> IntArray:
        inside = front = np.array([center])
        for _ in range(radius):
            front = np.setdiff1d(_neighbours(self._adjacency, front), inside)
            inside = np.union1d(inside, front)
        return inside
