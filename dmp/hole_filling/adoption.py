"""Take over patches that MeshLab triangulated and refined, as far as they fit the rim exactly."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from dmp import meshlab
from dmp.boundary import BoundaryLoop
from dmp.hole_filling.patch import Patch, edge_keys, half_edges, inner_edges, pair_keys
from dmp.mesh import FloatArray, IntArray, TriangleMesh

# Positions of all vertices, those of the mesh first, and the new faces (K, 3).
Proposal = tuple[FloatArray, IntArray]


def meshlab_proposals(mesh: TriangleMesh, loops: Mapping[int, BoundaryLoop]) -> dict[int, Proposal]:
    """Let MeshLab close all loops, and return by loop what it proposes; loops that it left open are missing.

    Raises:
        MeshError: when MeshLab fails altogether.
    """
    ends = np.concatenate([loop.edges for loop in loops.values()])
    edge_length = float(np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1).mean())
    vertices, faces = meshlab.close_holes(mesh, list(loops.values()), edge_length)
    new = faces[mesh.n_faces :]
    if not len(new):
        return {}
    start, end = half_edges(new)
    keys = edge_keys(start, end, len(vertices))
    _, edge = np.unique(keys, return_inverse=True)
    owner = np.tile(np.arange(len(new)), 3)
    incidence = sparse.csr_array((np.ones(len(owner)), (owner, edge)), shape=(len(new), int(edge.max()) + 1))
    piece = connected_components(incidence @ incidence.T, directed=False)[1]
    piece_of = dict(zip((start * len(vertices) + end).tolist(), piece[owner].tolist(), strict=True))
    proposals = {}
    for index, loop in loops.items():
        first, second = loop.edges[0]
        found = piece_of.get(int(second) * len(vertices) + int(first))
        if found is not None:
            proposals[index] = (vertices, new[piece == found])
    return proposals


def adopted(start: Patch, names: IntArray, proposal: Proposal, n_known: int) -> Patch | None:
    """Turn a proposal into a patch, or return None where it does not fit the rim exactly.

    Args:
        start: the surroundings of the hole.
        names: the vertex indices of its numbering in the mesh.
        proposal: MeshLab's vertices and faces.
        n_known: number of vertices of the mesh that MeshLab was given.
    """
    vertices, faces = proposal
    new = np.unique(faces[faces >= n_known])
    every = np.concatenate([names, new])
    order = np.argsort(every)
    place = np.minimum(np.searchsorted(every[order], faces), len(every) - 1)
    triangles = order[place]
    if not np.array_equal(every[triangles], faces):
        return None
    n = len(every)
    begin, end = half_edges(triangles)
    directed, counts = np.unique(begin * n + end, return_counts=True)
    reverse = directed % n * n + directed // n
    border = np.sort(directed[~np.isin(reverse, directed)])
    rim = np.arange(start.n_rim)
    expected = np.sort(rim * n + np.roll(rim, -1))
    inner = inner_edges(triangles, n).ends
    doubled = np.isin(pair_keys(inner, n), pair_keys(start.outside_edges, n)).any()
    if (counts > 1).any() or doubled or not np.array_equal(border, expected):
        return None
    patch = start.copy()
    patch.triangles = triangles
    patch.add_vertices(vertices[new] - start.origin, np.full(len(new), start.wanted[: start.n_rim].mean()))
    return patch
