"""Triangle meshes of solids: even triangles, sharp edges and corners exactly on edges and vertices of the mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from dmp.errors import MeshError
from dmp.mesh import FloatArray, IntArray, TriangleMesh
from dmp.shapes.separation import is_closed_surface, separating_faces
from dmp.shapes.sharp_curves import find_sharp_curves
from dmp.shapes.solids import Solid
from dmp.shapes.surface_sampling import grid_crossings, project, snapped, surface_area, thinned
from dmp.topology import unique_edges

SizeFunction = Callable[[FloatArray], FloatArray]

# V points of an even triangulation of area A have edges of length sqrt(2 A / (sqrt(3) V)).
_EVEN = 2.0 / np.sqrt(3.0)
# Thinned in random order to this share of that length, about V points are left.
_THINNING = 0.715
_ATTEMPTS = 4


@dataclass(frozen=True, eq=False)
class _Plan:
    """What a solid is to be triangulated with.

    Attributes:
        solid: the solid.
        spacing: edge length wanted, times ``size`` where that is given.
        size: relative edge length at points, or None.
        near: points spread densely over the surface, (M, 3).
        fixed: points on the sharp edges, (N, 3).
        segments: pairs of fixed points that have to be joined, (S, 2).
    """

    solid: Solid
    spacing: float
    size: SizeFunction | None
    near: FloatArray
    fixed: FloatArray
    segments: IntArray


def mesh_solid(
    solid: Solid,
    n_vertices: int,
    *,
    extent: float = 1.2,
    relaxation_steps: int = 40,
    size: SizeFunction | None = None,
    seed: int = 0,
) -> TriangleMesh:
    """Triangulate the surface of ``solid``.

    Sharp edges are traced and divided evenly; the surface between them is filled with points that keep their distance;
    the points are joined as :func:`dmp.shapes.separation.separating_faces` tells. Points then move to the mean of their
    triangles' centroids (Lloyd's relaxation), back onto the surface, and are joined anew.

    Args:
        solid: its parts and gaps must be wider than about two edges; it must lie inside [-extent, extent]^3.
        n_vertices: how many vertices are wanted; the result differs by some per cent.
        extent: half the side of the cube to look into.
        relaxation_steps: 0 leaves the triangles as irregular as they fell.
        size: relative edge length wanted at points (N, 3), values (N,) above 0 with a mean of about 1; even if None.
        seed: of the random order in which points are chosen.

    Returns:
        A closed mesh with outward orientation, in which each edge has two faces.

    Raises:
        MeshError: when the shape is too fine for so few vertices.
    """
    coarse = extent / 40
    area = surface_area(solid, grid_crossings(solid, extent, coarse), coarse)
    spacing = float(np.sqrt(_EVEN * area / n_vertices))
    near = project(solid, grid_crossings(solid, extent, spacing / 1.6), steps=2)
    plan = _Plan(solid, spacing, size, near, *_sharp_points(solid, near, spacing, size))
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng((seed, attempt))
        points, faces = _filled(plan, relaxation_steps, rng)
        if is_closed_surface(faces, len(points)) and _has_edges(faces, plan.segments, len(points)):
            return TriangleMesh(np.concatenate([plan.fixed, project(solid, points[len(plan.fixed) :])]), faces)
    raise MeshError(f"The solid is too fine in places to be triangulated with about {n_vertices} vertices. Ask for more.")


def _sharp_points(solid: Solid, near: FloatArray, spacing: float, size: SizeFunction | None) -> tuple[FloatArray, IntArray]:
    """Return evenly spaced points on the sharp edges, (N, 3), and the pairs of them that follow each other, (S, 2)."""
    points: list[FloatArray] = []
    segments: list[tuple[int, int]] = []
    index_of: dict[tuple[float, ...], int] = {}
    for curve in find_sharp_curves(solid, near, spacing / 3):
        factor = 1.0 if size is None else float(size(curve.points).min())
        indices = []
        for point in curve.divided(spacing * factor):
            # Corners occur in every curve that ends there, with equal coordinates.
            key = tuple(point.tolist())
            if key not in index_of:
                index_of[key] = len(points)
                points.append(point)
            indices.append(index_of[key])
        following = [*indices[1:], indices[0]] if curve.is_loop else indices[1:]
        segments += list(zip(indices, following, strict=False))
    return np.array(points).reshape(-1, 3), np.array(segments, dtype=np.int64).reshape(-1, 2)


def _filled(plan: _Plan, relaxation_steps: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
    """Return the fixed points and evenly spread ones on the rest of the surface, (V, 3), and the faces, (F, 3)."""
    solid, n_fixed = plan.solid, len(plan.fixed)
    # Several random copies of each point, because the grid lays them unevenly.
    copies = np.repeat(plan.near, 4, axis=0)
    candidates = np.concatenate([plan.near, copies + rng.uniform(-0.5, 0.5, copies.shape) * plan.spacing])
    candidates = snapped(project(solid, candidates, steps=2))
    candidates = candidates[np.abs(solid.value(candidates)) < 1e-3 * plan.spacing]
    radii = _THINNING * plan.spacing * (np.ones(len(candidates)) if plan.size is None else plan.size(candidates))
    fixed = snapped(plan.fixed)
    points = np.concatenate([fixed, candidates[thinned(candidates, radii, fixed, rng)]])
    points = _kept_clear(solid, points, plan.segments, n_fixed)
    faces = separating_faces(solid, points)
    for step in range(relaxation_steps):
        points = _kept_clear(solid, _relaxed(solid, points, faces, n_fixed), plan.segments, n_fixed)
        # Joining anew costs most of the time and changes little once the points have spread out.
        if step < 10 or step % 3 == 0 or step == relaxation_steps - 1:
            faces = separating_faces(solid, points)
    return points, faces


def _relaxed(solid: Solid, points: FloatArray, faces: IntArray, n_fixed: int) -> FloatArray:
    """Return the points with all but the first ``n_fixed`` moved to the area-weighted mean of their triangles' centroids."""
    corners = points[faces]
    areas = np.sqrt((np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) ** 2).sum(axis=1))
    weights = np.bincount(faces.ravel(), np.repeat(areas, 3), minlength=len(points))
    moments = areas[:, None] * corners.mean(axis=1)
    targets = np.stack(
        [np.bincount(faces.ravel(), np.repeat(moments[:, i], 3), minlength=len(points)) for i in range(3)], axis=1
    )
    free = np.flatnonzero(weights > 0)
    free = free[free >= n_fixed]
    moved = points.copy()
    moved[free] = snapped(project(solid, targets[free] / weights[free, None], steps=1))
    return moved


def _kept_clear(solid: Solid, points: FloatArray, segments: IntArray, n_fixed: int) -> FloatArray:
    """Return the points with those pushed off that lie in the ball over a segment, which would keep it from being an edge."""
    if not len(segments):
        return points
    first, second = points[segments[:, 0]], points[segments[:, 1]]
    middles, lengths = (first + second) / 2, np.sqrt(((second - first) ** 2).sum(axis=1))
    nearest = np.asarray(cKDTree(middles).query(points[n_fixed:])[1])
    distances = np.sqrt(((points[n_fixed:] - middles[nearest]) ** 2).sum(axis=1))
    wanted = 0.6 * lengths[nearest]
    close = np.flatnonzero(distances < wanted)
    away = points[n_fixed + close] - middles[nearest[close]]
    scale = wanted[close] / np.maximum(distances[close], 1e-9)
    moved = points.copy()
    moved[n_fixed + close] = snapped(project(solid, middles[nearest[close]] + scale[:, None] * away, steps=2))
    return moved


def _has_edges(faces: IntArray, segments: IntArray, n_vertices: int) -> bool:
    edges = unique_edges(faces)
    ordered = np.sort(segments, axis=1)
    return bool(np.isin(ordered[:, 0] * n_vertices + ordered[:, 1], edges[:, 0] * n_vertices + edges[:, 1]).all())
