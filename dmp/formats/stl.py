"""Binary STL, and joining the corners of its triangles where their coordinates are exactly equal."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from dmp.formats.assemble import PolygonMesh, counted
from dmp.formats.source import FormatError, SourceFile
from dmp.geometry import face_normals
from dmp.mesh import IntArray, TriangleMesh

HEADER_BYTES = 84
FACET_BYTES = 50
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_FACETS = 1 << 19
# An odd number without a pattern: 2^64 divided by the golden ratio, as in Knuth's multiplicative hashing.
_MIXER = np.uint64(0x9E3779B97F4A7C15)
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
    for begin in range(0, n_facets, _FACETS):
        n = min(_FACETS, n_facets - begin)
        points[begin : begin + n] = np.frombuffer(source.read_exactly(n * FACET_BYTES), dtype=_FACET)["corners"]
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
    notes = []
    if surplus := source.size - expected:
        source.seek(expected)
        rest = source.read_exactly(surplus)
        if surplus >= FACET_BYTES and rest.strip(b"\0 \t\r\n\x1a"):
            raise FormatError(
                f"byte {expected:,}: {surplus:,} bytes follow after the {n_facets:,} triangles that the header declares",
                f"The count is wrong, or the file is damaged. {_RESAVE}",
            )
        notes.append(f"Ignored {counted(surplus, 'byte')} after the end of the mesh.")
    return weld(points, lambda facet: f"byte {HEADER_BYTES + FACET_BYTES * facet:,}", notes)


def weld(points: NDArray, place: Callable[[int], str], notes: list[str]) -> PolygonMesh:
    """Join the corners of triangles, (F, 3, 3) float32 or float64, that have exactly the same coordinates.

    The vertices come in the order in which they first appear.
    """
    corners = points.reshape(-1, 3) + points.dtype.type(0)  # -0 becomes 0, so that equal numbers have equal bytes
    order = _order_of_equals(corners)
    ordered = corners[order]
    is_first = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))
    representatives = np.minimum.reduceat(order, np.flatnonzero(is_first))
    ranks = np.empty(len(representatives), dtype=np.int64)
    ranks[np.argsort(representatives)] = np.arange(len(representatives))
    indices = np.empty(len(corners), dtype=np.int64)
    indices[order] = ranks[np.cumsum(is_first) - 1]
    vertices = corners[np.sort(representatives)].astype(np.float64)
    notes.append(
        f"Joined {counted(len(corners), 'corner')} with equal coordinates into {counted(len(vertices), 'vertex', 'vertices')}."
    )
    return PolygonMesh(vertices, indices, np.full(len(points), 3, dtype=np.int64), place, notes=notes)


def _order_of_equals(corners: NDArray) -> IntArray:
    """Return an order of the rows (N, 3) in which equal ones stand side by side."""
    bits = corners.view(np.uint32 if corners.dtype.itemsize == 4 else np.uint64).astype(np.uint64)
    key = np.zeros(len(corners), dtype=np.uint64)
    for axis in range(3):  # sorting one number that mixes the coordinates is several times faster than sorting rows
        key = (key + bits[:, axis]) * _MIXER
        key ^= key >> np.uint64(29)
    order = np.argsort(key)
    same_key = key[order][1:] == key[order][:-1]
    ordered = corners[order]
    if (same_key & (ordered[1:] != ordered[:-1]).any(axis=1)).any():
        order = np.lexsort(corners.T)
    return order


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
