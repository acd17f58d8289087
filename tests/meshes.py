"""Small meshes with known answers, made in code."""

from __future__ import annotations

import numpy as np

from dmp.mesh import TriangleMesh


def grid_mesh(n: int, height: float = 0.0, seed: int = 0) -> TriangleMesh:
    """An open square sheet of n x n vertices with spacing 1 and, if asked, random heights."""
    x, y = np.meshgrid(np.arange(n, dtype=float), np.arange(n, dtype=float))
    z = height * np.random.default_rng(seed).standard_normal((n, n))
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = (block.ravel() for block in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    return TriangleMesh(np.column_stack([x.ravel(), y.ravel(), z.ravel()]), np.vstack([np.c_[a, b, c], np.c_[a, c, d]]))


def sphere_mesh(subdivisions: int = 2) -> TriangleMesh:
    """A unit sphere made by splitting an octahedron; 4^(subdivisions+1) + 2 vertices, faces outward."""
    vertices = [[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    for _ in range(subdivisions):
        middles: dict[tuple[int, int], int] = {}

        def middle(a: int, b: int, middles: dict[tuple[int, int], int] = middles) -> int:
            key = (min(a, b), max(a, b))
            if key not in middles:
                middles[key] = len(vertices)
                vertices.append(list((np.array(vertices[a]) + np.array(vertices[b])) / 2))
            return middles[key]

        faces = [
            small
            for a, b, c in faces
            for ab, bc, ca in [(middle(a, b), middle(b, c), middle(c, a))]
            for small in ([a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca])
        ]
    points = np.array(vertices)
    return TriangleMesh(points / np.linalg.norm(points, axis=1, keepdims=True), np.array(faces))
