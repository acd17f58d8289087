"""Noisy meshes of any size for timing, made in a moment."""

from __future__ import annotations

import numpy as np

from dmp.mesh import TriangleMesh
from dmp.noise import add_noise


def noisy_torus(n_vertices: int, *, level: float = 0.2, seed: int = 0, shuffled: bool = True) -> TriangleMesh:
    """Return a wavy torus with noise, of valence 6 throughout.

    Args:
        n_vertices: about how many vertices; the grid has 3 vertices around the ring for 1 around the tube.
        level: standard deviation of the noise, mean edge lengths.
        seed: of noise and order.
        shuffled: whether vertices and faces come in no order, as some programs write them; a scan's own order is kinder.
    """
    tube = max(4, round(np.sqrt(n_vertices / 3)))
    ring = max(4, round(n_vertices / tube))
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(ring), np.arange(tube), indexing="ij"))
    around, across = 2 * np.pi * i / ring, 2 * np.pi * j / tube
    radius = 1 + 0.08 * np.sin(9 * around) * np.sin(3 * across)
    outwards = 3 + radius * np.cos(across)
    vertices = np.column_stack([outwards * np.cos(around), outwards * np.sin(around), radius * np.sin(across)])

    def at(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        return rows % ring * tube + columns % tube

    here, right, up, both = at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)
    faces = np.concatenate([np.column_stack([here, right, both]), np.column_stack([here, both, up])])
    if shuffled:
        generator = np.random.default_rng(seed)
        order = generator.permutation(len(vertices))
        numbers = np.empty_like(order)
        numbers[order] = np.arange(len(order))
        vertices, faces = vertices[order], generator.permutation(numbers[faces])
    return add_noise(TriangleMesh(vertices, faces), level, seed=seed)
