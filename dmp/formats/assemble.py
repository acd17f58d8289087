"""From what a file holds to a triangle mesh, with a note on everything that is not taken over as it stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dmp.formats.polygons import MAXIMUM_CORNERS, triangulate
from dmp.formats.source import FormatError
from dmp.formats.zero_runs import longest_zero_run, refuse_zero_run
from dmp.geometry import face_areas
from dmp.mesh import BoolArray, FloatArray, IntArray, TriangleMesh

_RESAVE = "Save or copy the file again from where it came from."
# The extents that the method can work on, and the relative area of a face without any: see dmp.problem.check_trainable.
_SMALLEST_DIAGONAL, _LARGEST_DIAGONAL = 1e-12, 1e12
_FLAT_AREA = 1e-14
_MANY_FLAT_FACES = 0.01
# Double precision that is coarser than this share of the extent holds no shape.
_COARSEST = 0.01
_UNWRITTEN_FACES = 8


@dataclass
class PolygonMesh:
    """What a reader found in a file.

    Attributes:
        vertices: positions in the order of the file, (V, 3) float64, finite.
        corners: vertex indices of all faces one after the other, (K,) int64, counted from 0, not yet checked.
        counts: corners of each face, (P,) int64.
        place: tells where in the file face number i stands, such as "line 12".
        first_index: the number that the format gives to the first vertex, for messages.
        attributes: values for each vertex, by name.
        notes: full sentences on what was left out or changed.
    """

    vertices: FloatArray
    corners: IntArray
    counts: IntArray
    place: Callable[[int], str]
    first_index: int = 0
    attributes: dict[str, NDArray] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def counted(number: int, singular: str, plural: str | None = None) -> str:
    """Return a number with its noun, such as "1 face" or "2,000 faces"."""
    return f"{number:,} {singular if number == 1 else plural or singular + 's'}"


def assemble(found: PolygonMesh) -> tuple[TriangleMesh, tuple[str, ...]]:
    """Check what a file holds and turn it into a triangle mesh.

    Corners that repeat the one before are dropped, polygons are split into triangles, faces that are left with fewer
    than three different vertices are dropped, and so are vertices that no face uses.

    Returns:
        The mesh, its vertices in the order of the file, and the notes.

    Raises:
        FormatError: without vertices or faces, with an index out of range, with an extent that is zero or beyond what
            can be worked with, or when more than half of the faces have no area.
    """
    notes = list(found.notes)
    n_vertices = len(found.vertices)
    if n_vertices == 0:
        raise FormatError("the file holds no vertices", _RESAVE)
    if len(found.counts) == 0:
        raise FormatError(
            f"the file holds {counted(n_vertices, 'vertex', 'vertices')} but no faces; it is a point cloud or was cut off",
            "Turn points into a triangle mesh first, for example in MeshLab (Surface Reconstruction: Screened Poisson).",
        )
    _check_indices(found)
    corners, counts = _without_repetitions(found.corners, found.counts)
    n_too_small = int(np.count_nonzero(counts < 3))
    if n_too_small == len(counts):
        raise FormatError("no face has three different corners, so there is no surface", _RESAVE)
    if n_too_small:
        corners, counts = corners[np.repeat(counts >= 3, counts)], counts[counts >= 3]
    used = _used(corners, n_vertices)
    diagonal = _check_extent(found.vertices if used.all() else found.vertices[used])
    # Vertices without a face may well be at the origin, such as the points that a scanner did not hit.
    refuse_zero_run(np.where(used[:, None], found.vertices, 1.0), found.first_index)
    _refuse_unwritten_faces(found)
    _refuse_large_faces(found)
    faces = triangulate(found.vertices, corners, counts)
    n_polygons = int(np.count_nonzero(counts > 3))
    if n_polygons:
        n_triangles = len(faces) - (len(counts) - n_polygons)
        notes.append(f"Split {counted(n_polygons, 'polygon')} with more than three corners into {n_triangles:,} triangles.")
    repeats = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    n_degenerate = n_too_small + int(np.count_nonzero(repeats))
    if repeats.any():
        faces = faces[~repeats]
    if n_degenerate:
        notes.append(f"Left out {counted(n_degenerate, 'degenerate face')} with fewer than three different vertices.")
    _check_areas(found.vertices, faces, n_degenerate, diagonal, notes)
    used = _used(faces, n_vertices)
    vertices, attributes = found.vertices, found.attributes
    if not used.all():
        faces = (np.cumsum(used) - 1)[faces]
        vertices = vertices[used]
        attributes = {name: values[used] for name, values in attributes.items()}
        notes.append(f"Left out {n_vertices - len(vertices):,} of {n_vertices:,} vertices, which belong to no face.")
    return TriangleMesh(vertices, faces, attributes), tuple(notes)


def _refuse_unwritten_faces(found: PolygonMesh) -> None:
    """Refuse many faces in a row that only have the number 0 as corners: they were never written."""
    if not (found.corners == 0).any():
        return
    filled = found.counts > 0
    others = np.zeros(len(found.counts), dtype=np.int64)
    others[filled] = np.add.reduceat(found.corners, (np.cumsum(found.counts) - found.counts)[filled])
    others[~filled] = 1
    start, length = longest_zero_run(others)
    if length >= _UNWRITTEN_FACES:
        raise FormatError(
            f"{found.place(start)}: from here on {length:,} faces refer only to the first vertex, so they were never written",
            _RESAVE,
        )


def _refuse_large_faces(found: PolygonMesh) -> None:
    largest = int(found.counts.argmax())
    n = int(found.counts[largest])
    if n > MAXIMUM_CORNERS:
        raise FormatError(
            f"{found.place(largest)}: a face has {n:,} corners; at most {MAXIMUM_CORNERS:,} can be read",
            "Split the large faces into triangles first, for example in MeshLab (Turn into a Pure-Triangular mesh).",
        )


def _used(indices: IntArray, n_vertices: int) -> BoolArray:
    used = np.zeros(n_vertices, dtype=bool)
    used[indices.ravel()] = True
    return used


def _check_indices(found: PolygonMesh) -> None:
    n_vertices = len(found.vertices)
    if not len(found.corners) or (found.corners.min() >= 0 and found.corners.max() < n_vertices):
        return
    corner = int(np.flatnonzero((found.corners < 0) | (found.corners >= n_vertices))[0])
    polygon = int(np.searchsorted(np.cumsum(found.counts), corner, side="right"))
    raise FormatError(
        f"{found.place(polygon)}: a face refers to vertex {int(found.corners[corner]) + found.first_index:,}, but the file has "
        f"vertices {found.first_index} to {n_vertices - 1 + found.first_index:,}",
        _RESAVE,
    )


def _check_extent(points: FloatArray) -> float:
    low, high = points.min(axis=0), points.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    if not np.isfinite(diagonal) or diagonal > _LARGEST_DIAGONAL:
        reach = float(np.abs([low, high]).max())
        raise FormatError(
            f"the coordinates are absurd: they reach {reach:.3g}, and the mesh is more than {_LARGEST_DIAGONAL:g} units large",
            "Look for damaged numbers, or scale the mesh.",
        )
    if (low == high).all():
        raise FormatError("all vertices lie in one point, so there is no surface", _RESAVE)
    if diagonal < _SMALLEST_DIAGONAL:
        raise FormatError(
            f"the mesh is only {diagonal:.3g} units large; sizes from {_SMALLEST_DIAGONAL:g} can be worked with",
            "Scale the mesh, or check that its coordinates are what they should be.",
        )
    reach = float(np.abs([low, high]).max())
    if np.spacing(reach) > _COARSEST * diagonal:
        raise FormatError(
            f"the mesh is {diagonal:.3g} units large and lies {reach:.3g} units away from the origin, where even double "
            "precision cannot hold its shape",
            "Look for damaged numbers, or move the mesh to the origin in the program it came from.",
        )
    return diagonal


def _without_repetitions(corners: IntArray, counts: IntArray) -> tuple[IntArray, IntArray]:
    """Drop each corner that is followed by itself, around the face; faces without any corner keep their place."""
    if not len(corners):
        return corners, counts
    ends = np.cumsum(counts)
    following = np.append(corners[1:], corners[:1])
    filled = counts > 0
    following[ends[filled] - 1] = corners[(ends - counts)[filled]]
    kept = corners != following
    if kept.all():
        return corners, counts
    before = np.concatenate([[0], np.cumsum(kept)])
    return corners[kept], before[ends] - before[ends - counts]


def _check_areas(vertices: FloatArray, faces: IntArray, n_degenerate: int, diagonal: float, notes: list[str]) -> None:
    flat = sum(
        int(np.count_nonzero(face_areas(vertices, faces[begin : begin + (1 << 18)]) <= _FLAT_AREA * diagonal**2))
        for begin in range(0, len(faces), 1 << 18)
    )
    n_all = len(faces) + n_degenerate
    if flat + n_degenerate > n_all / 2:
        raise FormatError(
            f"{flat + n_degenerate:,} of {n_all:,} faces have no area, so the file is damaged or was not written to its end",
            _RESAVE,
        )
    if flat >= _MANY_FLAT_FACES * n_all:
        notes.append(f"{flat:,} of {n_all:,} faces have no area.")
