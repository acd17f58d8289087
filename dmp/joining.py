"""Which vertices at one place are one vertex: joining copies, and taking apart where surfaces only touch or branch."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from dmp.corner_groups import corner_groups
from dmp.geometry import face_normals
from dmp.mesh import BoolArray, FloatArray, IntArray
from dmp.recorrupted.face_graph import face_graph
from dmp.topology import edge_face_counts


def duplicate_rows(rows: IntArray | FloatArray) -> tuple[IntArray, IntArray]:
    """Return for each row (n, k) the first row that equals it, (n,), and the rows that equal an earlier one, ascending."""
    # 0 and -0 are one number, and two patterns of bits.
    _, first, inverse = np.unique(rows + 0, axis=0, return_index=True, return_inverse=True)
    earlier = first[inverse.ravel()]
    return earlier, np.flatnonzero(earlier != np.arange(len(rows)))


def join_copies(positions: FloatArray, faces: IntArray, target: IntArray) -> IntArray:
    """Tell which copies of vertices to make one: those between which the surface is torn, not those where surfaces touch.

    Were all copies joined, some edges might get more than two faces, and some vertices faces that do not hang together.
    There the faces are sorted into sheets that continue each other best, and only copies in one sheet are joined.

    Args:
        positions: (V, 3).
        faces: (F, 3).
        target: for each vertex the first of all its copies, (V,).

    Returns:
        For each vertex the first one that it is to be joined with, (V,); itself for most.
    """
    n_vertices = len(positions)
    nothing: IntArray = np.arange(n_vertices)
    # What has collapsed, or is there twice, says nothing of the surface.
    merged = target[faces]
    kept = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])
    indices = np.flatnonzero(kept)
    indices = np.delete(indices, duplicate_rows(np.sort(merged[indices], axis=1))[1])
    if not len(indices) or np.array_equal(target, nothing):
        return target
    copied = np.bincount(target, minlength=n_vertices) > 1
    sheet, source = take_apart(positions, merged[indices], copied)
    # A vertex that already holds several sheets together goes on to do so.
    own, of_sheet = faces[indices].ravel(), n_vertices + sheet.ravel()
    graph = sparse.coo_array((np.ones(len(own), dtype=bool), (own, of_sheet)), shape=(n_vertices + len(source),) * 2)
    label = connected_components(graph, directed=False)[1]
    first = np.full(int(label.max()) + 1, n_vertices, dtype=np.int64)
    np.minimum.at(first, label[:n_vertices], nothing)
    joined = first[label[:n_vertices]]
    # Copies of which only such faces are left go with the first one.
    has_sheet = np.zeros(n_vertices, dtype=bool)
    has_sheet[own] = True
    lowest = np.full(n_vertices, n_vertices, dtype=np.int64)
    np.minimum.at(lowest, target[has_sheet], joined[has_sheet])
    rest = ~has_sheet
    joined[rest] = np.where(lowest[target[rest]] < n_vertices, lowest[target[rest]], target[rest])
    # The first of all copies stays what it is, also where another one was found first.
    return np.minimum(joined, nothing)


def take_apart(positions: FloatArray, faces: IntArray, may_split: BoolArray) -> tuple[IntArray, IntArray]:
    """Give each group of faces around a vertex that hangs together over edges a vertex of its own.

    Where more than two faces meet in an edge, those two stay together that continue each other best.

    Args:
        positions: (V, 3).
        faces: (F, 3), each with three different vertices.
        may_split: which vertices may be split, (V,).

    Returns:
        The faces over the new vertices, and for each of these the vertex that it comes from: first all as they are, then
        the copies, in the order of the vertices.
    """
    if not len(faces):
        return faces, np.arange(len(positions))
    # With ascending vertices, so that the result does not depend on how the faces are turned.
    order = np.argsort(faces, axis=1, kind="stable")
    ascending = np.take_along_axis(faces, order, axis=1)
    graph = face_graph(ascending, face_normals(positions, ascending))
    split, source = _with_own_vertices(ascending, _pairs(graph.back, graph.signs), may_split)
    edges, counts = edge_face_counts(split)
    crowded = edges[counts > 2]
    crowded = crowded[may_split[source[crowded]].any(axis=1)]
    if len(crowded):
        # Sheets that hang together further on still share the edge: there they are cut open.
        signs = np.where(_is_among(split, crowded).T.reshape(-1), 0.0, graph.signs.ravel())
        split, source = _with_own_vertices(ascending, _pairs(graph.back, signs), may_split)
    result = np.empty_like(split)
    np.put_along_axis(result, order, split, axis=1)
    return result, source


def _pairs(back: IntArray, signs: FloatArray) -> IntArray:
    """Return the pairs of sides that a face graph joins, (n, 2), numbered 3 * face + side."""
    n_faces = back.shape[1]
    slots = np.flatnonzero(signs.ravel())
    other = back.ravel()[slots]
    once = slots < other
    slots, other = slots[once], other[once]
    return np.column_stack([3 * (slots % n_faces) + slots // n_faces, 3 * (other % n_faces) + other // n_faces])


def _with_own_vertices(faces: IntArray, pairs: IntArray, may_split: BoolArray) -> tuple[IntArray, IntArray]:
    n_vertices = len(may_split)
    corners = faces.ravel()
    # All corners at a vertex that must stay one are one group.
    groups = np.where(may_split[corners], n_vertices + corner_groups(faces, pairs).ravel(), corners)
    _, first, inverse = np.unique(groups, return_index=True, return_inverse=True)
    vertex = corners[first]
    # In the order of the vertices, and of the faces around each; the first group keeps the vertex itself.
    order = np.lexsort((first, vertex))
    is_further = np.zeros(len(order), dtype=bool)
    is_further[1:] = vertex[order][1:] == vertex[order][:-1]
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.where(is_further, n_vertices + np.cumsum(is_further) - 1, vertex[order])
    return number[inverse.ravel()].reshape(-1, 3), np.concatenate([np.arange(n_vertices), vertex[order][is_further]])


def _is_among(faces: IntArray, edges: IntArray) -> BoolArray:
    """Tell which sides of faces are among ``edges`` (n, 2), each smaller index first: (F, 3)."""
    ends = faces[:, [1, 2, 0]]
    n_vertices = int(faces.max()) + 1
    keys = np.minimum(faces, ends) * n_vertices + np.maximum(faces, ends)
    return np.asarray(np.isin(keys, edges[:, 0] * n_vertices + edges[:, 1]))
