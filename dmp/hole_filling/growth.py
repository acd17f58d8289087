"""A mesh that grows while its holes are filled one after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from dmp.hole_filling.fairing import harmonic
from dmp.hole_filling.patch import Patch
from dmp.mesh import IntArray, TriangleMesh


class GrowingMesh:
    """The original mesh and all patches so far; the vertices, faces and attributes of each patch come last."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self._vertices = [mesh.vertices]
        self._faces = [mesh.faces]
        self._attributes = {name: [values] for name, values in mesh.vertex_attributes.items()}
        self._n_vertices = mesh.n_vertices
        self._n_faces = mesh.n_faces

    def mesh(self) -> TriangleMesh:
        """Return the mesh so far."""
        attributes = {name: np.concatenate(parts) for name, parts in self._attributes.items()}
        return TriangleMesh(np.concatenate(self._vertices), np.concatenate(self._faces), attributes)

    def add(self, patch: Patch, names: IntArray) -> tuple[IntArray, IntArray]:
        """Append a patch and return the indices of its new vertices and of its faces.

        Args:
            patch: the finished patch.
            names: the vertex indices in the mesh of its fixed vertices, (n_fixed,).
        """
        vertices = np.arange(self._n_vertices, self._n_vertices + patch.n_inserted)
        faces = np.arange(self._n_faces, self._n_faces + len(patch.triangles))
        rim = names[: patch.n_rim]  # vertices of the original mesh: only its boundaries are filled
        for parts in self._attributes.values():
            parts.append(continued(patch, parts[0][rim]))
        self._vertices.append(patch.positions[patch.n_fixed :] + patch.origin)
        self._faces.append(np.concatenate([names, vertices])[patch.triangles])
        self._n_vertices += len(vertices)
        self._n_faces += len(faces)
        return vertices, faces


class FacesAtVertices:
    """Look up the faces around given vertices without going through all faces for each hole."""

    def __init__(self, faces: IntArray, vertices: IntArray, n_vertices: int) -> None:
        wanted = np.zeros(n_vertices, dtype=bool)
        wanted[vertices] = True
        self.faces = faces[wanted[faces].any(axis=1)]
        rows = np.repeat(np.arange(len(self.faces)), 3)
        shape = (n_vertices, len(self.faces))
        self.table = sparse.csr_array((np.ones(len(rows), dtype=bool), (self.faces.ravel(), rows)), shape=shape)

    def __call__(self, vertices: IntArray) -> IntArray:
        """Return the faces (k, 3) that touch one of ``vertices``, which have to be among those given at the start."""
        start, end = self.table.indptr[vertices], self.table.indptr[vertices + 1]
        rows = np.concatenate([self.table.indices[a:b] for a, b in zip(start, end, strict=True)])
        return self.faces[np.unique(rows)]


def continued(patch: Patch, at_rim: NDArray) -> NDArray:
    """Continue a vertex attribute from the rim, (n,) or (n, k), to the new vertices.

    Numbers and colours (bytes) are interpolated smoothly. Anything else, such as labels, is taken from the nearest rim vertex.
    """
    if at_rim.dtype.kind == "f" or at_rim.dtype in (np.uint8, np.uint16):
        values = harmonic(patch, at_rim.reshape(patch.n_rim, -1).astype(np.float64))
        if at_rim.dtype.kind != "f":
            values = np.rint(values)
        return values.reshape(-1, *at_rim.shape[1:]).astype(at_rim.dtype)
    nearest = cKDTree(patch.positions[: patch.n_rim]).query(patch.positions[patch.n_fixed :])[1]
    return at_rim[nearest]
