"""Bring the triangles of a patch to the density of the mesh around it: split, collapse, spread.

P. Liepa, "Filling holes in meshes", 2003, section 4, splits triangles at their centroids and swaps edges one by one.
Here each pass treats all edges of the patch at once, so that a hole of ten thousand triangles takes a second: edges that
are too long are halved, those that are too short removed, and new vertices move towards the middle of their neighbours.
As in the paper the wanted length at a rim vertex is the mean length of the edges outside, and in between it is interpolated.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dmp.geometry import face_normals, vertex_normals
from dmp.hole_filling.flipping import flip_edges
from dmp.hole_filling.patch import Patch, edge_keys, inner_edges, neighbour_means, pair_keys
from dmp.mesh import BoolArray, FloatArray, IntArray

# An edge this much longer than wanted is halved: both halves are then less far from the wanted length than the whole.
LONGEST = 4 / 3
# An edge this much shorter than wanted is removed, where it ends in a new vertex.
SHORTEST = 0.55


def refine(patch: Patch, scale: float, max_inserted: int) -> bool:
    """Split, collapse, flip and spread until the inner edges are as long as wanted.

    Args:
        patch: changed in place; new vertices stay on its surface, more or less.
        scale: aim at edges this much longer than wanted, for a coarse patch.
        max_inserted: how many new vertices there may be.

    Returns:
        False when more vertices would be needed; the patch is then of no use.
    """
    flip_edges(patch)
    # Each round halves the edges that are too long, so the number of rounds is a logarithm of the hole's size.
    for _ in range(32):
        touched = split_long_edges(patch, scale)
        if patch.n_inserted > max_inserted:
            return False
        if not patch.n_inserted:
            break
        is_settled = np.count_nonzero(touched) < 0.02 * patch.n_vertices
        flip_edges(patch, touched)
        touched = collapse_short_edges(patch, scale)
        flip_edges(patch, touched)
        if is_settled:
            break
        spread_vertices(patch, 3)
        flip_edges(patch)
    return True


def split_long_edges(patch: Patch, scale: float = 1.0) -> BoolArray:
    """Halve every inner edge longer than :data:`LONGEST` times ``scale`` times the length wanted there.

    Returns:
        mask (N,) of the vertices at which something changed.
    """
    edges = inner_edges(patch.triangles, patch.n_vertices).ends
    edges = edges[patch.relative_lengths(edges) > LONGEST * scale]
    touched = np.zeros(patch.n_vertices + len(edges), dtype=bool)
    if len(edges):
        first = patch.add_vertices(patch.positions[edges].mean(axis=1), patch.wanted[edges].mean(axis=1))
        patch.triangles = _subdivided(patch.triangles, edges, first, patch.positions)
        touched[edges] = True
        touched[first:] = True
    return touched


def collapse_short_edges(patch: Patch, scale: float = 1.0) -> BoolArray:
    """Remove new vertices at edges shorter than :data:`SHORTEST` times ``scale`` times the wanted length.

    The vertex moves onto the other end of the edge, which stays where it is. It is kept where the triangles would no
    longer form a surface (the two ends must have exactly two neighbours in common, outside counted), where a triangle
    would turn over, and where an edge would become too long. Neighbouring vertices wait for the next call.

    Returns:
        mask (N,) of the vertices at which something changed.
    """
    n = patch.n_vertices
    if not patch.n_inserted:
        return np.zeros(n, dtype=bool)
    ends = inner_edges(patch.triangles, n).ends
    pairs = np.concatenate([ends, ends[:, ::-1]])
    ratio = patch.relative_lengths(pairs)
    pairs = pairs[(pairs[:, 0] >= patch.n_fixed) & (ratio < SHORTEST * scale)]
    if len(pairs):
        joined = patch.joined()
        common = np.asarray(joined[pairs[:, 0]].multiply(joined[pairs[:, 1]]).sum(axis=1)).ravel()
        pairs = pairs[common == 2]
    if len(pairs):
        pairs = pairs[~_spoils_triangles(patch, pairs, 1.6 * scale)]
    if len(pairs):
        pairs = pairs[_apart(joined[pairs[:, 0]], pairs[:, 0], patch.relative_lengths(pairs))]

    gone, kept = pairs.T
    target = np.arange(n)
    target[gone] = kept
    triangles = target[patch.triangles]
    whole = (triangles != triangles[:, [1, 2, 0]]).all(axis=1)
    stays = np.ones(n, dtype=bool)
    stays[gone] = False
    patch.triangles = (np.cumsum(stays) - 1)[triangles[whole]]
    patch.positions = patch.positions[stays]
    patch.wanted = patch.wanted[stays]
    touched = np.zeros(n, dtype=bool)
    touched[kept] = True
    return touched[stays]


def spread_vertices(patch: Patch, passes: int) -> None:
    """Move new vertices along the surface towards the mean of their neighbours, ``passes`` times."""
    if not patch.n_inserted:
        return
    averaging = neighbour_means(patch.triangles, patch.n_vertices)[patch.inserted]
    for _ in range(passes):
        move = averaging @ patch.positions - patch.positions[patch.inserted]
        normals = vertex_normals(patch.positions, patch.triangles)[patch.inserted]
        move -= np.einsum("nc,nc->n", move, normals)[:, None] * normals
        patch.positions[patch.inserted] += 0.7 * move


def _spoils_triangles(patch: Patch, pairs: IntArray, longest: float) -> BoolArray:
    """Tell for which pairs (E, 2) moving the first vertex onto the second turns a triangle over or stretches one too far."""
    gone, kept = pairs.T
    corners = patch.triangles.ravel()
    of_vertex = sparse.csr_array(
        (np.ones(len(corners)), (corners, np.repeat(np.arange(len(patch.triangles)), 3))),
        shape=(patch.n_vertices, len(patch.triangles)),
    )
    around = of_vertex[gone]
    pair, old = np.repeat(np.arange(len(pairs)), np.diff(around.indptr)), patch.triangles[around.indices]
    remains = (old != kept[pair, None]).all(axis=1)
    pair, old = pair[remains], old[remains]
    new = np.where(old == gone[pair, None], kept[pair, None], old)
    # Compared with the mean around the vertex, as a single sliver's own normal says nothing.
    normals = vertex_normals(patch.positions, patch.triangles)[gone]
    turns = np.einsum("tc,tc->t", face_normals(patch.positions, new), normals[pair]) < 0.2
    sides = np.concatenate([new[:, [0, 1]], new[:, [1, 2]], new[:, [2, 0]]])
    too_long = (patch.relative_lengths(sides) > longest).reshape(3, -1).any(axis=0)
    spoils = np.zeros(len(pairs), dtype=bool)
    spoils[pair[turns | too_long]] = True
    return spoils


def _apart(neighbours: sparse.csr_array, vertices: IntArray, ratio: FloatArray) -> IntArray:
    """Choose candidates, smallest ratio first, whose closed neighbourhoods, the rows of ``neighbours``, do not touch."""
    rank = np.empty(len(ratio), dtype=np.int64)
    rank[np.argsort(ratio, kind="stable")] = np.arange(len(ratio))
    of = np.concatenate([np.repeat(np.arange(len(vertices)), np.diff(neighbours.indptr)), np.arange(len(vertices))])
    vertex = np.concatenate([neighbours.indices, vertices])
    best = np.full(neighbours.shape[1], len(ratio))
    np.minimum.at(best, vertex, rank[of])
    loses = np.zeros(len(vertices), dtype=bool)
    loses[of[best[vertex] != rank[of]]] = True
    return np.flatnonzero(~loses)


def _subdivided(triangles: IntArray, edges: IntArray, first_new: int, positions: FloatArray) -> IntArray:
    """Cut triangles at the middles of ``edges`` (M, 2), which are vertices ``first_new`` + 0..M-1."""
    n = len(positions)
    keys = pair_keys(edges, n)
    order = np.argsort(keys)
    side = edge_keys(triangles, triangles[:, [1, 2, 0]], n)
    place = np.minimum(np.searchsorted(keys[order], side), len(keys) - 1)
    middle = np.where(keys[order][place] == side, first_new + order[place], -1)  # (K, 3), of the sides 01, 12, 20
    n_cut = (middle >= 0).sum(axis=1)

    parts = [triangles[n_cut == 0]]
    one, middle_one = _rotated(triangles, middle, n_cut == 1, middle >= 0)  # only side 01 is cut
    at = middle_one[:, 0]
    parts += _stacked((one[:, 0], at, one[:, 2]), (at, one[:, 1], one[:, 2]))

    two, middle_two = _rotated(triangles, middle, n_cut == 2, middle < 0)  # only side 01 is whole
    near_one, near_zero = middle_two[:, 1], middle_two[:, 2]
    to_one = np.linalg.norm(positions[two[:, 0]] - positions[near_one], axis=1)
    to_zero = np.linalg.norm(positions[two[:, 1]] - positions[near_zero], axis=1)
    shorter = to_one <= to_zero
    parts += _stacked(
        (near_zero, near_one, two[:, 2]),
        (two[:, 0], two[:, 1], np.where(shorter, near_one, near_zero)),
        (np.where(shorter, two[:, 0], two[:, 1]), near_one, near_zero),
    )

    (a, b, c), (ab, bc, ca) = triangles[n_cut == 3].T, middle[n_cut == 3].T
    parts += _stacked((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate(parts)


def _rotated(triangles: IntArray, middle: IntArray, rows: BoolArray, first: BoolArray) -> tuple[IntArray, IntArray]:
    """Rotate the corners of the chosen triangles so that the one side marked in ``first`` is the side 01."""
    columns = (np.arange(3) + np.argmax(first[rows], axis=1)[:, None]) % 3
    return np.take_along_axis(triangles[rows], columns, axis=1), np.take_along_axis(middle[rows], columns, axis=1)


def _stacked(*triangles: tuple[IntArray, ...]) -> list[IntArray]:
    return [np.stack(corners, axis=1) for corners in triangles]
