"""Rings of vertices that the training never sees, by which it is seen when a network begins to learn the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from dmp.mesh import BoolArray, FloatArray, IntArray
from dmp.recorrupted.patches import Patch
from dmp.topology import adjacency

# So many patches hold some rings; more would make looking dearer than learning on a large mesh.
_MOST_PATCHES = 3
# Fewer rings than that say nothing.
_LEAST_RINGS = 20


@dataclass(frozen=True, eq=False)
class HeldOutRings:
    """The rings within one patch. A ring is a vertex with all its neighbours, and the faces among them.

    Attributes:
        patch: number of the patch.
        vertices: own numbers of their vertices in the patch, (N,).
        vertex_rings: the ring of each, (N,).
        faces: own numbers of their faces, (M,).
        face_rings: the ring of each, (M,).
    """

    patch: int
    vertices: IntArray
    vertex_rings: IntArray
    faces: IntArray
    face_rings: IntArray


def hold_out_rings(patches: Sequence[Patch], n_vertices: int, share: float, seed: int) -> tuple[BoolArray, list[HeldOutRings]]:
    """Choose rings at random that do not touch each other, with about ``share`` of the vertices that the first patches judge.

    Whole rings, because a face's noise is that of all its vertices: only where none of them is trained on is the error of
    a normal an honest one.

    Returns:
        Which vertices of the mesh are held out, (V,), and the rings of each patch; none where a mesh is too small for that.
    """
    generator = np.random.default_rng(seed)
    ring_of = np.full(n_vertices, -1)
    found: list[HeldOutRings] = []
    n_rings = 0
    for number, patch in enumerate(patches[:_MOST_PATCHES]):
        neighbours = sparse.csr_array(adjacency(patch.faces, len(patch.vertices)))
        judged = np.zeros(len(patch.vertices), dtype=bool)
        judged[patch.judged_vertices] = True
        own = np.full(len(patch.vertices), -1)
        wanted, n_held = share * judged.sum(), 0
        for centre in generator.permutation(patch.judged_vertices):
            if n_held >= wanted:
                break
            ring = np.r_[centre, neighbours.indices[neighbours.indptr[centre] : neighbours.indptr[centre + 1]]]
            if len(ring) > 1 and judged[ring].all() and (ring_of[patch.vertices[ring]] < 0).all():
                own[ring] = ring_of[patch.vertices[ring]] = n_rings
                n_rings += 1
                n_held += len(ring)
        corners = own[patch.faces]
        # Two rings may lie side by side; the faces between them belong to neither.
        faces = np.flatnonzero((corners[:, 0] >= 0) & (corners == corners[:, :1]).all(axis=1))
        vertices = np.flatnonzero(own >= 0)
        found.append(HeldOutRings(number, vertices, own[vertices], faces, corners[faces, 0]))
    if n_rings < _LEAST_RINGS:
        return np.zeros(n_vertices, dtype=bool), []
    return ring_of >= 0, found


def standard_errors_above(risk: FloatArray, lowest: FloatArray) -> float:
    """Return by how many standard errors the sum of ``risk`` is above that of ``lowest``, each (N,) over the same rings."""
    difference = risk - lowest
    error = float(difference.std(ddof=1)) * np.sqrt(len(difference))
    return float(difference.sum()) / error if error > 0 else 0.0
