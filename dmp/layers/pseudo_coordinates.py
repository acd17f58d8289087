"""Pseudo-coordinates: the few numbers by which a mixture convolution tells the edges at a vertex apart.

The paper calls its mixture convolution anisotropic and sensitive to the shape. The code that the authors published gives it
the valences at both ends of an edge and nothing else, so it sees connectivity alone: on a regular triangulation all edges
are the same to it, whatever the shape. :func:`valence_coordinates` is that; :func:`shape_coordinates` does look at the shape.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dmp.geometry import mean_edge_length, normalised, vertex_normals
from dmp.mesh import FloatArray, IntArray
from dmp.topology import adjacency, unique_edges

N_VALENCE_COORDINATES = 2
N_SHAPE_COORDINATES = 5
# Farther out a coordinate tells only that an edge is odd; a kernel cannot do anything else with it.
_FARTHEST = 3.0


def valence_coordinates(faces: IntArray, n_vertices: int) -> FloatArray:
    """Return (1 / sqrt(|N(j)|), 1 / sqrt(|N(i)|)) of each directed edge i <- j, (E, 2), as in the authors' code.

    Edges are in the order of the adjacency matrix: by i, then by j.
    """
    neighbours = adjacency(faces, n_vertices)
    valences = np.diff(neighbours.indptr)
    roots = 1.0 / np.sqrt(np.maximum(valences, 1))
    return np.column_stack([roots[neighbours.indices], np.repeat(roots, valences)])


def shape_coordinates(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Describe each directed edge i <- j in the frame of vertex i: its normal, and the principal direction across it.

    Before they are brought to mean 0 and deviation 1 over all edges (and cut at 3) the columns are

    0. length, in mean edge lengths;
    1. elevation: angle by which the edge rises over the tangent plane, radians;
    2. bend: angle between the normals at both ends, radians;
    3. and 4. a cos 2t and a sin 2t, t the angle in the tangent plane between the edge and the direction of the larger
       principal curvature. Twice the angle, because a principal direction has no sign. With the principal curvatures k_1 and
       k_2, a = |k_1 - k_2| / (|k_1| + |k_2|): 1 on a cylinder or a saddle, 0 on a sphere, where no direction stands out.

    Turning, moving or scaling the mesh changes none of them; a mirror image changes the sign of the last.

    Args:
        vertices: (V, 3); a smoothed mesh, because curvature directions of a noisy one are noise.
        faces: (F, 3).

    Returns:
        (E, 5) float64, edges in the order of the adjacency matrix: by i, then by j.
    """
    neighbours = adjacency(faces, len(vertices))
    to, source = np.repeat(np.arange(len(vertices)), np.diff(neighbours.indptr)), neighbours.indices
    normals = vertex_normals(vertices, faces)
    first = _across(normals)
    second = np.cross(normals, first)
    edges = vertices[source] - vertices[to]
    lengths = np.linalg.norm(edges, axis=1)
    heights = _dots(edges, normals[to])
    in_plane = edges - heights[:, None] * normals[to]
    directions = normalised(in_plane)
    curvatures = -2.0 * heights / np.where(lengths > 0, lengths**2, 1.0)
    cosines, sines = _dots(directions, first[to]), _dots(directions, second[to])
    principal_cosine, principal_sine = _principal_direction(
        neighbours, curvatures=curvatures, cosines=cosines, sines=sines, first=first, second=second
    )
    # Of twice the angles, by the addition theorems.
    double_cosines, double_sines = cosines**2 - sines**2, 2.0 * cosines * sines
    normals_to, normals_source = normals[to], normals[source]
    coordinates = np.column_stack(
        [
            lengths / mean_edge_length(vertices, unique_edges(faces)),
            np.arctan2(heights, np.linalg.norm(in_plane, axis=1)),
            np.arctan2(np.linalg.norm(np.cross(normals_to, normals_source), axis=1), _dots(normals_to, normals_source)),
            double_cosines * principal_cosine[to] + double_sines * principal_sine[to],
            double_sines * principal_cosine[to] - double_cosines * principal_sine[to],
        ]
    )
    return _standardised(coordinates)


def _standardised(coordinates: FloatArray) -> FloatArray:
    """Bring each column to mean 0 and deviation 1, and cut what lies beyond :data:`_FARTHEST`."""
    around = coordinates - coordinates.mean(axis=0)
    deviations = around.std(axis=0)
    # On a perfectly even shape a coordinate is constant up to rounding, and rounding must not be blown up.
    scale = np.where(deviations > 1e-9, 1.0 / np.maximum(deviations, 1e-9), 0.0)
    return np.clip(around * scale, -_FARTHEST, _FARTHEST)


def _principal_direction(
    neighbours: sparse.csr_array,
    *,
    curvatures: FloatArray,
    cosines: FloatArray,
    sines: FloatArray,
    first: FloatArray,
    second: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return a cos 2p and a sin 2p, (V,) each, p the angle from ``first`` to the direction of the larger curvature.

    The quadratic form of the curvature at a vertex is the one that fits best, in least squares, the normal curvatures towards
    its neighbours; its mean over the ring is calmer.

    Args:
        neighbours: adjacency, (V, V).
        curvatures: normal curvature of each directed edge, (E,).
        cosines: of the angles from ``first`` to the edges, (E,).
        sines: likewise.
        first: unit vectors in the tangent planes, (V, 3).
        second: the vectors across them, (V, 3).
    """
    count = neighbours.nnz
    sums = sparse.csr_array((np.ones(count), np.arange(count), neighbours.indptr), shape=(len(first), count))
    # With the root of 2 the three unknowns have the length of the form, which does not depend on the direction of the axes.
    rows = np.column_stack([cosines**2, sines**2, np.sqrt(2.0) * cosines * sines])
    normal_matrices = np.asarray(sums @ (rows[:, :, None] * rows[:, None, :]).reshape(-1, 9)).reshape(-1, 3, 3)
    # A little more of everything, so that neighbours on one line, which leave the form open, give none.
    normal_matrices += 1e-3 * np.maximum(np.diff(neighbours.indptr), 1)[:, None, None] * np.eye(3)
    right = np.asarray(sums @ (rows * curvatures[:, None]))
    along, across, mixed = np.linalg.solve(normal_matrices, right[:, :, None])[:, :, 0].T
    mixed = mixed / np.sqrt(2.0)

    # Tangent planes differ from vertex to vertex; in space the forms can be added.
    def outer(left: FloatArray, right: FloatArray) -> FloatArray:
        return left[:, :, None] * right[:, None, :]

    forms = along[:, None, None] * outer(first, first) + across[:, None, None] * outer(second, second)
    forms += mixed[:, None, None] * (outer(first, second) + outer(second, first))
    forms += np.asarray(neighbours @ forms.reshape(-1, 9)).reshape(-1, 3, 3)

    def entry(left: FloatArray, right: FloatArray) -> FloatArray:
        return np.einsum("vi,vij,vj->v", left, forms, right)

    along, across, mixed = entry(first, first), entry(second, second), entry(first, second)
    half_difference, mean = (along - across) / 2, (along + across) / 2
    whole = np.maximum(np.hypot(half_difference, mixed), np.abs(mean))
    scale = np.divide(1.0, whole, out=np.zeros_like(whole), where=whole > 0)
    return half_difference * scale, mixed * scale


def _dots(left: FloatArray, right: FloatArray) -> FloatArray:
    return np.einsum("ec,ec->e", left, right)


def _across(normals: FloatArray) -> FloatArray:
    """Return for each normal (V, 3) some unit vector across it; which one cancels out of the coordinates."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    return normalised(axis - _dots(axis, normals)[:, None] * normals)
