"""Faces without area whose corners lie apart: the middle corner lies on the opposite side.

Simply left out, such a face leaves a slit in the surface. Here its long side is flipped: its neighbour there is divided at the
middle corner, and the two triangles cover just what was covered before.
"""

from __future__ import annotations

import numpy as np

from dmp.mesh import BoolArray, FloatArray, IntArray
from dmp.mesh_report import flat_faces

_MOST_PASSES = 50
# Flips reach only so far; the rest of a large mesh need not be looked at.
_RINGS = 3


def remove_flat_faces(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, int]:
    """Return the faces (F', 3) without those that have no area, and how many such there were.

    The surface stays as it is wherever that can be: where the long side has just one other face and the new edge is not there
    yet. Otherwise the face is left out.

    Args:
        vertices: (V, 3).
        faces: (F, 3), each with three different vertices.
    """
    flat = flat_faces(vertices, faces)
    count = int(np.count_nonzero(flat))
    if not count:
        return faces, 0
    near = np.zeros(len(vertices), dtype=bool)
    near[faces[flat].ravel()] = True
    for _ in range(_RINGS):
        near[faces[near[faces].any(axis=1)].ravel()] = True
    around = near[faces].any(axis=1)
    work = _Faces(faces[around], near)
    waiting = list(map(int, np.flatnonzero(flat[around])))
    for _ in range(_MOST_PASSES):
        still = [index for index in waiting if not work.flip_long_side(vertices, index)]
        made_flat = [index for index in work.take_changed() if flat_faces(vertices, work.array([index]))[0]]
        if len(still) == len(waiting) and not made_flat:
            break
        waiting = sorted({*still, *made_flat})
    work.drop([index for index in waiting if flat_faces(vertices, work.array([index]))[0]])
    kept = np.ones(len(faces), dtype=bool)
    kept[np.flatnonzero(around)[work.dropped]] = False
    result = faces.copy()
    result[around] = work.array(list(range(int(around.sum()))))
    return result[kept], count


class _Faces:
    """Faces that are changed one by one, with the faces at each edge."""

    def __init__(self, faces: IntArray, whole: BoolArray) -> None:
        """Take faces (F, 3); around the ``whole`` vertices, (V,), all of them are here."""
        self._faces = faces.tolist()
        self._whole = whole
        self.dropped: list[int] = []
        self._changed: set[int] = set()
        self._at_edge: dict[tuple[int, int], list[int]] = {}
        for index, face in enumerate(self._faces):
            self._enter(index, face)

    def array(self, indices: list[int]) -> IntArray:
        return np.array([self._faces[index] for index in indices], dtype=np.int64).reshape(-1, 3)

    def take_changed(self) -> set[int]:
        changed, self._changed = self._changed, set()
        return changed

    def drop(self, indices: list[int]) -> None:
        self.dropped = indices

    def flip_long_side(self, vertices: FloatArray, index: int) -> bool:
        """Flip the longest side of a face; False where that cannot be done, or would make another flat face."""
        face = self._faces[index]
        if not flat_faces(vertices, self.array([index]))[0]:
            return True  # changed by the flip of a neighbour
        corners = vertices[face]
        side = int(np.argmax(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)))
        a, b, middle = face[side], face[(side + 1) % 3], face[(side + 2) % 3]
        others = [other for other in self._at_edge[_key(a, b)] if other != index]
        if len(others) != 1:
            return False
        neighbour = self._faces[others[0]]
        (far,) = (vertex for vertex in neighbour if vertex not in (a, b)) if len({*neighbour, a, b}) == 3 else (middle,)
        if far == middle or not self._whole[[a, b, middle, far]].all() or self._at_edge.get(_key(middle, far)):
            return False
        # Each takes the place of one corner, so that both keep the neighbour's way round.
        first = [middle if vertex == b else vertex for vertex in neighbour]
        second = [middle if vertex == a else vertex for vertex in neighbour]
        if flat_faces(vertices, np.array([first, second])).any():
            return False
        self._replace(index, first)
        self._replace(others[0], second)
        return True

    def _replace(self, index: int, face: list[int]) -> None:
        for edge in _edges(self._faces[index]):
            self._at_edge[edge].remove(index)
        self._faces[index] = face
        self._enter(index, face)
        self._changed.add(index)

    def _enter(self, index: int, face: list[int]) -> None:
        for edge in _edges(face):
            self._at_edge.setdefault(edge, []).append(index)


def _key(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _edges(face: list[int]) -> list[tuple[int, int]]:
    a, b, c = face
    return [_key(a, b), _key(b, c), _key(c, a)]
