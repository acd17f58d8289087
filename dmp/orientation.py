"""Which faces look the other way than their neighbours, and which closed pieces are inside out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from dmp.geometry import face_normals
from dmp.mesh import BoolArray, FloatArray, IntArray
from dmp.recorrupted.face_graph import face_graph

# A volume below this share of that of a ball with the same area is that of a flat thing, which has no outside.
_LEAST_VOLUME = 1e-9
# Whether pieces lie in one another is asked for each pair of them.
_MOST_NESTED = 4000


@dataclass(frozen=True, eq=False)
class Orientation:
    """What would have to be turned so that all neighbours agree, and closed pieces look outwards.

    A piece that lies within another one, like the wall of a cavity, may look either way.

    Attributes:
        flips: faces to turn round, (F,): as few as possible in each piece that is not closed.
        inside_out: those among them whose piece is consistent in itself and only looks inwards, (F,).
        one_sided: faces of pieces that cannot be oriented, such as a Moebius strip, (F,); none of them is turned.
        n_inside_out: number of the closed pieces that look inwards.
    """

    flips: BoolArray
    inside_out: BoolArray
    one_sided: BoolArray
    n_inside_out: int


def orientation(vertices: FloatArray, faces: IntArray) -> Orientation:
    """Compare the orientation of faces (F, 3), each with three different vertices, over their edges.

    Where more than two faces meet in an edge, those two are neighbours that continue each other best.
    """
    n_faces = len(faces)
    none = np.zeros(n_faces, dtype=bool)
    if not n_faces:
        return Orientation(none, none, none, 0)
    # Which faces are neighbours must not depend on how they are turned: faces with ascending vertices are compared.
    ascending, is_odd = sorted_corners(faces)
    graph = face_graph(ascending, face_normals(vertices, ascending))
    slots = np.flatnonzero(graph.signs.ravel())
    here, there = slots % n_faces, graph.neighbours.ravel()[slots]
    agrees = (graph.signs.ravel()[slots] > 0) ^ is_odd[here] ^ is_odd[there]
    # Each face twice, as it is and turned round; what is connected to a face as it is has to be as it is found there.
    one = np.concatenate([here, here + n_faces])
    other = np.concatenate([np.where(agrees, there, there + n_faces), np.where(agrees, there + n_faces, there)])
    cover = sparse.coo_array((np.ones(len(one), dtype=bool), (one, other)), shape=(2 * n_faces, 2 * n_faces))
    labels = connected_components(cover, directed=False)[1].reshape(2, n_faces)
    one_sided = labels[0] == labels[1]

    lower = labels.min(axis=0)
    n_pieces, piece = len(np.unique(lower)), np.unique(lower, return_inverse=True)[1]
    in_lower = labels[0] == lower
    n_lower, n_all = np.bincount(piece, in_lower, n_pieces), np.bincount(piece, minlength=n_pieces)
    has_edge = np.bincount(piece, (graph.signs == 0).any(axis=0), n_pieces) > 0
    # Fewest turns; at a tie the first face of the piece stays.
    first = np.unique(piece, return_index=True)[1]
    keeps_lower = np.where(2 * n_lower == n_all, in_lower[first], 2 * n_lower > n_all)

    volumes = _volumes(vertices, faces, piece, in_lower, n_pieces)
    closed = ~has_edge & ~one_sided[first] & (volumes != 0)
    is_free = closed & ~_nested(vertices, faces, piece, in_lower, closed)
    keeps_lower = np.where(is_free, volumes > 0, keeps_lower)
    flips = (in_lower != keeps_lower[piece]) & ~one_sided
    turned = np.bincount(piece, flips, n_pieces)
    inside_out = is_free & (turned == n_all)
    return Orientation(flips, inside_out[piece], one_sided, int(inside_out.sum()))


def sorted_corners(faces: IntArray) -> tuple[IntArray, BoolArray]:
    """Return the faces (F, 3) with ascending vertices, and which of them are turned round by that, (F,)."""
    ascending = np.sort(faces, axis=1)
    first = np.argmin(faces, axis=1)
    return ascending, np.take_along_axis(faces, (first[:, None] + 1) % 3, axis=1)[:, 0] != ascending[:, 1]


def _volumes(vertices: FloatArray, faces: IntArray, piece: IntArray, in_lower: BoolArray, n_pieces: int) -> FloatArray:
    """Return the volume of each piece with the faces that are not ``in_lower`` turned; 0 for flat ones."""
    counts = np.bincount(piece, minlength=n_pieces)
    centres = vertices[faces].mean(axis=1)
    middle = np.stack([np.bincount(piece, centres[:, axis], n_pieces) / counts for axis in range(3)], axis=1)
    corners = vertices[faces] - middle[piece][:, None]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.bincount(piece, np.linalg.norm(crosses, axis=1) / 2, n_pieces)
    parts = np.einsum("fc,fc->f", corners[:, 0], crosses) / 6 * np.where(in_lower, 1.0, -1.0)
    volumes = np.bincount(piece, parts, n_pieces)
    ball = areas**1.5 / (6 * np.sqrt(np.pi))
    return np.where(np.abs(volumes) > _LEAST_VOLUME * ball, volumes, 0.0)


def _nested(vertices: FloatArray, faces: IntArray, piece: IntArray, in_lower: BoolArray, closed: BoolArray) -> BoolArray:
    """Tell which closed pieces lie within an odd number of other closed ones, (n,)."""
    nested = np.zeros(len(closed), dtype=bool)
    candidates = np.flatnonzero(closed)
    if not 2 <= len(candidates) <= _MOST_NESTED:
        return nested
    order = np.argsort(piece, kind="stable")
    starts = np.searchsorted(piece[order], np.arange(len(closed)))
    corners = vertices[faces]
    low = np.minimum.reduceat(corners.min(axis=1)[order], starts)
    high = np.maximum.reduceat(corners.max(axis=1)[order], starts)
    ends = np.append(starts[1:], len(order))
    for inner in candidates:
        around = candidates[(low[candidates] < low[inner]).all(axis=1) & (high[candidates] > high[inner]).all(axis=1)]
        point = corners[order[starts[inner]], 0]
        depth = sum(
            abs(_winding_number(point, corners[own], in_lower[own])) > 0.5
            for own in (order[starts[outer] : ends[outer]] for outer in around)
        )
        nested[inner] = depth % 2 == 1
    return nested


def _winding_number(point: FloatArray, corners: FloatArray, in_lower: BoolArray) -> float:
    """Return how often a closed surface winds around a point: the solid angles of its triangles, added up.

    The formula is van Oosterom and Strackee's (1983).
    """
    a, b, c = (corners[:, k] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    triple = np.einsum("fc,fc->f", a, np.cross(b, c))
    dots = (np.einsum("fc,fc->f", one, other) for one, other in ((a, b), (b, c), (c, a)))
    ab, bc, ca = dots
    angles = 2 * np.arctan2(triple, la * lb * lc + ab * lc + bc * la + ca * lb)
    return float((angles * np.where(in_lower, 1.0, -1.0)).sum() / (4 * np.pi))
