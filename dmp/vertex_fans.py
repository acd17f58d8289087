"""What the faces around each vertex tell about it: normals, mean curvature, means over faces.

The incidence of vertices and faces is worked out once for a mesh; the many states of that mesh that a training passes
through then cost only sparse products. Coordinates are kept one row each, (3, F), which is several times faster than (F, 3).
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dmp.geometry import normalised
from dmp.mesh import FloatArray, IntArray
from dmp.topology import edge_face_counts


class VertexFans:
    """The fans of faces around the vertices of one mesh.

    Args:
        faces: (F, 3).
        n_vertices: number of vertices V.

    Attributes:
        faces: (F, 3), as given.
        at_boundary: (V,) bool, True for vertices of an edge that has not exactly two faces.
    """

    def __init__(self, faces: IntArray, n_vertices: int) -> None:
        self.faces = faces
        self._n_vertices = n_vertices
        self._corners = [np.ascontiguousarray(faces[:, k]) for k in range(3)]
        numbers = np.repeat(np.arange(len(faces)), 3)
        self._incidence = sparse.csr_array((np.ones(faces.size), (faces.ravel(), numbers)), shape=(n_vertices, len(faces)))
        self._face_counts = np.bincount(faces.ravel(), minlength=n_vertices)
        edges, counts = edge_face_counts(faces)
        self.at_boundary = np.zeros(n_vertices, dtype=bool)
        self.at_boundary[edges[counts != 2].ravel()] = True

    def normals(self, vertices: FloatArray) -> FloatArray:
        """Return what :func:`dmp.geometry.vertex_normals` does: unit normals, (V, 3), of vertices (V, 3)."""
        return self._normals(_cross(*self._sides(vertices)[1:]))

    def face_normals(self, vertices: FloatArray) -> FloatArray:
        """Return what :func:`dmp.geometry.face_normals` does: unit normals of the faces, (F, 3); 0 without an area."""
        area_vectors = _cross(*self._sides(vertices)[1:])
        lengths = np.sqrt(_dot(area_vectors, area_vectors))
        return np.divide(area_vectors, lengths, out=np.zeros_like(area_vectors), where=lengths > 0).T

    def means(self, face_values: FloatArray) -> FloatArray:
        """Return the unweighted mean over the faces of each vertex, (V,), of face values (F,); 0 without any face."""
        return np.asarray(self._incidence @ face_values) / np.maximum(self._face_counts, 1)

    def mean_curvature(self, vertices: FloatArray) -> FloatArray:
        """Return the mean curvature H at each vertex, (V,), in 1 / unit of the vertices (V, 3).

        H is the mean of both principal curvatures, positive where the surface bulges towards its normal: 1/R on a sphere of
        radius R whose faces look outwards. With the gradient g of the surface area, which is half the sum of
        (cot a + cot b)(x_i - x_j) over the neighbours, and the mixed area A, H = g . n / (2 A) (Meyer, Desbrun,
        Schroeder, Barr: Discrete Differential-Geometry Operators for Triangulated 2-Manifolds, 2003, equations 8 and 10,
        figure 4). NaN at the boundary, where H is not defined, and where the faces have no area.
        """
        sides = self._sides(vertices)
        area_vectors = _cross(sides[1], sides[2])
        double_areas = np.sqrt(_dot(area_vectors, area_vectors))
        inverse = np.divide(1.0, double_areas, out=np.zeros_like(double_areas), where=double_areas > 0)
        # Angle k lies opposite side k, between the two other sides.
        dots = [-_dot(sides[(k + 1) % 3], sides[(k + 2) % 3]) for k in range(3)]
        pulls = [dots[k] * inverse * sides[k] for k in range(3)]
        gradient = np.zeros((3, self._n_vertices))
        for k in range(3):
            gradient += self._summed(k, 0.5 * (pulls[(k + 1) % 3] - pulls[(k + 2) % 3]))
        areas = self._mixed_areas(sides, dots, double_areas, inverse)
        along = np.einsum("cv,vc->v", gradient, self._normals(area_vectors))
        curvature = np.full(self._n_vertices, np.nan)
        defined = (areas > 0) & ~self.at_boundary
        curvature[defined] = along[defined] / (2.0 * areas[defined])
        return curvature

    def _sides(self, vertices: FloatArray) -> list[FloatArray]:
        """Return the sides of all faces, (3, F) each; side k lies opposite corner k and runs around the face."""
        rows = np.ascontiguousarray(vertices.T, dtype=np.float64)
        first, second, third = (np.take(rows, corner, axis=1) for corner in self._corners)
        return [third - second, first - third, second - first]

    def _normals(self, area_vectors: FloatArray) -> FloatArray:
        return normalised(np.asarray(self._incidence @ np.ascontiguousarray(area_vectors.T)))

    def _summed(self, k: int, rows: FloatArray) -> FloatArray:
        """Return for each row of face values (n, F) their sums over the faces whose corner k a vertex is, (n, V)."""
        return np.stack([np.bincount(self._corners[k], weights=row, minlength=self._n_vertices) for row in rows])

    def _mixed_areas(
        self, sides: list[FloatArray], dots: list[FloatArray], double_areas: FloatArray, inverse: FloatArray
    ) -> FloatArray:
        """Return the area that belongs to each vertex, (V,): the nearest part of each face, halves and quarters if obtuse."""
        weighted = [_dot(sides[k], sides[k]) * dots[k] * inverse for k in range(3)]
        any_obtuse = (dots[0] < 0) | (dots[1] < 0) | (dots[2] < 0)
        areas = np.zeros(self._n_vertices)
        for k in range(3):
            nearest = (weighted[(k + 1) % 3] + weighted[(k + 2) % 3]) / 8.0
            shares = np.where(dots[k] < 0, double_areas / 4.0, double_areas / 8.0)
            areas += self._summed(k, np.where(any_obtuse, shares, nearest)[None])[0]
        return areas


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the scalar products of two sets of vectors, (3, F) each: (F,)."""
    return np.asarray(first[0] * second[0] + first[1] * second[1] + first[2] * second[2])


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the vector products of two sets of vectors, (3, F) each: (3, F)."""
    return np.stack([
        first[1] * second[2] - first[2] * second[1],
        first[2] * second[0] - first[0] * second[2],
        first[0] * second[1] - first[1] * second[0],
    ])  # fmt: skip
