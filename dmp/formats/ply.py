"""PLY, text and binary: positions, polygons or triangle strips, and every number that a vertex carries.

How properties of a vertex become attributes of a mesh, and the other way round:

=================================  ==========================================================
properties in the file             attribute of the mesh
=================================  ==========================================================
``red green blue [alpha]``         ``color``, (V, 3) or (V, 4)
``displacement_x`` ``_y`` ``_z``   ``displacement``, (V, 3)
``NAME_0`` … ``NAME_{k-1}``        ``NAME``, (V, k)
any other number ``NAME``          ``NAME``, (V,)
``nx ny nz``                       none: normals belong to the faces, which training moves
lists                              none
=================================  ==========================================================

Properties are joined only when they have the same type. All types are kept in both directions, but these, which PLY
does not know: truth values are written as ``uchar``, half precision as ``float``, and 64-bit integers as ``int``
where they fit, else as ``double``.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from dmp.formats.assemble import PolygonMesh, counted
from dmp.formats.ply_binary import read_binary_tables
from dmp.formats.ply_header import INDEX_LISTS, Element, Header, read_header
from dmp.formats.ply_tables import Table, read_text_tables
from dmp.formats.ply_writing import COLOUR, DISPLACEMENT, POSITION, TYPE_NAMES
from dmp.formats.source import FormatError, SourceFile
from dmp.formats.strips import unroll_strips
from dmp.mesh import FloatArray, IntArray

_NORMAL = ("nx", "ny", "nz")
_RESAVE = "Save or copy the file again from where it came from."
_CONVERT = "Open the file in the program it came from and save it as PLY again."


def read_ply(source: SourceFile) -> PolygonMesh:
    """Read a PLY file: ascii, binary little or big endian.

    Positions keep the digits of the file, up to double precision; in a text also when they are declared as ``float``.
    Elements and lists other than the faces are left out.

    Raises:
        FormatError: with line or byte, when header and content do not fit each other, a coordinate is not finite, or
            the file has no vertices.
    """
    header = read_header(source)
    vertex = header.find("vertex")
    if vertex is None:
        raise FormatError("the PLY file has no element 'vertex'", _CONVERT)
    for name in POSITION:
        item = vertex.find(name)
        if item is None or item.count_type is not None:
            raise FormatError(f"the vertices of the PLY file have no number '{name}'", _CONVERT)
    face = _face_element(header)
    notes: list[str] = []
    tables = (read_binary_tables if header.byte_order else read_text_tables)(source, header, notes)
    vertices = _positions(vertex, tables["vertex"])
    attributes = _attributes(vertex, tables["vertex"], notes)
    found = PolygonMesh(vertices, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), str, 0, attributes, notes)
    if face is not None and face.count:
        table = tables[face.name]
        item = face.find(*INDEX_LISTS)
        assert item is not None
        values, found.counts = table.lists[item.name]
        found.corners, found.place = _whole(values, found.counts, table), table.place
        if face.name == "tristrips":
            _unroll_strips(found)
    left_out = [
        counted(element.count, f"'{element.name}'", f"'{element.name}'")
        for element in header.elements
        if element.count and element is not vertex and element is not face
    ]
    if left_out:
        found.notes.append(f"Left out other elements of the file: {', '.join(left_out)}.")
    return found


def _face_element(header: Header) -> Element | None:
    """Return the element that holds the faces, or None in a point cloud."""
    for name in ("face", "tristrips"):
        element = header.find(name)
        if element is None or not element.count:
            continue
        item = element.find(*INDEX_LISTS)
        if item is None or item.count_type is None:
            raise FormatError(f"the element '{name}' of the PLY file has no list 'vertex_indices'", _CONVERT)
        if all(element.find(other) for other in INDEX_LISTS):
            raise FormatError(f"the element '{name}' of the PLY file has both {' and '.join(INDEX_LISTS)}", _CONVERT)
        if item.value_type.startswith("f"):
            raise FormatError(f"the indices of the element '{name}' are declared as '{TYPE_NAMES[item.value_type]}'", _CONVERT)
        return element
    if header.find("range_grid") is not None:
        raise FormatError(
            "the PLY file holds a range grid, one view of a scanner, and no faces",
            "Join the views into a triangle mesh first, for example in MeshLab.",
        )
    return None


def _positions(vertex: Element, table: Table) -> FloatArray:
    if not vertex.count:
        return np.zeros((0, 3))
    vertices = np.stack([np.asarray(table.numbers[name], dtype=np.float64) for name in POSITION], axis=1)
    good = np.isfinite(vertices).all(axis=1)
    if not good.all():
        row = int(good.argmin())
        raise FormatError(
            f"{table.place(row)}: vertex {row:,} has a coordinate that is not a finite number",
            "Remove the vertex and its faces, or save the mesh again.",
        )
    return vertices


def _whole(values: NDArray, counts: IntArray, table: Table) -> IntArray:
    """Return indices as int64; those of a text file come as float64."""
    if values.dtype.kind == "u" and values.dtype.itemsize == 8:
        values = np.minimum(values, np.uint64(np.iinfo(np.int64).max))
    if values.dtype.kind != "f":
        return values.astype(np.int64)
    good = (np.abs(values) < 2.0**53) & (values == np.floor(values))
    if not good.all():
        row = int(np.searchsorted(np.cumsum(counts), int(good.argmin()), side="right"))
        raise FormatError(f"{table.place(row)}: the index of a vertex is not a whole number", f"Correct the line. {_RESAVE}")
    return values.astype(np.int64)


def _unroll_strips(found: PolygonMesh) -> None:
    """Replace triangle strips, several in a row when -1 stands between them, by their triangles."""
    triangles, rows = unroll_strips(found.corners, found.counts, separators=True)
    row_place = found.place
    found.corners = triangles.ravel()
    found.counts = np.full(len(rows), 3, dtype=np.int64)
    found.place = lambda triangle: row_place(int(rows[triangle]))
    found.notes.append(f"Split triangle strips into {counted(len(rows), 'triangle')}.")


def _attributes(vertex: Element, table: Table, notes: list[str]) -> dict[str, NDArray]:
    """Return the numbers of the vertices that are not their positions, joined as the table above tells."""
    columns: dict[str, NDArray] = {}
    for item in vertex.properties:
        if item.count_type is not None:
            notes.append(f"Left out the list '{item.name}' of the vertices.")
        elif item.name not in (*POSITION, *_NORMAL) and vertex.count:
            columns[item.name] = _declared(table.numbers[item.name], item.value_type, item.name, table)
    if any(vertex.find(name) for name in _NORMAL):
        notes.append("Normals of the file were left out; they follow from the faces.")
    groups: dict[str, tuple[str, ...]] = {}
    for alternatives in (COLOUR, COLOUR[:3]):
        groups.setdefault("color", alternatives) if all(name in columns for name in alternatives) else None
    groups["displacement"] = DISPLACEMENT
    for name in columns:
        match = re.fullmatch(r"(.+)_0", name)
        if match:
            stem, k = match[1], 1
            while f"{stem}_{k}" in columns:
                k += 1
            groups[stem] = tuple(f"{stem}_{index}" for index in range(k))
    attributes: dict[str, NDArray] = {}
    joined: dict[str, str] = {}
    for group, names in groups.items():
        members = [columns[name] for name in names if name in columns]
        if group in columns or len(members) < len(names) or len({values.dtype for values in members}) > 1:
            continue
        attributes[group] = np.stack(members, axis=1)
        joined.update(dict.fromkeys(names, group))
    return {joined.get(name, name): attributes.get(joined.get(name, name), values) for name, values in columns.items()}


def _declared(values: NDArray, value_type: str, name: str, table: Table) -> NDArray:
    """Return a column in its declared type and the byte order of this machine; that of a text file comes as float64."""
    target = np.dtype(value_type)
    if target.kind == "f" or values.dtype.kind != "f":
        with np.errstate(over="ignore"):
            return values.astype(target)
    limits = np.iinfo(target)
    good = (values >= limits.min) & (values <= limits.max) & (values == np.floor(values))
    if not good.all():
        raise FormatError(
            f"{table.place(int(good.argmin()))}: the value of '{name}' is not a whole number from {limits.min} to {limits.max}",
            f"Correct the line. {_RESAVE}",
        )
    return values.astype(target)
