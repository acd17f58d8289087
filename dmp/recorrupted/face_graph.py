"""Which faces are neighbours over an edge, on any triangle mesh: closed, with boundary, or non-manifold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmp.mesh import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class FaceGraph:
    """Three slots a face, one for each of its edges, and in each the face on the other side.

    An empty slot (boundary) holds the face itself with sign 0. Slots are matched: the slot of the neighbour that leads
    back is known, which turns the transpose of every sum over slots into a gather.

    Attributes:
        neighbours: (3, F) int64, the face in each slot.
        back: (3, F) int64, row-major position (slot * F + face) of the slot that leads back; an empty slot's own.
        signs: (3, F) float64, 1 for a neighbour of the same orientation, -1 for the opposite one, 0 for an empty slot.
    """

    neighbours: IntArray
    back: IntArray
    signs: FloatArray


def face_graph(faces: IntArray, normals: FloatArray) -> FaceGraph:
    """Match the faces over their shared edges.

    Where more than two faces meet in an edge, those two that continue each other best (largest cosine of their normals)
    are neighbours, then the next two; an odd one stays alone, as at a boundary. So two sheets that touch along a line
    are filtered as two sheets.

    Args:
        faces: (F, 3).
        normals: unit normals, (F, 3), best of a lightly smoothed mesh; they decide at non-manifold edges only.
    """
    n_faces = len(faces)
    starts, ends = faces.T.reshape(-1), faces[:, [1, 2, 0]].T.reshape(-1)
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    keys = low * (int(faces.max()) + 1 if faces.size else 1) + high
    order = np.argsort(keys, kind="stable")
    order = order[low[order] != high[order]]
    sorted_keys = keys[order]
    first = np.flatnonzero(np.r_[True, sorted_keys[1:] != sorted_keys[:-1]]) if len(order) else np.zeros(0, dtype=np.int64)
    counts = np.diff(np.r_[first, len(order)])

    pairs = [np.column_stack([order[first[counts == 2]], order[first[counts == 2] + 1]])]
    for start, count in zip(first[counts > 2], counts[counts > 2], strict=True):
        pairs.append(_matched(order[start : start + count], starts, normals))
    one, other = np.concatenate(pairs).T

    slots = np.arange(3 * n_faces)
    back, signs = slots.copy(), np.zeros(3 * n_faces)
    back[one], back[other] = other, one
    # Neighbours of the same orientation run through their common edge in opposite directions.
    signs[one] = signs[other] = np.where(starts[one] == starts[other], -1.0, 1.0)
    neighbours = back % max(n_faces, 1)
    return FaceGraph(neighbours.reshape(3, -1), back.reshape(3, -1), signs.reshape(3, -1))


def _matched(slots: IntArray, starts: IntArray, normals: FloatArray) -> IntArray:
    """Return disjoint pairs of the ``slots`` around one edge, (N, 2), those that continue each other best first."""
    around = normals[slots % len(normals)]
    directions = np.where(starts[slots] == starts[slots[0]], 1.0, -1.0)
    # Two faces side by side run in opposite directions when their normals agree.
    # Rounded, so that between faces at the same place their order decides, not the last digit of a coordinate.
    scores = -np.round((directions[:, None] * directions[None]) * (around @ around.T), 9)
    rows, columns = np.triu_indices(len(slots), 1)
    free = np.ones(len(slots), dtype=bool)
    chosen = []
    for index in np.argsort(-scores[rows, columns], kind="stable"):
        a, b = rows[index], columns[index]
        if free[a] and free[b] and slots[a] % len(normals) != slots[b] % len(normals):
            free[[a, b]] = False
            chosen.append((slots[a], slots[b]))
    return np.array(chosen, dtype=np.int64).reshape(-1, 2)
