"""Filters that move every vertex towards, or away from, the mean of its neighbours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import sparse

from dmp.mesh import FloatArray, TriangleMesh
from dmp.topology import adjacency


def uniform_laplacian(mesh: TriangleMesh, counts: Sequence[int], *, share: float) -> Iterator[FloatArray]:
    """Yield the vertices (V, 3) after each number of steps in ``counts`` (ascending).

    A step is p_i <- p_i + share * (mean of its neighbours - p_i), all vertices at once; one without neighbours stays.
    """
    average = _averaging(mesh)
    positions, done = mesh.vertices, 0
    for count in counts:
        for _ in range(count - done):
            positions = positions + share * (average @ positions - positions)
        done = count
        yield positions


def taubin(mesh: TriangleMesh, counts: Sequence[int], *, shrink: float, inflate: float) -> Iterator[FloatArray]:
    """Yield the vertices (V, 3) after each number of passes in ``counts`` (ascending) of Taubin's signal processing.

    A pass is p <- p + shrink * L p and then p <- p - inflate * L p, where (L p)_i is the mean of the neighbours of vertex i
    less p_i (Taubin 1995, "A Signal Processing Approach to Fair Surface Design"; shrink is its lambda, -inflate its mu).
    """
    average = _averaging(mesh)
    positions, done = mesh.vertices, 0
    for count in counts:
        for _ in range(count - done):
            positions = positions + shrink * (average @ positions - positions)
            positions = positions - inflate * (average @ positions - positions)
        done = count
        yield positions


def _averaging(mesh: TriangleMesh) -> sparse.csr_array:
    neighbours = adjacency(mesh.faces, mesh.n_vertices)
    valences = np.asarray(neighbours.sum(axis=1))
    alone = sparse.diags_array((valences == 0).astype(np.float64))
    return sparse.csr_array(sparse.diags_array(1.0 / np.maximum(valences, 1.0)) @ neighbours + alone)
