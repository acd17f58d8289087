"""Parts of a graph with a halo around each, so large that the layers' output on a part is that on the whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from dmp.mesh import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Patch:
    """Vertices of a part and of its halo.

    Attributes:
        vertices: both, ascending, (N,) int64.
        core: which of them belong to the part itself, (N,) bool; each vertex of the mesh is in one part's core.
    """

    vertices: IntArray
    core: BoolArray


def partition(positions: FloatArray, neighbours: sparse.csr_array, size: int, rings: int) -> list[Patch]:
    """Divide a mesh into parts of at most ``size`` vertices and add the ``rings`` of neighbours around each.

    Parts are halved across their longest side until they are small enough, so that they are compact and their halos small.

    Args:
        positions: (V, 3), best of a smoothed mesh.
        neighbours: a symmetric matrix, (V, V), with an entry wherever two vertices are neighbours, and perhaps on the diagonal.
        size: vertices of a part without its halo.
        rings: how many edges far the halo reaches.
    """
    waiting, found = [np.arange(len(positions))], []
    while waiting:
        members = waiting.pop()
        if len(members) <= size:
            found.append(_with_halo(np.sort(members), neighbours, rings))
            continue
        own = positions[members]
        # Halves of equal numbers, wherever many coordinates are the same.
        order = np.argsort(own[:, np.argmax(np.ptp(own, axis=0))], kind="stable")
        waiting += [members[order[len(order) // 2 :]], members[order[: len(order) // 2]]]
    return found


def _with_halo(core: IntArray, neighbours: sparse.csr_array, rings: int) -> Patch:
    is_inside = np.zeros(neighbours.shape[0], dtype=bool)
    is_inside[core] = True
    edge = core
    for _ in range(rings):
        around: IntArray = np.unique(neighbours[edge].indices).astype(np.int64)
        edge = around[~is_inside[around]]
        is_inside[edge] = True
    vertices = np.flatnonzero(is_inside)
    return Patch(vertices, np.isin(vertices, core, assume_unique=True))
