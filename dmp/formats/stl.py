"""Binary STL, and joining the corners of its triangles where their coordinates are exactly equal."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from dmp.formats.assemble import PolygonMesh, counted
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.weld import join_equal
from dmp.formats.zero_runs import longest_zero_run
from dmp.geometry import face_normals
from dmp.mesh import TriangleMesh

HEADER_BYTES = 84
FACET_BYTES = 50
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_FACETS = 1 << 19
# A lost sector of a disk has 512 bytes, so ten triangles.
_UNWRITTEN_FACETS = 8
# A stored normal fits when it is within 25 degrees of that of the corners.
_RELIABLE, _FITTING, _FEW_WRONG = 100, 0.9, 0.25
_RESAVE = "Save or copy the file again from where it came from."


def said_facets(head: bytes) -> int:
    """Return the number of triangles that the header of a binary STL file tells; 0 when it is shorter than a header."""
    return int.from_bytes(head[80:HEADER_BYTES], "little") if len(head) >= HEADER_BYTES else 0


def read_binary_stl(source: SourceFile) -> PolygonMesh:
    """Read a binary STL file.

    Raises:
        FormatError: with the byte, when the number of triangles does not fit the size of the file, a coordinate is not
            finite, or the file ends in zeros.
    """
    if source.size < HEADER_BYTES:
        raise FormatError(f"the file has {source.size} bytes, fewer than the {HEADER_BYTES} of an empty STL file", _RESAVE)
    n_facets = said_facets(source.head)
    expected = HEADER_BYTES + FACET_BYTES * n_facets
    if expected > source.size:
        raise FormatError(
            f"the header declares {counted(n_facets, 'triangle')}, so {expected:,} bytes, but the file has {source.size:,}",
            f"It was cut off, or the count is wrong. {_RESAVE}",
        )
    if n_facets == 0:
        raise FormatError("the header declares that the file holds no triangles", _RESAVE)
    source.seek(HEADER_BYTES)
    points = np.empty((n_facets, 3, 3), dtype=np.float32)
    normals = np.empty((n_facets, 3), dtype=np.float32)
    for begin in range(0, n_facets, _FACETS):
        n = min(_FACETS, n_facets - begin)
        facets = np.frombuffer(source.read_exactly(n * FACET_BYTES), dtype=_FACET)
        points[begin : begin + n], normals[begin : begin + n] = facets["corners"], facets["normal"]
    good = np.isfinite(points).all(axis=(1, 2))
    if not good.all():
        facet = int(good.argmin())
        raise FormatError(
            f"byte {HEADER_BYTES + FACET_BYTES * facet:,}: triangle {facet:,} has a coordinate that is not a finite number",
            "Remove the triangle, or save the mesh again.",
        )
    if not points[-1].any():
        filled = np.flatnonzero(points.any(axis=(1, 2)))
        written = int(filled[-1]) + 1 if len(filled) else 0
        raise FormatError(
            f"from byte {HEADER_BYTES + FACET_BYTES * written:,} on there are only zeros: it was never written completely",
            _RESAVE,
        )
    start, length = longest_zero_run(points)
    if length >= _UNWRITTEN_FACETS:
        raise FormatError(
            f"byte {HEADER_BYTES + FACET_BYTES * start:,}: {length:,} triangles in a row hold only zeros, "
            "so a part of the file was never written",
            _RESAVE,
        )
    notes = []
    if surplus := source.size - expected:
        source.seek(expected)
        if source.read_exactly(surplus).strip(b"\0 \t\r\n\x1a"):
            raise FormatError(
                f"byte {expected:,}: {counted(surplus, 'byte')} follow after the {n_facets:,} triangles that are declared",
                f"The count is wrong, or the file is damaged. {_RESAVE}",
            )
        if not _is_normal(normals[-1:])[0]:
            raise FormatError(
                f"{counted(surplus, 'byte')} follow after the triangles, the last of which has a normal that is none, "
                "so bytes were added or lost on the way",
                _RESAVE,
            )
        notes.append(f"Ignored {counted(surplus, 'byte')} after the end of the mesh.")
    notes += _doubts(points, normals)
    return weld(points, lambda facet: f"byte {HEADER_BYTES + FACET_BYTES * facet:,}", notes)


def _is_normal(normals: NDArray) -> NDArray[np.bool_]:
    """Tell which normals (F, 3) have the length 1, or 0 as programs write that do not care."""
    lengths = np.linalg.norm(normals.astype(np.float64), axis=1)
    return (np.abs(lengths - 1) < 0.01) | (lengths == 0)


def _doubts(points: NDArray, normals: NDArray) -> list[str]:
    """Return a note when the normals of a few triangles do not fit to their corners, though those of the others do.

    Where most do not fit, the program that wrote them did not care, and they tell nothing.

    Args:
        points: corners (F, 3, 3) float32, finite.
        normals: as they stand in the file, (F, 3) float32.
    """
    n_checked = n_wrong = 0
    first = -1
    for begin in range(0, len(points), _FACETS):
        corners = points[begin : begin + _FACETS].astype(np.float64)
        stored = normals[begin : begin + _FACETS].astype(np.float64)
        edges = corners[:, [1, 2, 0]] - corners
        areas = np.cross(edges[:, 0], edges[:, 1])
        area, longest = np.linalg.norm(areas, axis=1), np.linalg.norm(edges, axis=2).max(axis=1)
        # Of a sliver, or far from the origin, single precision does not tell where it looks.
        rounding = np.finfo(np.float32).eps * np.abs(corners).max(axis=(1, 2))
        checked = (area > _RELIABLE * rounding * longest) & (area > 1e-6 * longest**2)
        checked &= np.abs(np.linalg.norm(stored, axis=1) - 1) < 0.01
        wrong = checked & ((areas * stored).sum(axis=1) < _FITTING * area)
        if first < 0 and wrong.any():
            first = begin + int(wrong.argmax())
        n_checked += int(checked.sum())
        n_wrong += int(wrong.sum())
    if not 0 < n_wrong <= _FEW_WRONG * n_checked:
        return []
    return [
        f"The normals of {n_wrong:,} of {counted(n_checked, 'triangle')} do not fit to their corners, the first at byte "
        f"{HEADER_BYTES + FACET_BYTES * first:,}; the file may be damaged."
    ]


def weld(points: NDArray, place: Callable[[int], str], notes: list[str]) -> PolygonMesh:
    """Join the corners of triangles, (F, 3, 3) float32 or float64, that have exactly the same coordinates.

    The vertices come in the order in which they first appear.
    """
    corners = points.reshape(-1, 3)
    first, indices = join_equal(corners)
    vertices = corners[first].astype(np.float64) + 0.0  # no negative zeros
    notes.append(
        f"Joined {counted(len(corners), 'corner')} with equal coordinates into {counted(len(vertices), 'vertex', 'vertices')}."
    )
    return PolygonMesh(vertices, indices, np.full(len(points), 3, dtype=np.int64), place, notes=notes)


def write_stl(mesh: TriangleMesh) -> Iterator[bytes]:
    """Yield a mesh as binary STL, which holds single-precision corners and nothing else.

    Raises:
        FormatError: when a coordinate is beyond the range of single precision.
    """
    with np.errstate(over="ignore"):
        positions = mesh.vertices.astype("<f4")
    if not np.isfinite(positions).all():
        raise FormatError("STL cannot hold coordinates beyond 3.4e38", "Save as PLY, or scale the mesh first.")
    yield b"Written by dmp-viewer".ljust(80) + mesh.n_faces.to_bytes(4, "little")
    for begin in range(0, mesh.n_faces, _FACETS):
        faces = mesh.faces[begin : begin + _FACETS]
        facets = np.zeros(len(faces), dtype=_FACET)
        facets["normal"] = face_normals(mesh.vertices, faces)
        facets["corners"] = positions[faces]
        yield facets.tobytes()


def rounding_of_stl(mesh: TriangleMesh) -> float:
    """Return the largest change of a coordinate by single precision, as a share of the diagonal of the mesh."""
    if not mesh.n_vertices:
        return 0.0
    change = float(np.abs(mesh.vertices.astype(np.float32) - mesh.vertices).max())
    diagonal = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    return change / diagonal if diagonal > 0 else 0.0
