"""Close one hole from beginning to end: surroundings, triangulation, refinement and fairing, and the check of the result."""

from __future__ import annotations

import numpy as np

from dmp.geometry import face_areas
from dmp.hole_filling.checking import CannotCloseError, folds, has_flat_triangles, outside_normals, remarks_on, unfolded
from dmp.hole_filling.fairing import MOST_DIRECT, fair, harmonic
from dmp.hole_filling.flipping import flip_edges
from dmp.hole_filling.long_rims import long_rim_triangulation
from dmp.hole_filling.patch import Patch, edge_keys, half_edges
from dmp.hole_filling.refinement import collapse_short_edges, refine, split_long_edges, spread_vertices
from dmp.hole_filling.triangulation import minimum_weight_triangulation
from dmp.mesh import FloatArray, IntArray

# More would take minutes here and hours in training.
MOST_INSERTED = 200_000
_TOO_LARGE = f"Closing it at the density around it would take more than {MOST_INSERTED:,} new vertices."

# Looking at all triangles takes time with the cube of the number of rim vertices, half a second for this many.
_LONG_RIM = 300
# A coarse patch begins with about this many of its edges along the rim.
_COARSE_RIM = 40
# Thin plate first; where that folds, which noise at the rim can bring about, more and more of a membrane.
_TENSIONS = (0.0, 0.3, np.inf)


def surroundings(vertices: FloatArray, faces: IntArray, rim: IntArray) -> tuple[Patch, IntArray]:
    """Gather what the filling of a hole has to know of the mesh.

    Args:
        vertices: all positions of the mesh, (V, 3).
        faces: the faces that touch the rim, (C, 3).
        rim: the rim vertices (n,) in the order in which new faces run around them.

    Returns:
        a patch without triangles and new vertices, and the vertex indices (N,) of its numbering in the mesh.
    """
    names = np.concatenate([rim, np.setdiff1d(faces, rim)])
    order = np.argsort(names)
    collar = order[np.searchsorted(names[order], faces)]
    origin = vertices[rim].mean(axis=0)
    positions = vertices[names] - origin
    n, n_rim = len(names), len(rim)
    keys = np.unique(edge_keys(*half_edges(collar), n))
    edges = np.stack([keys // n, keys % n], axis=1)
    lengths = np.linalg.norm(positions[edges[:, 0]] - positions[edges[:, 1]], axis=1)
    total = np.bincount(edges.ravel(), np.repeat(lengths, 2), n)
    wanted = total / np.bincount(edges.ravel(), minlength=n)
    # Vertices that lie on one another want no vertices in between.
    wanted = np.maximum(wanted, 1e-3 * lengths.mean())
    # A single short or long side says little about the density there.
    for _ in range(3):
        around = wanted[:n_rim]
        wanted[:n_rim] = (np.roll(around, 1) + 2 * around + np.roll(around, -1)) / 4
    outside_edges = edges[(edges < n_rim).all(axis=1)]
    return Patch(positions, np.empty((0, 3), dtype=np.int64), collar, wanted, n_rim, n, outside_edges, origin), names


def close_hole(start: Patch) -> tuple[Patch, list[str]]:
    """Fill a hole by our own triangulation, refinement and fairing.

    Args:
        start: the surroundings of the hole; not changed.

    Returns:
        the patch, and remarks about what did not go as planned, each the end of a sentence that begins with "The hole".

    Raises:
        CannotCloseError: when the patch would double existing faces, be too large, or fold back on the mesh around it.
    """
    _refuse_hopeless(start)
    remarks: list[str] = []
    triangles = _triangulated(start)
    begin = start.copy()
    if triangles is None:
        remarks.append(
            "is closed around a new vertex in its middle, because the mesh joins too many of its rim vertices already"
        )
        begin = _fan(start)
    else:
        begin.triangles = triangles
        # A straight rim of few vertices can leave nothing but triangles without area.
        if 3 < start.n_rim < 8 and has_flat_triangles(begin) and not has_flat_triangles(_fan(start)):
            begin = _fan(start)
    typical = begin.wanted[begin.triangles].mean(axis=1)
    if (face_areas(begin.positions, begin.triangles) / typical**2).sum() > MOST_INSERTED:
        raise CannotCloseError(_TOO_LARGE)

    best: Patch | None = None
    for tension in _TENSIONS:
        patch = begin.copy()
        _shape(patch, tension)
        patch = unfolded(patch)
        if best is None or folds(patch).n_inner < folds(best).n_inner:
            best = patch
        if folds(best).n_inner == 0 or not 0 < best.n_inserted <= MOST_DIRECT:
            break
    assert best is not None
    return best, remarks + remarks_on(best)


def finished(patch: Patch) -> tuple[Patch, list[str]]:
    """Make a patch that somebody else triangulated and refined fair; the answer is that of :func:`close_hole`.

    Raises:
        CannotCloseError: as there.
    """
    flip_edges(patch)
    fair(patch)
    spread_vertices(patch, 3)
    flip_edges(patch)
    fair(patch)
    patch = unfolded(patch)
    return patch, remarks_on(patch)


def _shape(patch: Patch, tension: float) -> None:
    """Refine and fair from coarse to fine: a coarse patch finds the large shape at little cost, a fine one the rest."""
    scale = 2.0 ** max(int(np.log2(patch.n_rim / _COARSE_RIM)), 0)
    while scale >= 1:
        if not refine(patch, scale, MOST_INSERTED):
            raise CannotCloseError(_TOO_LARGE)
        fair(patch, tension)
        patch.wanted[patch.inserted] = harmonic(patch, patch.wanted[: patch.n_rim, None])[:, 0]
        scale /= 2
    if not patch.n_inserted:
        return
    # Fairing has changed lengths once more.
    for _ in range(5 if patch.n_inserted <= MOST_DIRECT else 1):
        before = patch.n_inserted
        flip_edges(patch, split_long_edges(patch))
        has_changed = patch.n_inserted > before
        for _ in range(10):
            before = patch.n_inserted
            flip_edges(patch, collapse_short_edges(patch))
            if patch.n_inserted == before:
                break
            has_changed = True
        spread_vertices(patch, 3)
        flip_edges(patch)
        fair(patch, tension)
        if not has_changed:
            break
    # Fairing stretches some edges where the surface bulges; along the surface they can be evened out without harm.
    for _ in range(3):
        spread_vertices(patch, 3)
        flip_edges(patch)
        before = patch.n_inserted
        flip_edges(patch, collapse_short_edges(patch))
        if patch.n_inserted == before:
            break


def _triangulated(start: Patch) -> IntArray | None:
    """Return the triangles of the best triangulation of the rim that was found, or None."""
    n = start.n_rim
    corners, normals = start.positions[:n], outside_normals(start)
    if n > _LONG_RIM:
        return long_rim_triangulation(corners, normals, start.outside_edges)
    forbidden = np.zeros((n, n), dtype=bool)
    forbidden[start.outside_edges[:, 0], start.outside_edges[:, 1]] = True
    return minimum_weight_triangulation(corners, normals, forbidden | forbidden.T)


def _fan(start: Patch) -> Patch:
    """Join every side of the rim to one new vertex: no edge of such a patch can exist already."""
    patch = start.copy()
    n = patch.n_rim
    center = patch.add_vertices(patch.positions[:n].mean(axis=0)[None], patch.wanted[:n].mean()[None])
    corners = np.arange(n)
    patch.triangles = np.stack([corners, (corners + 1) % n, np.full(n, center)], axis=1)
    return patch


def _refuse_hopeless(start: Patch) -> None:
    if not np.ptp(start.positions[: start.n_rim], axis=0).any():
        raise CannotCloseError("All its vertices lie in one point.")
    if start.n_rim == 3 and (start.collar < 3).all(axis=1).any():
        raise CannotCloseError("It is the outline of a single triangle, so a face that closes it would lie on that one.")
