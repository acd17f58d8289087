"""Changes to clean meshes that make them less comfortable: irregular triangles, slivers, boundaries, several parts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmp.errors import MeshError
from dmp.geometry import face_normals, vertex_normals
from dmp.mesh import BoolArray, FloatArray, IntArray, TriangleMesh
from dmp.topology import edge_face_counts


def without_vertices(mesh: TriangleMesh, removed: BoolArray) -> TriangleMesh:
    """Return ``mesh`` without the vertices in ``removed`` (V,) bool, the faces at them, and vertices left without a face.

    Raises:
        MeshError: when no face is left.
    """
    faces = mesh.faces[~removed[mesh.faces].any(axis=1)]
    if not len(faces):
        raise MeshError("No face of the mesh would be left.")
    kept = np.zeros(mesh.n_vertices, dtype=bool)
    kept[faces.ravel()] = True
    new_index = np.cumsum(kept) - 1
    attributes = {name: values[kept] for name, values in mesh.vertex_attributes.items()}
    return TriangleMesh(mesh.vertices[kept], new_index[faces], attributes)


def with_holes(mesh: TriangleMesh, centres: Sequence[Sequence[float]] | FloatArray, counts: Sequence[int]) -> TriangleMesh:
    """Return ``mesh`` with a hole around each of ``centres`` (N, 3), made by removing the ``counts`` vertices nearest to it."""
    removed = np.zeros(mesh.n_vertices, dtype=bool)
    for centre, count in zip(centres, counts, strict=True):
        squared = ((mesh.vertices - np.asarray(centre)) ** 2).sum(axis=1)
        removed[np.argsort(squared, kind="stable")[:count]] = True
    return without_vertices(mesh, removed)


def cut_open(mesh: TriangleMesh, normal: Sequence[float], offset: float) -> TriangleMesh:
    """Return the part of ``mesh`` with ``normal . p <= offset``, with an open, ragged boundary."""
    direction = np.asarray(normal, dtype=np.float64)
    return without_vertices(mesh, (mesh.vertices * direction).sum(axis=1) > offset)


def together(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """Return all ``meshes`` as one, without their attributes, each a component of its own."""
    starts = np.cumsum([0, *(mesh.n_vertices for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    return TriangleMesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def placed(mesh: TriangleMesh, scale: float = 1.0, shift: Sequence[float] = (0.0, 0.0, 0.0)) -> TriangleMesh:
    """Return ``mesh`` scaled about the origin, then moved by ``shift``."""
    return mesh.with_vertices(scale * mesh.vertices + np.asarray(shift, dtype=np.float64))


def shuffled_along_surface(mesh: TriangleMesh, amount: float, seed: int = 0) -> TriangleMesh:
    """Return ``mesh`` with each vertex moved at random within its tangent plane, by ``amount`` of its shortest edge at most.

    Vertices of sharp edges (over 30 degrees) and of the boundary stay. The shape hardly changes, the triangles do.
    """
    rng = np.random.default_rng(seed)
    edges, _ = edge_face_counts(mesh.faces)
    lengths = np.sqrt(((mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]]) ** 2).sum(axis=1))
    shortest = np.full(mesh.n_vertices, np.inf)
    np.minimum.at(shortest, edges.ravel(), np.repeat(lengths, 2))
    shortest[sharp_edges(mesh, 30.0).ravel()] = 0.0
    shortest[~np.isfinite(shortest)] = 0.0
    normals = vertex_normals(mesh.vertices, mesh.faces)
    directions = rng.standard_normal((mesh.n_vertices, 3))
    directions -= (directions * normals).sum(axis=1, keepdims=True) * normals
    directions /= np.maximum(np.sqrt((directions**2).sum(axis=1, keepdims=True)), 1e-12)
    reach = amount * np.sqrt(rng.uniform(size=mesh.n_vertices)) * shortest
    return mesh.with_vertices(mesh.vertices + reach[:, None] * directions)


def with_slivers(mesh: TriangleMesh, share: float, seed: int = 0) -> TriangleMesh:
    """Return ``mesh`` with a vertex put into ``share`` of its faces, a fiftieth of the height beside an edge.

    The shape stays exactly the same; each chosen face becomes three, one of them a sliver. Attributes are dropped.
    """
    rng = np.random.default_rng(seed)
    chosen = np.sort(rng.choice(mesh.n_faces, size=round(share * mesh.n_faces), replace=False))
    weights = np.array([0.02, 0.0, 0.0]) + np.array([0.0, 0.98, 0.98]) * _halves(rng, len(chosen))
    corners = mesh.faces[chosen]
    added = (weights[:, :, None] * mesh.vertices[corners]).sum(axis=1)
    new = mesh.n_vertices + np.arange(len(chosen))
    a, b, c = corners.T
    parts = [np.stack(part, axis=1) for part in ((a, b, new), (b, c, new), (c, a, new))]
    kept = np.delete(mesh.faces, chosen, axis=0)
    return TriangleMesh(np.concatenate([mesh.vertices, added]), np.concatenate([kept, *parts]))


def _halves(rng: np.random.Generator, count: int) -> FloatArray:
    share = rng.uniform(0.3, 0.7, count)
    return np.stack([np.zeros(count), share, 1.0 - share], axis=1)


def sharp_edges(mesh: TriangleMesh, least_angle: float) -> IntArray:
    """Return the edges, (N, 2), at which two face normals differ by over ``least_angle`` degrees, and boundary edges.

    Edges with more than two faces count as sharp.
    """
    half_edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    owner = np.tile(np.arange(mesh.n_faces), 3)
    order = np.lexsort((owner, half_edges[:, 1], half_edges[:, 0]))
    edges, counts = edge_face_counts(mesh.faces)
    first = np.cumsum(counts) - counts
    normals = face_normals(mesh.vertices, mesh.faces)
    sharp = counts != 2
    pairs = np.flatnonzero(~sharp)
    one, other = normals[owner[order[first[pairs]]]], normals[owner[order[first[pairs] + 1]]]
    cosine = (one * other).sum(axis=1)
    sharp[pairs] = cosine < np.cos(np.radians(least_angle))
    return edges[sharp]
