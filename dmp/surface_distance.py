"""Exact distances from points to the surface of a triangle mesh.

The triangles are sorted along a Morton curve and packed into a tree of bounding boxes with eight children a node. All
points descend together, level by level; a box is followed only where it can hold something nearer than a bound that the
nearest vertex gives. Nothing is approximated: the answer is that of comparing every point with every triangle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from dmp.errors import MeshError
from dmp.mesh import FloatArray, IntArray, TriangleMesh

_CHILDREN = 8
# Pairs of point and box, or point and triangle, that are looked at together: some 100 MB of intermediate arrays.
_MOST_PAIRS = 400_000


def distance_to_surface(points: ArrayLike, mesh: TriangleMesh) -> FloatArray:
    """Return the distance of each point (N, 3) to the nearest point of the surface of ``mesh``, (N,), in its units.

    Raises:
        MeshError: as for :func:`nearest_on_surface`.
    """
    return nearest_on_surface(points, mesh)[0]


def nearest_on_surface(points: ArrayLike, mesh: TriangleMesh) -> tuple[FloatArray, IntArray]:
    """Return the distance of each point (N, 3) to the surface, (N,), and the face that it was measured to, (N,) int64.

    Of several equally near faces, as at an edge, the one with the lowest index is returned. Faces without area count as
    the segment or point that they are.

    Raises:
        MeshError: when the mesh has no faces or the points are no (N, 3) array of finite numbers.
    """
    return NearestSurface(mesh).query(points)


class NearestSurface:
    """A surface that is asked for distances more than once; getting ready takes longer than a few thousand questions.

    Args:
        mesh: the surface.

    Raises:
        MeshError: when the mesh has no faces.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        if mesh.n_faces == 0:
            raise MeshError("The mesh to measure to has no faces, so it has no surface.")
        self._tree = _BoxTree(mesh)

    def query(self, points: ArrayLike) -> tuple[FloatArray, IntArray]:
        """Return distances (N,) and faces (N,) for points (N, 3), as :func:`nearest_on_surface` does.

        Raises:
            MeshError: when the points are no (N, 3) array of finite numbers.
        """
        positions = np.asarray(points, dtype=np.float64)
        if positions.ndim != 2 or positions.shape[1] != 3 or not np.isfinite(positions).all():
            raise MeshError("Points to measure from must be finite numbers in an array of shape (N, 3).")
        distances = np.empty(len(positions))
        nearest = np.empty(len(positions), dtype=np.int64)
        waiting = [np.arange(len(positions))]
        while waiting:
            chunk = waiting.pop()
            found = self._tree.query(positions[chunk], may_split=len(chunk) > 1)
            if found is None:
                waiting += np.array_split(chunk, 2)
            else:
                distances[chunk], nearest[chunk] = found
        return distances, nearest


def squared_distances(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return the squared distance of point i to triangle i, (N,), for points (N, 3) and triangles (N, 3 corners, 3)."""
    first, second, third = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    nearest = np.minimum(_to_segments(points, first, second), _to_segments(points, second, third))
    nearest = np.minimum(nearest, _to_segments(points, third, first))

    # Where the foot of the perpendicular lies inside the triangle, the plane is nearer than any side.
    normal = np.cross(second - first, third - first)
    squared = _dot(normal, normal)
    inside = squared > 0
    for start, end in ((first, second), (second, third), (third, first)):
        inside &= _dot(np.cross(end - start, points - start), normal) >= 0
    height = _dot(points - first, normal)
    return np.where(inside, np.divide(height**2, squared, out=nearest.copy(), where=inside), nearest)


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.einsum("nc,nc->n", first, second)


def _to_segments(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    along = end - start
    offset = points - start
    squared = _dot(along, along)
    share = np.clip(np.divide(_dot(offset, along), squared, out=np.zeros(len(points)), where=squared > 0), 0.0, 1.0)
    rest = offset - share[:, None] * along
    return _dot(rest, rest)


class _BoxTree:
    """Bounding boxes over Morton-sorted triangles; level 0 holds the triangles' own boxes."""

    def __init__(self, mesh: TriangleMesh) -> None:
        # Around the middle of the mesh, so that a place far from the origin costs no digits.
        low, high = mesh.vertices[mesh.faces].min(axis=(0, 1)), mesh.vertices[mesh.faces].max(axis=(0, 1))
        self.origin = (low + high) / 2
        triangles = mesh.vertices[mesh.faces] - self.origin
        self.order = _morton_order(triangles.mean(axis=1))
        self.triangles = triangles[self.order]
        self.corners = cKDTree(np.unique(triangles.reshape(-1, 3), axis=0))
        self.levels = [(self.triangles.min(axis=1), self.triangles.max(axis=1))]
        while len(self.levels[-1][0]) > _CHILDREN:
            lows, highs = self.levels[-1]
            groups = np.arange(0, len(lows), _CHILDREN)
            self.levels.append((np.minimum.reduceat(lows, groups), np.maximum.reduceat(highs, groups)))

    def query(self, points: FloatArray, may_split: bool) -> tuple[FloatArray, IntArray] | None:
        """Return distances and face indices, or None when the points should rather be asked in smaller groups."""
        points = points - self.origin
        # The tolerance keeps rounding from cutting off the box of the very triangle that gave the bound.
        to_corner = np.asarray(self.corners.query(points)[0], dtype=np.float64)
        bound = (to_corner * (1 + 1e-9)) ** 2 + np.finfo(float).tiny
        top = len(self.levels[-1][0])
        if may_split and len(points) * top > _MOST_PAIRS:
            return None
        point = np.repeat(np.arange(len(points)), top)
        box = np.tile(np.arange(top), len(points))
        for level in range(len(self.levels) - 1, -1, -1):
            lows, highs = self.levels[level]
            position = points[point]
            outside = np.maximum(np.maximum(lows[box] - position, position - highs[box]), 0.0)
            keep = _dot(outside, outside) <= bound[point]
            point, box = point[keep], box[keep]
            if level:
                if may_split and len(box) * _CHILDREN > _MOST_PAIRS:
                    return None
                point = np.repeat(point, _CHILDREN)
                box = (box[:, None] * _CHILDREN + np.arange(_CHILDREN)).ravel()
                exists = box < len(self.levels[level - 1][0])
                point, box = point[exists], box[exists]
        squared = squared_distances(points[point], self.triangles[box])
        face = self.order[box]
        best = np.lexsort((face, squared, point))
        first = best[np.flatnonzero(np.diff(point[best], prepend=-1))]
        return np.sqrt(squared[first]), face[first]


def _morton_order(centers: FloatArray) -> IntArray:
    """Return the order of points (N, 3) along a Morton curve with 2**20 steps a side."""
    low = centers.min(axis=0)
    extent = float((centers.max(axis=0) - low).max())
    cells = ((centers - low) * ((2**20 - 1) / extent if extent > 0 else 0.0)).astype(np.uint64)
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        cells = (cells | (cells << np.uint64(shift))) & np.uint64(mask)
    code = cells[:, 0] | (cells[:, 1] << np.uint64(1)) | (cells[:, 2] << np.uint64(2))
    return np.argsort(code, kind="stable").astype(np.int64)
