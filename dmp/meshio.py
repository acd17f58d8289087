"""Reading and writing mesh files: the right vertices in the file's order, or one sentence that says why not.

The content of a file decides how it is read, not the extension of its name. Nothing but the chosen file is opened: no
material libraries, no textures. Everything that is left out, split or joined is told in a note.
"""

from __future__ import annotations

import errno
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from dmp.errors import MeshFileError
from dmp.files import atomic_write, in_words
from dmp.formats.assemble import PolygonMesh, assemble
from dmp.formats.gltf import read_gltf
from dmp.formats.names import READABLE_SUFFIXES, WRITABLE_SUFFIXES, Format
from dmp.formats.obj import read_obj
from dmp.formats.obj_writing import has_colours, write_obj
from dmp.formats.off import read_off, write_off
from dmp.formats.ply import read_ply
from dmp.formats.ply_writing import write_ply
from dmp.formats.recognise import recognise
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.stl import read_binary_stl, rounding_of_stl, write_stl
from dmp.formats.stl_text import read_text_stl
from dmp.formats.threemf import read_threemf
from dmp.formats.vtk_legacy import read_vtk
from dmp.formats.vtk_writing import write_vtp
from dmp.formats.vtk_xml import read_vtp
from dmp.mesh import TriangleMesh

_READERS: dict[Format, Callable[[SourceFile], PolygonMesh]] = {
    "obj": read_obj,
    "ply": read_ply,
    "stl": read_binary_stl,
    "text stl": read_text_stl,
    "off": read_off,
    "glb": read_gltf,
    "gltf": read_gltf,
    "3mf": read_threemf,
    "vtp": read_vtp,
    "vtk": read_vtk,
}
_WRITERS: dict[str, Callable[[TriangleMesh], Iterator[bytes]]] = {
    ".obj": write_obj,
    ".ply": write_ply,
    ".stl": write_stl,
    ".off": write_off,
    ".vtp": write_vtp,
}
_CHECKED_BYTES = 1 << 20
# A relative change of the coordinates up to which nobody needs to be told.
_TOLERATED_ROUNDING = 1e-6


def read_mesh(path: Path | str) -> TriangleMesh:
    """Read a triangle mesh; see :func:`read_mesh_with_notes`."""
    return read_mesh_with_notes(path)[0]


def read_mesh_with_notes(path: Path | str) -> tuple[TriangleMesh, tuple[str, ...]]:
    """Read a triangle mesh from an OBJ, PLY, STL, OFF, GLB, glTF, 3MF, VTP or VTK file.

    The vertices keep their order and their digits, up to double precision. Polygons are split into triangles, equal
    corners of STL triangles and equal vertices of glTF joined, degenerate faces and vertices without a face left out;
    colours and other numbers of the vertices become attributes (:mod:`dmp.formats.ply` has the names).

    Returns:
        The mesh, and full sentences on everything that is not as it stands in the file.

    Raises:
        MeshFileError: when the file is missing, is no regular file, is damaged, of another format, without faces,
            larger than 4 GB, or changes while it is read.
    """
    try:
        with SourceFile(path) as source, np.errstate(all="ignore"):
            try:
                return _read(source)
            except FormatError:
                source.check_unchanged()  # a file that is being written looks damaged; that is the cause to tell
                raise
    except FormatError as error:
        raise MeshFileError(path, error.cause, error.remedy) from error
    except MemoryError as error:
        raise MeshFileError(
            path, "there is not enough memory to read the file", "Close other programs, or simplify the mesh first."
        ) from error
    except Exception as error:
        # No content of a file may end the program; what arrives here is a fault of a reader all the same.
        raise MeshFileError(
            path,
            f"the file cannot be read ({type(error).__name__}: {error})",
            "It is probably damaged; save it again in the program it came from.",
        ) from error


def _read(source: SourceFile) -> tuple[TriangleMesh, tuple[str, ...]]:
    kind, notes = recognise(source)
    found = _READERS[kind](source)
    source.check_unchanged()
    mesh, more_notes = assemble(found)
    return mesh, (*notes, *more_notes)


def write_mesh(path: Path | str, mesh: TriangleMesh) -> tuple[str, ...]:
    """Write a mesh to an OBJ, PLY, STL, OFF or VTP file, whole or not at all.

    PLY and VTP keep everything; OBJ and OFF keep the exact positions; OBJ keeps colours as well; STL rounds positions to single
    precision.

    Args:
        path: where to write; the extension decides the format. A file of that name is replaced only once the new one
            is complete.
        mesh: what to write.

    Returns:
        Full sentences on everything that the format could not keep.

    Raises:
        MeshFileError: when the extension is unknown, the mesh does not fit the format, or the file cannot be written.
            A file that was there before is as it was then.
    """
    target = Path(path)
    writer = _WRITERS.get(target.suffix.lower())
    if writer is None:
        raise MeshFileError(
            path,
            f"the extension '{target.suffix}' is {_unwritable(target.suffix)}"
            if target.suffix
            else "the name has no extension",
            f"Choose a name that ends in one of {', '.join(WRITABLE_SUFFIXES)}.",
        )
    checksum, n_bytes = 0, 0

    def check(temporary: Path) -> None:
        found, n_found = 0, 0
        with temporary.open("rb") as file:
            while block := file.read(_CHECKED_BYTES):
                found = zlib.crc32(block, found)
                n_found += len(block)
        if (found, n_found) != (checksum, n_bytes):
            raise OSError(errno.EIO, "the disk returns other data than was written", str(target))

    try:
        with atomic_write(target, check=check) as file:
            for block in writer(mesh):
                file.write(block)
                checksum = zlib.crc32(block, checksum)
                n_bytes += len(block)
    except FormatError as error:
        raise MeshFileError(path, f"the mesh cannot be written: {error.cause}", error.remedy) from error
    except OSError as error:
        raise MeshFileError(
            path, f"the file cannot be written because {in_words(error)}", "Nothing was changed. Choose another folder or name."
        ) from error
    except ValueError as error:  # the operating system cannot even be asked about a name with a zero character
        raise MeshFileError(path, "the name holds a character that no file name can hold", "Choose another name.") from error
    return _losses(target.suffix.lower(), mesh)


def _unwritable(suffix: str) -> str:
    return "of a format that can be read only" if suffix.lower() in READABLE_SUFFIXES else "no format that can be written"


def _losses(suffix: str, mesh: TriangleMesh) -> tuple[str, ...]:
    """Return sentences on what the format could not keep."""
    if suffix in (".ply", ".vtp"):
        return ()
    notes: list[str] = []
    lost = sorted(mesh.vertex_attributes)
    if suffix == ".obj" and has_colours(mesh):
        lost.remove("color")
        if mesh.vertex_attributes["color"].shape[1] == 4:
            notes.append("OBJ cannot hold the opacity of the colours.")
    if lost:
        notes.append(f"{suffix[1:].upper()} cannot hold {', '.join(lost)}; PLY can.")
    if suffix == ".stl":
        rounding = rounding_of_stl(mesh)
        if rounding > _TOLERATED_ROUNDING:
            notes.append(f"STL rounded coordinates by up to {rounding:.2g} of the size of the mesh; PLY is exact.")
        else:
            notes.append("STL holds coordinates in single precision only; PLY is exact.")
    return tuple(notes)


__all__ = ["READABLE_SUFFIXES", "WRITABLE_SUFFIXES", "read_mesh", "read_mesh_with_notes", "write_mesh"]
