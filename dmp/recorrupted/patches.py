"""Overlapping pieces of a mesh, so that a training step costs the same on a large mesh as on a small one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from dmp.mesh import FloatArray, IntArray
from dmp.topology import adjacency

# Rings of vertices along a cut that take part but are not judged: what the network does there, it does without half of
# its neighbourhood.
MARGIN = 5
_LARGEST_UNJUDGED = 0.01


@dataclass(frozen=True, eq=False)
class Patch:
    """Part of a mesh.

    Attributes:
        vertices: indices of its vertices, (v,), ascending.
        faces: its faces in numbers of its own vertices, (f, 3).
        face_indices: indices of its faces in the mesh, (f,).
        judged_vertices: own numbers of the vertices at least :data:`MARGIN` rings from a cut.
        judged_faces: own numbers of the faces with three such vertices.
    """

    vertices: IntArray
    faces: IntArray
    face_indices: IntArray
    judged_vertices: IntArray
    judged_faces: IntArray


def whole(faces: IntArray, n_vertices: int) -> Patch:
    """Return the mesh as one patch, judged everywhere."""
    return Patch(np.arange(n_vertices), faces, np.arange(len(faces)), np.arange(n_vertices), np.arange(len(faces)))


def patches(positions: FloatArray, faces: IntArray, size: int) -> list[Patch]:
    """Cover a mesh with patches of about ``size`` vertices each; a mesh of up to 1.5 ``size`` stays whole.

    Centres are placed farthest from each other; a patch holds the vertices nearest to its centre, whatever component
    they belong to. Every vertex is judged in some patch as far as a cut allows.

    Args:
        positions: (V, 3), best of a smoothed mesh.
        faces: (F, 3).
        size: vertices a patch.
    """
    n_vertices = len(positions)
    if n_vertices <= 1.5 * size:
        return [whole(faces, n_vertices)]
    tree = cKDTree(positions)
    # The margin eats about a third of a patch; so many let most regions appear well inside one, and then some more
    # around whatever has not yet been judged.
    wanted = int(np.ceil(2.0 * n_vertices / size))
    neighbours = adjacency(faces, n_vertices)
    distance = np.full(n_vertices, np.inf)
    unjudged = np.ones(n_vertices, dtype=bool)
    centre = int(np.argmax(np.linalg.norm(positions - positions.mean(axis=0), axis=1)))
    found: list[Patch] = []
    for number in range(3 * wanted):
        distance = np.minimum(distance, np.linalg.norm(positions - positions[centre], axis=1))
        patch = _patch(np.asarray(tree.query(positions[centre], k=size)[1]), faces, neighbours, n_vertices)
        if len(patch.judged_faces):
            found.append(patch)
            unjudged[patch.vertices[patch.judged_vertices]] = False
        if number + 1 >= wanted and np.mean(unjudged) < _LARGEST_UNJUDGED:
            break
        centre = int(np.argmax(np.where(unjudged, distance, 0.0) if number + 1 >= wanted else distance))
    return found or [whole(faces, n_vertices)]


def _patch(members: IntArray, faces: IntArray, neighbours: object, n_vertices: int) -> Patch:
    inside = np.zeros(n_vertices, dtype=bool)
    inside[members] = True
    face_indices = np.flatnonzero(inside[faces].all(axis=1))
    used = np.zeros(n_vertices, dtype=bool)
    used[faces[face_indices].ravel()] = True
    near_cut = ~used
    for _ in range(MARGIN):
        near_cut = near_cut | (np.asarray(neighbours @ near_cut.astype(np.float64)) > 0)  # type: ignore[operator]
    vertices = np.flatnonzero(used)
    numbers = np.full(n_vertices, -1)
    numbers[vertices] = np.arange(len(vertices))
    judged = used & ~near_cut
    own_faces = faces[face_indices]
    return Patch(
        vertices=vertices,
        faces=numbers[own_faces],
        face_indices=face_indices,
        judged_vertices=numbers[np.flatnonzero(judged)],
        judged_faces=np.flatnonzero(judged[own_faces].all(axis=1)),
    )
