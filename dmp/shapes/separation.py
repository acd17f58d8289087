"""The triangles that separate the inside of a solid from the outside, among points on its surface."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import Delaunay

from dmp.mesh import BoolArray, FloatArray, IntArray
from dmp.shapes.solids import Solid
from dmp.topology import edge_face_counts

# Depth of the centroid, relative to the size of a tetrahedron, beyond which there is no doubt about its side.
_CLEAR = 0.1


def separating_faces(solid: Solid, points: FloatArray) -> IntArray:
    """Return the triangles between Delaunay tetrahedra inside and outside ``solid``.

    A tetrahedron is mostly inside where the centre of the sphere through its corners is. For points that lie densely on the
    surface the triangles in between are those whose dual Voronoi edge crosses it, the restricted Delaunay triangulation
    of the surface (Edelsbrunner and Shah, 1997).

    Args:
        solid: tells inside from outside.
        points: on its surface, (N, 3).

    Returns:
        (F, 3) int64, anticlockwise seen from outside, each row from its smallest index on, rows sorted.
    """
    # Many points in one plane make Qhull slow and leave flat tetrahedra on the hull; slightly curved faces avoid both.
    squared = (points**2).sum(axis=1, keepdims=True)
    tetrahedra = Delaunay(points * (1.0 - 1e-3 * squared / squared.max()))
    values = _side(solid, points[tetrahedra.simplices])
    tetrahedron, opposite = _boundary(tetrahedra, _inside(tetrahedra, values, len(points)))
    others = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    faces = tetrahedra.simplices[tetrahedron[:, None], others[opposite]].astype(np.int64)
    apex = points[tetrahedra.simplices[tetrahedron, opposite]]
    first, second, third = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
    volume = (np.cross(second - first, third - first) * (apex - first)).sum(axis=1)
    faces[volume > 0] = faces[volume > 0][:, [0, 2, 1]]
    faces = np.take_along_axis(faces, (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    return faces[np.lexsort(faces.T[::-1])]


def _side(solid: Solid, corners: FloatArray) -> FloatArray:
    """Return a value for each tetrahedron (N, 4, 3), negative if it is inside: that at the centre of its sphere.

    Where its centroid is clearly on one side, this decides: in a wedge of an acute angle the spheres' centres err.
    """
    centroids = corners.mean(axis=1)
    sizes = np.sqrt(((corners - centroids[:, None]) ** 2).sum(axis=2)).mean(axis=1)
    values = solid.value(centroids)
    doubtful = np.abs(values) <= _CLEAR * sizes
    values[doubtful] = solid.value(_circumcentres(corners[doubtful]))
    return values


def _circumcentres(corners: FloatArray) -> FloatArray:
    """Return the centres of the spheres through the corners (N, 4, 3); a far point along the normal of flat ones."""
    origin = corners[:, 0]
    a, b, c = (corners[:, i] - origin for i in (1, 2, 3))
    b_c, c_a, a_b = np.cross(b, c), np.cross(c, a), np.cross(a, b)
    numerator = sum(((x**2).sum(axis=1, keepdims=True) * y for x, y in ((a, b_c), (b, c_a), (c, a_b))), np.zeros_like(a))
    determinant = 2.0 * (a * b_c).sum(axis=1, keepdims=True)
    offset = numerator / np.where(np.abs(determinant) < 1e-300, 1e-300, determinant)
    return origin + np.clip(offset, -1e6, 1e6)


def _inside(tetrahedra: Delaunay, values: FloatArray, n_points: int) -> BoolArray:
    """Return which tetrahedra are inside, given the solid's values at their centres, with every point on the surface.

    Four points of an almost flat region can form a tetrahedron with one point under the other three. Whether it is
    inside hangs on the last digits; where it hides its point from the surface, it is given to the other side.
    """
    inside = values < 0
    neighbours_inside = (tetrahedra.neighbors >= 0) & inside[tetrahedra.neighbors]
    # A tetrahedron all of whose neighbours are on the other side would be a bubble of its own.
    alone = (neighbours_inside != inside[:, None]).all(axis=1)
    inside[alone] = ~inside[alone]
    for _ in range(3):
        tetrahedron, opposite = _boundary(tetrahedra, inside)
        uses = np.bincount(tetrahedra.simplices[tetrahedron].ravel(), minlength=n_points)
        uses -= np.bincount(tetrahedra.simplices[tetrahedron, opposite], minlength=n_points)
        for point in np.flatnonzero(uses == 0):
            around, corner = np.nonzero(tetrahedra.simplices == point)
            across = tetrahedra.neighbors[around, corner]
            across_inside = (across >= 0) & inside[across]
            hiding = around[across_inside != inside[around]]
            if hiding.size:
                flattest = hiding[np.argmin(np.abs(values[hiding]))]
                inside[flattest] = ~inside[flattest]
    return inside


def _boundary(tetrahedra: Delaunay, inside: BoolArray) -> tuple[IntArray, IntArray]:
    """Return the inside tetrahedra that have an outside neighbour, and which of their corners lies opposite to it."""
    neighbours = tetrahedra.neighbors
    boundary = np.argwhere(inside[:, None] & ((neighbours < 0) | ~inside[neighbours]))
    return boundary[:, 0], boundary[:, 1]


def is_closed_surface(faces: IntArray, n_vertices: int) -> bool:
    """Tell whether every vertex is used, every edge has two faces and the faces around each vertex form one fan."""
    _, counts = edge_face_counts(faces)
    used = np.bincount(faces.ravel(), minlength=n_vertices)
    return bool((counts == 2).all() and (used > 0).all()) and _n_fans(faces, n_vertices) == n_vertices


def _n_fans(faces: IntArray, n_vertices: int) -> int:
    """Return the number of fans of a closed mesh: groups of face corners at one vertex, joined across shared edges."""
    corner = np.arange(faces.size).reshape(-1, 3)
    following = np.roll(corner, -1, axis=1).ravel()
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    order = np.argsort(tail * n_vertices + head)
    opposite = np.searchsorted(tail * n_vertices + head, head * n_vertices + tail, sorter=order)
    # The corner at the tail of a half-edge and the corner at the head of the opposite one lie at the same vertex.
    partner = following[order[np.minimum(opposite, faces.size - 1)]]
    graph = sparse.csr_array((np.ones(faces.size), (corner.ravel(), partner)), shape=(faces.size, faces.size))
    return int(csgraph.connected_components(graph, directed=False)[0])
