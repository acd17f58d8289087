"""Synthetic noise on the vertices of a clean mesh, for experiments with a known ground truth.

In every formula p_i is a vertex, h the mean edge length of the clean mesh, n_i a vertex normal (area-weighted), L the
``level`` and N(0, 1) a standard normal value. A level of 0.2 is what a good scan has, 0.5 buries small details.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from scipy import sparse

from dmp.errors import MeshError, SettingsError
from dmp.geometry import mean_edge_length, vertex_normals
from dmp.mesh import FloatArray, TriangleMesh
from dmp.topology import adjacency, unique_edges

NoiseKind = Literal["normal", "gaussian", "uniform", "impulsive", "scanner"]


def add_noise(
    mesh: TriangleMesh,
    level: float,
    kind: NoiseKind = "gaussian",
    *,
    seed: int = 0,
    share: float = 0.1,
    view: Sequence[float] | FloatArray | None = None,
    correlation_steps: int = 4,
) -> TriangleMesh:
    """Return ``mesh`` with its vertices moved at random; faces and attributes stay as they are.

    - ``"normal"``: p_i + L h N(0, 1) n_i, along the normal only.
    - ``"gaussian"``: p_i + L h (N(0, 1), N(0, 1), N(0, 1)), in any direction; L is the deviation per coordinate.
    - ``"uniform"``: p_i + h u with u uniform in the cube [-sqrt(3) L, sqrt(3) L]^3, again of deviation L per coordinate.
    - ``"impulsive"``: as ``"gaussian"`` on round(share * V) vertices chosen at random, all others exact; a level of 1 or
      more puts those far off.
    - ``"scanner"``: p_i + L h z_i d_i with neighbouring z_i alike, as the depth error of a range scanner is: N(0, 1) values
      averaged ``correlation_steps`` times (z_i <- half z_i, half the mean of its neighbours) and divided by their root mean
      square; d_i is the direction of ``view``, or n_i.

    Args:
        mesh: the clean mesh.
        level: strength L in mean edge lengths of the clean mesh, 0 or more.
        kind: which model.
        seed: of the random values; the same seed gives the same noise, and kinds differ in it.
        share: part of the vertices that ``"impulsive"`` hits, above 0 and at most 1.
        view: direction (3,) of ``"scanner"`` noise, of any length; along the normals if None.
        correlation_steps: how often ``"scanner"`` averages, 0 or more; the correlation reaches about the root of it, in edges.

    Raises:
        SettingsError: when a value is outside its range.
        MeshError: when the mesh has no edges, so that the level means nothing.
    """
    _check(level, kind, seed=seed, share=share, view=view, correlation_steps=correlation_steps)
    if not mesh.n_faces:
        raise MeshError("The mesh has no faces, so it has no edge length in which the level of noise could be measured.")
    # The kind belongs to the seed, so that comparisons between kinds do not share their random values.
    rng = np.random.default_rng((seed, get_args(NoiseKind).index(kind)))
    n_vertices = mesh.n_vertices
    if kind == "normal":
        offsets = rng.standard_normal((n_vertices, 1)) * vertex_normals(mesh.vertices, mesh.faces)
    elif kind == "gaussian":
        offsets = rng.standard_normal((n_vertices, 3))
    elif kind == "uniform":
        offsets = rng.uniform(-math.sqrt(3.0), math.sqrt(3.0), (n_vertices, 3))
    elif kind == "impulsive":
        offsets = np.zeros((n_vertices, 3))
        hit = rng.choice(n_vertices, size=max(1, round(share * n_vertices)), replace=False)
        offsets[hit] = rng.standard_normal((len(hit), 3))
    else:
        heights = _correlated(mesh, rng.standard_normal((n_vertices, 1)), correlation_steps)
        direction = vertex_normals(mesh.vertices, mesh.faces) if view is None else _unit(view)
        offsets = heights * direction
    unit = mean_edge_length(mesh.vertices, unique_edges(mesh.faces))
    return mesh.with_vertices(mesh.vertices + level * unit * offsets)


def _correlated(mesh: TriangleMesh, values: FloatArray, steps: int) -> FloatArray:
    """Return ``values`` (V, 1) averaged over neighbours ``steps`` times and scaled to a root mean square of 1."""
    neighbours = adjacency(mesh.faces, mesh.n_vertices)
    averaging = sparse.csr_array(sparse.diags_array(1.0 / np.maximum(neighbours.sum(axis=1), 1.0)) @ neighbours)
    for _ in range(steps):
        values = 0.5 * values + 0.5 * (averaging @ values)
    return values / math.sqrt(float((values**2).mean()))


def _unit(direction: Sequence[float] | FloatArray) -> FloatArray:
    vector = np.asarray(direction, dtype=np.float64)
    return vector / math.sqrt(float((vector**2).sum()))


def _check(
    level: float, kind: str, *, seed: int, share: float, view: Sequence[float] | FloatArray | None, correlation_steps: int
) -> None:
    if kind not in get_args(NoiseKind):
        raise SettingsError(f"The kind of noise must be one of {', '.join(get_args(NoiseKind))}, not '{kind}'.")
    if not (math.isfinite(level) and level >= 0):
        raise SettingsError(f"The level of noise must be 0 or more mean edge lengths, not {level}.")
    if seed < 0:
        raise SettingsError(f"The seed of the noise must be 0 or more, not {seed}.")
    if not 0 < share <= 1:
        raise SettingsError(f"The share of vertices hit by impulsive noise must be above 0 and at most 1, not {share}.")
    if correlation_steps < 0:
        raise SettingsError(f"The correlation steps of scanner noise must be 0 or more, not {correlation_steps}.")
    if view is not None:
        vector = np.asarray(view, dtype=np.float64)
        if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
            raise SettingsError("The view direction of scanner noise must be three finite numbers that are not all 0.")
