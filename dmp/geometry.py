"""Normals, areas and lengths of triangle meshes, in double precision."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dmp.mesh import FloatArray, IntArray


def face_area_vectors(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the cross product of two edges of each face, (F, 3): along the normal, as long as twice the area."""
    first, second, third = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    return np.cross(second - first, third - first)


def normalised(vectors: FloatArray) -> FloatArray:
    """Return the rows of ``vectors`` (N, 3) at length 1; rows of length 0 stay 0."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)


def face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return unit normals of the faces, (F, 3); 0 for a face without area."""
    return normalised(face_area_vectors(vertices, faces))


def face_areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the areas of the faces, (F,), in squared units of the vertices."""
    return 0.5 * np.linalg.norm(face_area_vectors(vertices, faces), axis=1)


def vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return unit normals of the vertices, (V, 3): the sum of the area vectors of their faces; 0 where that vanishes."""
    incidence = sparse.csr_array(
        (np.ones(faces.size), (faces.ravel(), np.repeat(np.arange(len(faces)), 3))), shape=(len(vertices), len(faces))
    )
    return normalised(np.asarray(incidence @ face_area_vectors(vertices, faces)))


def mean_edge_length(vertices: FloatArray, edges: IntArray) -> float:
    """Return h, the mean length over the edges (E, 2), in units of the vertices."""
    return float(np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1).mean())
