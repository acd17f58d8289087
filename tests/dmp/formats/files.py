"""Writing small mesh files by hand, independently of the writers under test."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from dmp.errors import MeshFileError
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh_with_notes

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
# A unit square as two triangles, not planar, so that every coordinate counts.
SQUARE_VERTICES = [[0.1, 0.0, 0.0], [1.0, 0.25, 0.0], [1.0, 1.0, -0.5], [0.0, 1.0, 1e-3]]
SQUARE_FACES = [[0, 1, 2], [0, 2, 3]]


def read(folder: Path, name: str, content: str | bytes) -> tuple[TriangleMesh, tuple[str, ...]]:
    """Write ``content`` to a file and read the mesh and the notes."""
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_mesh_with_notes(path)


def refusal(folder: Path, name: str, content: str | bytes) -> str:
    """Return the text of the error with which a file is refused, which must name the file and end in a remedy."""
    with pytest.raises(MeshFileError) as caught:
        read(folder, name, content)
    text = str(caught.value)
    assert text.startswith(f"{folder / name}: ")
    assert caught.value.cause and caught.value.remedy.endswith(".")
    # A foreign exception that was wrapped at the last moment tells its class.
    assert "Error:" not in text and "Exception" not in text
    return text


def ply_header(kind: str, n_vertices: int, n_faces: int, vertex: str = "", face: str = "") -> str:
    """Return a PLY header with double positions and further properties, each given as "type name"."""
    extra_vertex = "".join(f"property {line}\n" for line in vertex.split(";") if line)
    extra_face = "".join(f"property {line}\n" for line in face.split(";") if line)
    return (
        f"ply\nformat {kind} 1.0\ncomment made by hand\nelement vertex {n_vertices}\n"
        f"property double x\nproperty double y\nproperty double z\n{extra_vertex}"
        f"element face {n_faces}\nproperty list uchar int vertex_indices\n{extra_face}end_header\n"
    )


def binary_ply(order: str = "<", vertices: list = SQUARE_VERTICES, faces: list = SQUARE_FACES) -> bytes:
    """Return a binary PLY file of polygons; ``order`` is ``"<"`` (little endian) or ``">"``."""
    kind = "binary_little_endian" if order == "<" else "binary_big_endian"
    body = b"".join(struct.pack(f"{order}3d", *vertex) for vertex in vertices)
    body += b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in faces)
    return ply_header(kind, len(vertices), len(faces)).encode() + body


def binary_stl(triangles: np.ndarray, header: bytes = b"by hand") -> bytes:
    """Return a binary STL file of triangles (F, 3, 3)."""
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.ravel().tolist(), 0) for triangle in np.asarray(triangles))
    return header.ljust(80, b" ") + struct.pack("<I", len(triangles)) + facets


def text_stl(triangles: np.ndarray, name: str = "part") -> str:
    """Return a text STL file of triangles (F, 3, 3)."""
    facets = "".join(
        "  facet normal 0 0 1\n    outer loop\n"
        + "".join(f"      vertex {x!r} {y!r} {z!r}\n" for x, y, z in np.asarray(triangle).tolist())
        + "    endloop\n  endfacet\n"
        for triangle in triangles
    )
    return f"solid {name}\n{facets}endsolid {name}\n"


def square() -> TriangleMesh:
    """The square as a mesh."""
    return TriangleMesh(np.array(SQUARE_VERTICES), np.array(SQUARE_FACES))
