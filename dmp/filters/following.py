"""Vertices that follow given face normals, the second half of every filter that works on normals."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dmp.mesh import FloatArray, IntArray


class VertexUpdate:
    """The vertex update of Sun et al. 2007, "Fast and Effective Feature-Preserving Mesh Denoising".

    A step is x_i <- x_i + 1 / |F(i)| * sum over the faces f of vertex i of n_f (n_f . (c_f - x_i)), with the given normals
    n_f and the present centroids c_f; it goes down the gradient of the squared scalar products of normals and edges.
    Vertices of no face stay, and faces without a normal (0) pull nothing.

    Args:
        faces: (F, 3), each with three different vertices.
        n_vertices: number of vertices, V.
    """

    def __init__(self, faces: IntArray, n_vertices: int) -> None:
        owner = np.repeat(np.arange(len(faces)), 3)
        corners = sparse.csr_array((np.ones(faces.size), (faces.ravel(), owner)), shape=(n_vertices, len(faces)))
        counts = np.maximum(np.asarray(corners.sum(axis=1)), 1.0)
        self._average = sparse.csr_array(sparse.diags_array(1.0 / counts) @ corners)
        self._centroids = sparse.csr_array(corners.T / 3.0)

    def centroids(self, positions: FloatArray) -> FloatArray:
        """Return the mean of the corners of each face, (F, 3)."""
        return np.asarray(self._centroids @ positions)

    def apply(self, positions: FloatArray, normals: FloatArray, steps: int) -> FloatArray:
        """Return ``positions`` (V, 3) after ``steps`` steps towards the ``normals`` (F, 3)."""
        # The part of a step that depends on x_i alone is one 3 x 3 matrix a vertex, the same in all steps.
        products = (normals[:, :, None] * normals[:, None, :]).reshape(-1, 9)
        pull = np.asarray(self._average @ products).reshape(-1, 3, 3)
        for _ in range(steps):
            heights = np.einsum("fc,fc->f", normals, self.centroids(positions))
            positions = positions + self._average @ (normals * heights[:, None]) - np.einsum("vij,vj->vi", pull, positions)
        return positions
