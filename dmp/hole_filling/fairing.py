"""Give a patch the smoothest shape that leaves the mesh around it without a crease.

After L. Kobbelt et al., "Interactive multi-resolution modeling on arbitrary meshes", 1998, and P. Liepa, "Filling holes
in meshes", 2003, section 5: the new vertices minimise the thin-plate energy, the sum over vertices of |L x|^2 / area,
where L is the discrete Laplacian. The sum includes the rim vertices, whose neighbours outside are known: that makes
the patch leave the rim in the direction in which the mesh arrives there. Cotangent weights are used instead of the
paper's, because they are exact on a plane, whatever the shape of the triangles.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import cg, splu

from dmp.geometry import face_area_vectors
from dmp.hole_filling.patch import Patch, neighbour_means, open_vertices
from dmp.mesh import FloatArray, IntArray

# Cotangents of very small angles would let single slivers outweigh everything else; cot 6 degrees is about 10.
_LARGEST_COTANGENT = 10.0
# Edges opposite to angles that add up to more than 180 degrees have negative weights, which can fold the surface.
_SMALLEST_WEIGHT = 0.01

# The direct solution of this many unknowns takes about a second; time and memory grow faster than the number.
MOST_DIRECT = 30_000
_STEPS = 150


def fair(patch: Patch, tension: float = 0.0) -> None:
    """Move the new vertices of ``patch`` to the fair surface.

    Args:
        patch: changed in place.
        tension: 0 for the thin plate, which continues the slope at the rim; larger values weigh the area as well, in
            units of 1 / (wanted edge length)^2, so that a slope dies out the sooner; infinity for the membrane, which
            only spans the rim.
    """
    inserted, known = patch.inserted, np.arange(patch.n_fixed)
    if not len(inserted):
        return
    faces = np.concatenate([patch.triangles, patch.collar])
    laplacian, areas = cotangent_laplacian(patch.positions, faces)
    energy = laplacian
    if np.isfinite(tension):
        # At a rim vertex beside another hole the Laplacian says nothing about the shape.
        enclosed = np.flatnonzero(~open_vertices(faces, patch.n_vertices)[: patch.n_rim])
        rows = np.concatenate([enclosed, inserted])
        part = laplacian[rows]
        energy = part.T @ sparse.diags_array(1 / areas[rows]) @ part
        energy = energy + tension / float(patch.wanted[: patch.n_rim].mean()) ** 2 * laplacian
    energy = energy.tocsr()[inserted]
    right = -(energy[:, known] @ patch.positions[known])
    patch.positions[inserted] = solved(energy[:, inserted], right, patch.positions[inserted])


def harmonic(patch: Patch, values: FloatArray) -> FloatArray:
    """Continue values at the rim (n, k) smoothly to the new vertices, (n_inserted, k).

    Every new value is the mean of those at its neighbours, so none lies outside the range along the rim.
    """
    inserted = patch.inserted
    if not len(inserted):
        return np.empty((0, values.shape[1]))
    means = neighbour_means(patch.triangles, patch.n_vertices)
    valence = np.diff(means.indptr)[inserted]
    weights = sparse.diags_array(valence.astype(np.float64)) @ means[inserted]
    matrix = sparse.diags_array(valence.astype(np.float64)) - weights[:, inserted]
    start = np.broadcast_to(values.mean(axis=0), (len(inserted), values.shape[1]))
    return solved(matrix.tocsr(), weights[:, : patch.n_rim] @ values, start)


def cotangent_laplacian(positions: FloatArray, faces: IntArray) -> tuple[sparse.csr_array, FloatArray]:
    """Return the weak Laplacian and the areas of the vertices.

    Returns:
        L, (N, N), symmetric, rows adding up to 0, the diagonal positive; and a third of the area of the faces around
        each vertex, (N,), kept away from 0.
    """
    n = len(positions)
    double_area = np.linalg.norm(face_area_vectors(positions, faces), axis=1)
    rows, columns, values = [], [], []
    for corner in range(3):
        at, one, two = faces[:, corner], faces[:, (corner + 1) % 3], faces[:, (corner + 2) % 3]
        cosine = np.einsum("fc,fc->f", positions[one] - positions[at], positions[two] - positions[at])
        # Never beyond the limit, and without dividing by an area of 0.
        below = np.maximum(np.maximum(double_area, np.abs(cosine) / _LARGEST_COTANGENT), np.finfo(float).tiny)
        cotangent = cosine / below
        rows += [one, two]
        columns += [two, one]
        values += [cotangent / 2, cotangent / 2]
    weights = sparse.csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(n, n))
    weights.sum_duplicates()
    weights.data = np.maximum(weights.data, _SMALLEST_WEIGHT)
    laplacian = sparse.diags_array(np.asarray(weights.sum(axis=1)).ravel()) - weights
    areas = np.bincount(faces.ravel(), np.repeat(double_area / 6, 3), n)
    typical = float(np.median(areas[areas > 0])) if (areas > 0).any() else 1.0
    return laplacian.tocsr(), np.maximum(areas, 1e-3 * typical)


def solved(matrix: sparse.csr_array, right: FloatArray, start: FloatArray) -> FloatArray:
    """Solve a symmetric positive definite sparse system (N, N) for the columns of ``right`` (N, k).

    Up to :data:`MOST_DIRECT` unknowns directly. Beyond, a fixed number of conjugate-gradient steps from ``start``:
    a patch that large was made fair before at half its density, so that only short waves are left to be smoothed.
    """
    if len(right) <= MOST_DIRECT:
        options = {"SymmetricMode": True}
        factors = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        return factors.solve(right)
    inverse_diagonal = sparse.diags_array(1 / matrix.diagonal())
    columns = [
        cg(matrix, right[:, k], x0=start[:, k], rtol=1e-6, maxiter=_STEPS, M=inverse_diagonal)[0] for k in range(right.shape[1])
    ]
    return np.stack(columns, axis=1)
