"""The corners of faces around each vertex, grouped by the surface that they belong to.

Around a vertex of a manifold all faces hang together over edges: one group. Where a vertex has several, pieces of surface touch
in it without sharing an edge there.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from dmp.mesh import IntArray


def half_edge_keys(faces: IntArray) -> IntArray:
    """Return a number for the undirected edge of each side of each face, (F, 3): side s runs from corner s to the next."""
    ends = faces[:, [1, 2, 0]]
    n_vertices = int(faces.max()) + 1 if faces.size else 1
    return np.minimum(faces, ends) * n_vertices + np.maximum(faces, ends)


def pairs_over_edges(faces: IntArray) -> IntArray:
    """Return pairs of sides on one edge, (n, 2), numbered 3 * face + side: as many as hold all faces of each edge together."""
    keys = half_edge_keys(faces).ravel()
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(keys[order][1:] == keys[order][:-1])
    return np.column_stack([order[same], order[same + 1]])


def corner_groups(faces: IntArray, pairs: IntArray) -> IntArray:
    """Group the corners at each vertex.

    Args:
        faces: (F, 3), each with three different vertices.
        pairs: sides that are joined, (n, 2), numbered 3 * face + side; both on the same edge.

    Returns:
        the group of each corner, (F, 3); corners of different vertices are in different groups.
    """
    corners = faces.ravel()
    start, end = pairs, 3 * (pairs // 3) + (pairs + 1) % 3
    one = np.concatenate([start[:, 0], end[:, 0]])
    # Either both sides run the same way, or the start of one is the end of the other.
    same_way = corners[start[:, 0]] == corners[start[:, 1]]
    other = np.concatenate([np.where(same_way, start[:, 1], end[:, 1]), np.where(same_way, end[:, 1], start[:, 1])])
    graph = sparse.coo_array((np.ones(len(one), dtype=bool), (one, other)), shape=(len(corners), len(corners)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64).reshape(-1, 3)


def groups_at_vertices(faces: IntArray, groups: IntArray, n_vertices: int) -> IntArray:
    """Return the number of groups at each vertex, (V,); 0 for a vertex without a face."""
    first = np.unique(groups.ravel(), return_index=True)[1]
    return np.bincount(faces.ravel()[first], minlength=n_vertices)
