"""Find where a patch is folded onto itself or onto the mesh around it, mend what can be mended, refuse what is useless."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmp.geometry import face_normals
from dmp.hole_filling.flipping import flip_edges, smallest_angles
from dmp.hole_filling.patch import Patch, half_edges, inner_edges, neighbour_means
from dmp.mesh import FloatArray, IntArray

# Two faces whose normals are further apart than this lie on one another rather than side by side.
_FOLDED = np.cos(np.radians(150.0))
# Triangles with a smaller angle than this have no area for all practical purposes; radians.
_NO_ANGLE = 1e-6


class CannotCloseError(Exception):
    """A hole that cannot be closed, with the reason in one sentence; caught where all holes of a mesh are filled."""


@dataclass(frozen=True)
class Folds:
    """Where faces lie on one another: corners of the patch triangles there, and how many edges within and at the rim."""

    vertices: IntArray
    n_inner: int
    n_rim: int

    @property
    def n(self) -> int:
        """Number of folded edges."""
        return self.n_inner + self.n_rim


def outside_normals(patch: Patch) -> FloatArray:
    """Return the unit normals (n, 3) of the faces beyond the sides of the rim."""
    n = patch.n_rim
    start, end = half_edges(patch.collar)
    # Faces outside run through the sides of the rim backwards.
    at_rim = (start < n) & (end < n) & (start == (end + 1) % n)
    normals = np.zeros((n, 3))
    normals[end[at_rim]] = np.tile(face_normals(patch.positions, patch.collar), (3, 1))[at_rim]
    return normals


def folds(patch: Patch) -> Folds:
    """Find the edges of ``patch``, its rim included, at which two faces are folded onto one another."""
    normals = face_normals(patch.positions, patch.triangles)
    pairs = inner_edges(patch.triangles, patch.n_vertices).triangles
    within = np.einsum("ec,ec->e", normals[pairs[:, 0]], normals[pairs[:, 1]]) < _FOLDED

    start, end = half_edges(patch.triangles)
    at_rim = np.flatnonzero((start < patch.n_rim) & (end == (start + 1) % patch.n_rim))
    owner = at_rim % len(patch.triangles)
    across = np.einsum("nc,nc->n", normals[owner], outside_normals(patch)[start[at_rim]]) < _FOLDED
    rows = np.concatenate([pairs[within].ravel(), owner[across]])
    return Folds(np.unique(patch.triangles[rows]), int(np.count_nonzero(within)), int(np.count_nonzero(across)))


def unfolded(patch: Patch) -> Patch:
    """Return the patch with new vertices near folds moved between their neighbours, if that leaves fewer folds."""
    best, found = patch, folds(patch)
    for width in (1, 2, 3):
        if not found.n:
            break
        trial = best.copy()
        averaging = neighbour_means(trial.triangles, trial.n_vertices)
        near = np.zeros(trial.n_vertices, dtype=bool)
        near[found.vertices] = True
        for _ in range(width - 1):
            near |= averaging @ near > 0
        free = trial.inserted[near[trial.inserted]]
        for _ in range(10 * width):
            trial.positions[free] = averaging[free] @ trial.positions
        flip_edges(trial)
        now = folds(trial)
        if now.n < found.n and not has_flat_triangles(trial):
            best, found = trial, now
    return best


def has_flat_triangles(patch: Patch) -> bool:
    """Tell whether a triangle of the patch has no area."""
    return bool(smallest_angles(patch.positions, patch.triangles).min() < _NO_ANGLE)


def remarks_on(patch: Patch) -> list[str]:
    """Return what is not perfect about a finished patch.

    Raises:
        CannotCloseError: when the patch lies on the faces around it, or has faces without an area.
    """
    if has_flat_triangles(patch):
        raise CannotCloseError(
            "Its sides lie on one another, so that faces between them would have no area. Join its vertices instead."
        )
    found = folds(patch)
    if found.n_rim > patch.n_rim / 2:
        raise CannotCloseError("The new faces would lie on those around it.")
    if found.n:
        return [f"is folded at {found.n} {'edge' if found.n == 1 else 'edges'}, because the mesh around it is very rough"]
    return []
