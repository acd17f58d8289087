"""Impulsive noise: a share of the vertices far off and the rest exact. Finds the former and leaves the latter alone."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from dmp.geometry import vertex_normals
from dmp.mesh import BoolArray, FloatArray, IntArray
from dmp.recorrupted.noise_model import averaging, lightly_smoothed
from dmp.topology import adjacency, edge_face_counts

# A vertex is a spike when it stands out by this many times the median vertex, and by this many edge lengths at least.
_SPIKE_FACTOR, _LEAST_SPIKE, _LARGEST_THRESHOLD = 30.0, 0.1, 0.3
# Corners of a clean machine part are spikes as well, but few.
_LEAST_SHARE, _LARGEST_SHARE = 0.015, 0.5
# Along the surface the triangulation itself is irregular, so much more is normal there.
_SLIDE_FACTOR, _LEAST_SLIDE = 4.0, 0.35
_SLIDE_ROUNDS = 2


def find_outliers(positions: FloatArray, faces: IntArray) -> BoolArray:
    """Tell which vertices are outliers among exact ones, (V,) bool; none unless the rest is so much quieter than they.

    A vertex that belongs to the surface lies near some chord between two of its neighbours on opposite sides, also on a
    sharp edge, along it. What counts is the distance from the nearest such chord along the normal. Gaussian noise of
    whatever level has almost no vertex at thirty times the median of that distance.

    Args:
        positions: (V, 3), in mean edge lengths.
        faces: (F, 3).
    """
    edges, counts = edge_face_counts(faces)
    unit = float(np.median(np.linalg.norm(positions[edges[:, 0]] - positions[edges[:, 1]], axis=1)))
    spikes = _spikes(positions, faces)
    typical = float(np.median(spikes))
    none = np.zeros(len(positions), dtype=bool)
    if unit <= 0 or not _LEAST_SHARE <= np.mean(spikes > max(_LEAST_SPIKE * unit, _SPIKE_FACTOR * typical)) <= _LARGEST_SHARE:
        return none
    threshold = float(np.clip(_SPIKE_FACTOR * typical, _LEAST_SPIKE * unit, _LARGEST_THRESHOLD * unit))
    found = spikes > threshold
    inner = ~none
    inner[edges[counts == 1].ravel()] = False
    for _ in range(_SLIDE_ROUNDS):
        if np.mean(found) > _LARGEST_SHARE:
            return none
        # With the worst put right, those can be seen that only slid along the surface.
        repaired = replaced(positions, faces, found)
        slides = _slides(repaired, faces)
        usual = float(np.median(slides[~found]))
        found = found | (inner & (slides > max(_LEAST_SLIDE * unit, _SLIDE_FACTOR * usual)))
        found |= _spikes(repaired, faces) > threshold
    # Whoever would hardly be moved was suspected for its neighbours' sake only.
    moves = np.linalg.norm(replaced(positions, faces, found) - positions, axis=1)
    found &= moves > _LEAST_SPIKE * unit
    return found if np.mean(found) <= _LARGEST_SHARE else none


def replaced(positions: FloatArray, faces: IntArray, outliers: BoolArray) -> FloatArray:
    """Return positions with the ``outliers`` (V,) bool put where the surface through all others is smoothest, (V, 3).

    Smoothest is the least sum of squared umbrella vectors. Vertices that are connected to outliers only stay.
    """
    rows = np.flatnonzero(outliers)
    if not len(rows) or len(rows) == len(positions):
        return positions
    laplacian = sparse.csr_array(sparse.eye_array(len(positions)) - averaging(faces, len(positions)))
    energy = sparse.csr_array(laplacian.T @ laplacian)[rows]
    # A trace of the old position keeps the system regular where no exact vertex is near.
    weak = 1e-8
    system = sparse.csc_matrix(energy[:, rows] + weak * sparse.eye_array(len(rows)))
    rest = np.flatnonzero(~outliers)
    result = positions.copy()
    result[rows] = splu(system).solve(weak * positions[rows] - energy[:, rest] @ positions[rest])
    return result


def _spikes(positions: FloatArray, faces: IntArray) -> FloatArray:
    """Return how far each vertex is from the nearest chord between two opposite neighbours, along its normal, (V,).

    Infinite distances, where no two neighbours are opposite, count as 0.
    """
    neighbours = adjacency(faces, len(positions))
    normals = vertex_normals(lightly_smoothed(positions, faces), faces)
    starts, degrees = neighbours.indptr[:-1], np.diff(neighbours.indptr)
    vertices = np.repeat(np.arange(len(positions)), degrees)
    slots = np.arange(len(vertices)) - starts[vertices]
    offsets = positions[neighbours.indices] - positions[vertices]
    nearest = np.full(len(positions), np.inf)
    for shift in range(1, int(degrees.max(initial=0)) // 2 + 1):
        asked = np.flatnonzero(degrees[vertices] > shift)
        vertex = vertices[asked]
        one, other = offsets[asked], offsets[starts[vertex] + (slots[asked] + shift) % degrees[vertex]]
        chord = other - one
        where = -np.einsum("nc,nc->n", one, chord) / np.maximum(np.einsum("nc,nc->n", chord, chord), 1e-300)
        heights = np.abs(np.einsum("nc,nc->n", one + where[:, None] * chord, normals[vertex]))
        opposite = (where > 0.2) & (where < 0.8)
        np.minimum.at(nearest, vertex[opposite], heights[opposite])
    return np.where(np.isfinite(nearest), nearest, 0.0)


def _slides(positions: FloatArray, faces: IntArray) -> FloatArray:
    """Return the lengths of the umbrella vectors across the normals, (V,)."""
    umbrella = positions - averaging(faces, len(positions)) @ positions
    normals = vertex_normals(lightly_smoothed(positions, faces), faces)
    across = umbrella - np.einsum("vc,vc->v", umbrella, normals)[:, None] * normals
    return np.linalg.norm(across, axis=1)
