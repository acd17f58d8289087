"""Writing VTP with exact positions and everything that the vertices carry, for ParaView and its relatives."""

from __future__ import annotations

from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from dmp.formats.source import FormatError
from dmp.mesh import TriangleMesh

_TYPES = {
    **{f"i{size}": f"Int{8 * size}" for size in (1, 2, 4, 8)},
    **{f"u{size}": f"UInt{8 * size}" for size in (1, 2, 4, 8)},
    "f4": "Float32",
    "f8": "Float64",
}
_BLOCK_BYTES = 1 << 22


def write_vtp(mesh: TriangleMesh) -> Iterator[bytes]:
    """Yield a mesh as VTP: raw little-endian data appended to the XML text, positions in double precision.

    Raises:
        FormatError: when an attribute is not numeric, or its name cannot stand in XML.
    """
    values = {name: _stored(name, array) for name, array in mesh.vertex_attributes.items()}
    corners = np.ascontiguousarray(mesh.faces, dtype="<i8").reshape(-1)
    ends = np.arange(3, 3 * mesh.n_faces + 1, 3, dtype="<i8")
    arrays = [*values.values(), np.ascontiguousarray(mesh.vertices, dtype="<f8"), corners, ends]
    offsets = np.cumsum([0, *(8 + array.nbytes for array in arrays)]).tolist()
    elements = [
        _element(array, name, offset)
        for array, name, offset in zip(arrays, [*values, "Points", "connectivity", "offsets"], offsets, strict=False)
    ]
    yield (
        '<?xml version="1.0"?>\n<!-- Written by dmp-viewer -->\n'
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n<PolyData>\n'
        f'<Piece NumberOfPoints="{mesh.n_vertices}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" '
        f'NumberOfPolys="{mesh.n_faces}">\n<PointData>\n{"".join(elements[:-3])}</PointData>\n'
        f"<Points>\n{elements[-3]}</Points>\n<Polys>\n{elements[-2]}{elements[-1]}</Polys>\n"
        '</Piece>\n</PolyData>\n<AppendedData encoding="raw">\n_'
    ).encode()
    for array in arrays:
        yield np.array(array.nbytes, dtype="<u8").tobytes()
        data = array.reshape(-1).view(np.uint8)
        for begin in range(0, len(data), _BLOCK_BYTES):
            yield data[begin : begin + _BLOCK_BYTES].tobytes()
    yield b"\n</AppendedData>\n</VTKFile>\n"


def _element(array: NDArray, name: str, offset: int) -> str:
    width = 1 if array.ndim == 1 else array.shape[1]
    limits = ""
    if name == "Points" and len(array):  # a file that is damaged later does not fit to them
        with np.errstate(over="ignore"):
            lengths = np.linalg.norm(array, axis=1)
        if np.isfinite(lengths).all():
            limits = f'RangeMin="{float(lengths.min())!r}" RangeMax="{float(lengths.max())!r}" '
    return (
        f'<DataArray type="{_TYPES[array.dtype.str[1:]]}" Name={quoteattr(name)} NumberOfComponents="{width}" {limits}'
        f'format="appended" offset="{offset}"/>\n'
    )


def _stored(name: str, values: NDArray) -> NDArray:
    """Return an attribute in a type that VTK knows, little-endian."""
    if values.dtype.kind == "b":
        values = values.astype("u1")
    if values.dtype == np.float16:
        values = values.astype("<f4")
    if values.dtype.kind not in "iuf" or values.dtype.itemsize > 8:
        raise FormatError(
            f"the vertex attribute '{name}' has the type {values.dtype}, which VTP cannot hold", "Save as OBJ without it."
        )
    if not name.isprintable() or not name.strip():
        raise FormatError(f"the vertex attribute '{name!r}' has a name that VTP cannot hold", "Rename the attribute.")
    return np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
