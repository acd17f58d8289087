"""Spheres in closed form: geodesic triangulations, and the sphere with repeated bumps."""

from __future__ import annotations

import numpy as np

from dmp.mesh import FloatArray, TriangleMesh
from dmp.topology import adjacency

_GOLDEN = (1.0 + np.sqrt(5.0)) / 2.0
_ICOSAHEDRON_VERTICES = np.concatenate(
    [
        [[-1, _GOLDEN, 0], [1, _GOLDEN, 0], [-1, -_GOLDEN, 0], [1, -_GOLDEN, 0]],
        [[0, -1, _GOLDEN], [0, 1, _GOLDEN], [0, -1, -_GOLDEN], [0, 1, -_GOLDEN]],
        [[_GOLDEN, 0, -1], [_GOLDEN, 0, 1], [-_GOLDEN, 0, -1], [-_GOLDEN, 0, 1]],
    ]
)
_ICOSAHEDRON_FACES = np.concatenate(
    [
        [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8]],
        [[3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]],
    ]
)


def icosphere(frequency: int) -> TriangleMesh:
    """Return the unit sphere as an icosahedron whose edges are divided into ``frequency`` parts.

    It has 10 f^2 + 2 vertices and 20 f^2 faces; twelve vertices have valence 5, all others 6.
    """
    index_of: dict[tuple[tuple[int, int], ...], int] = {}
    positions: list[FloatArray] = []
    faces: list[tuple[int, int, int]] = []

    def vertex(corners: tuple[int, int, int], weights: tuple[int, int, int]) -> int:
        # A point on an edge or corner is shared: its key holds only the corners with a share in it.
        key = tuple(sorted((c, w) for c, w in zip(corners, weights, strict=True) if w))
        if key not in index_of:
            index_of[key] = len(positions)
            positions.append(sum((w * _ICOSAHEDRON_VERTICES[c] for c, w in key), np.zeros(3)))
        return index_of[key]

    for face in _ICOSAHEDRON_FACES:
        corners = (int(face[0]), int(face[1]), int(face[2]))
        for i in range(frequency):
            for j in range(frequency - i):
                k = frequency - i - j
                here, right, up = (vertex(corners, w) for w in ((k, i, j), (k - 1, i + 1, j), (k - 1, i, j + 1)))
                faces.append((here, right, up))
                if k > 1:
                    faces.append((right, vertex(corners, (k - 2, i + 1, j + 1)), up))
    return TriangleMesh(_unit(np.stack(positions)), np.array(faces))


def bumpy_sphere(frequency: int = 24, bump_frequency: int = 3, height: float = 0.13, width: float = 0.18) -> TriangleMesh:
    """Return a sphere of radius 1 with equal rounded bumps in an even pattern, like the one in the paper's figures.

    At the angle a from the nearest bump centre the radius is 1 + height * max(0, 1 - (a / width)^2)^2. The triangles
    of the geodesic sphere are evened out on the finished surface.

    Args:
        frequency: of the geodesic sphere; 10 f^2 + 2 vertices.
        bump_frequency: the bumps are at the vertices of the geodesic sphere of this frequency, 92 for 3.
        height: of the bumps above radius 1.
        width: angular radius of a bump.
    """
    sphere = icosphere(frequency)
    centres = icosphere(bump_frequency).vertices

    def raised(directions: FloatArray) -> FloatArray:
        nearest = np.stack([(directions * centre).sum(axis=1) for centre in centres]).max(axis=0)
        angles = np.arccos(np.clip(nearest, -1.0, 1.0))
        return directions * (1.0 + height * np.maximum(0.0, 1.0 - (angles / width) ** 2) ** 2)[:, None]

    neighbours = adjacency(sphere.faces, sphere.n_vertices)
    valences = neighbours.sum(axis=1)[:, None]
    positions = raised(sphere.vertices)
    for _ in range(60):
        positions = raised(_unit((positions + (neighbours @ positions) / valences) / 2))
    return sphere.with_vertices(positions)


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.sqrt((vectors**2).sum(axis=1, keepdims=True))
