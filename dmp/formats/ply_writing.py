"""Writing binary PLY with everything that a mesh carries; :mod:`dmp.formats.ply` has the table of names."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dmp.formats.source import FormatError
from dmp.mesh import TriangleMesh

POSITION = ("x", "y", "z")
COLOUR = ("red", "green", "blue", "alpha")
DISPLACEMENT = ("displacement_x", "displacement_y", "displacement_z")
TYPE_NAMES = {
    "i1": "char",
    "u1": "uchar",
    "i2": "short",
    "u2": "ushort",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}
_ROWS = 1 << 16


def write_ply(mesh: TriangleMesh) -> Iterator[bytes]:
    """Yield a mesh as binary little-endian PLY with double-precision positions and all vertex attributes.

    Raises:
        FormatError: when an attribute is not numeric, or its name cannot stand in a PLY header or is taken.
    """
    columns = _columns(mesh)
    row_type = np.dtype([(name, values.dtype) for name, values in columns.items()])
    lines = ["ply", "format binary_little_endian 1.0", "comment Written by dmp-viewer", f"element vertex {mesh.n_vertices}"]
    lines += [f"property {TYPE_NAMES[values.dtype.str[1:]]} {name}" for name, values in columns.items()]
    lines += [f"element face {mesh.n_faces}", "property list uchar int vertex_indices", "end_header", ""]
    yield "\n".join(lines).encode()
    for begin in range(0, mesh.n_vertices, _ROWS):
        rows = np.empty(min(_ROWS, mesh.n_vertices - begin), dtype=row_type)
        for name, values in columns.items():
            rows[name] = values[begin : begin + _ROWS]
        yield rows.tobytes()
    for begin in range(0, mesh.n_faces, _ROWS):
        faces = np.empty(min(_ROWS, mesh.n_faces - begin), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        faces["count"], faces["corners"] = 3, mesh.faces[begin : begin + _ROWS]
        yield faces.tobytes()


def property_columns(name: str, values: NDArray) -> dict[str, NDArray]:
    """Return the properties under which a vertex attribute, (V,) or (V, k), is written, little-endian, by name.

    Raises:
        FormatError: when its type or its name cannot stand in a PLY file.
    """
    stored = _stored(name, values)
    if stored.ndim == 1:
        parts = {name: stored}
    else:
        k = stored.shape[1]
        if name == "color" and k in (3, 4):
            names: tuple[str, ...] = COLOUR[:k]
        elif name == "displacement" and k == 3:
            names = DISPLACEMENT
        else:
            names = tuple(f"{name}_{index}" for index in range(k))
        parts = {part: stored[:, index] for index, part in enumerate(names)}
    for part in parts:
        if part in POSITION or not re.fullmatch(r"[^\s\x00-\x1f\x7f]+", part):
            raise _unnameable(name, part)
    return parts


def _columns(mesh: TriangleMesh) -> dict[str, NDArray]:
    """Return what is written for each vertex, by the name of its property, little-endian."""
    columns = {name: mesh.vertices[:, axis].astype("<f8") for axis, name in enumerate(POSITION)}
    for name, values in mesh.vertex_attributes.items():
        for part, column in property_columns(name, values).items():
            if part in columns:
                raise _unnameable(name, part)
            columns[part] = column
    return columns


def _unnameable(name: str, part: str) -> FormatError:
    return FormatError(
        f"the vertex attribute '{name}' cannot be written, because PLY cannot hold a property named '{part}' here",
        "Rename the attribute, or save as OBJ without it.",
    )


def _stored(name: str, values: NDArray) -> NDArray:
    """Return an attribute in a type that PLY knows, little-endian."""
    if values.dtype.kind == "b":
        return values.astype("u1")
    if values.dtype == np.float16:
        return values.astype("<f4")
    if values.dtype.kind in "iu" and values.dtype.itemsize == 8:
        if not values.size or (values.min() >= -(2**31) and values.max() < 2**31):
            return values.astype("<i4")
        if values.min() >= -(2**53) and values.max() <= 2**53:
            return values.astype("<f8")
    elif values.dtype.kind in "iuf" and values.dtype.itemsize <= 8:
        return values.astype(values.dtype.newbyteorder("<"))
    raise FormatError(
        f"the vertex attribute '{name}' has the type {values.dtype}, which PLY cannot hold exactly", "Save as OBJ without it."
    )
