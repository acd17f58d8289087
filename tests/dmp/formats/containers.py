"""Writing small GLB, glTF, 3MF, VTP, VTK and binary OFF files by hand; there are no writers of these formats to test."""

from __future__ import annotations

import base64
import io
import json
import struct
import zipfile
import zlib
from typing import Any

import numpy as np

CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
THREEMF = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" Target="/3D/3dmodel.model"/></Relationships>'
)


_CONTENT_TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)


class Gltf:
    """Collects what a glTF file holds; every accessor gets a view of its own."""

    def __init__(self) -> None:
        self.binary = b""
        self.document: dict[str, Any] = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "meshes": []}

    def view(self, data: bytes, **more: Any) -> int:
        """Add bytes and return the number of their view."""
        self.binary += bytes(-len(self.binary) % 4)
        self.document["bufferViews"].append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **more})
        self.binary += data
        return len(self.document["bufferViews"]) - 1

    def accessor(self, values: Any, code: str, *, limits: bool = False, **more: Any) -> int:
        """Add numbers, (n,) or (n, k), and return the number of their accessor."""
        array = np.asarray(values, dtype=np.dtype(code).newbyteorder("<"))
        entry = {
            "bufferView": self.view(array.tobytes()),
            "componentType": CODES[code],
            "count": len(array),
            "type": KINDS[1 if array.ndim == 1 else array.shape[1]],
            **more,
        }
        if limits:
            entry |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self.document["accessors"].append(entry)
        return len(self.document["accessors"]) - 1

    def mesh(self, *primitives: dict[str, Any]) -> int:
        """Add a mesh and return its number."""
        self.document["meshes"].append({"primitives": list(primitives)})
        return len(self.document["meshes"]) - 1

    def scene(self, *nodes: dict[str, Any], roots: list[int] | None = None) -> Gltf:
        """Add nodes and the scene that shows them."""
        self.document |= {"nodes": list(nodes), "scenes": [{"nodes": roots or list(range(len(nodes)))}], "scene": 0}
        return self

    def glb(self) -> bytes:
        """Return a GLB file."""
        return pack_glb({**self.document, "buffers": [{"byteLength": len(self.binary)}]}, self.binary)

    def text(self) -> bytes:
        """Return a .gltf file with its data as base64."""
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.binary).decode()
        return json.dumps({**self.document, "buffers": [{"byteLength": len(self.binary), "uri": uri}]}, indent=1).encode()


def pack_glb(document: dict[str, Any] | bytes, binary: bytes | None) -> bytes:
    """Return the chunks of a GLB file with the right lengths."""
    text = document if isinstance(document, bytes) else json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary is not None:
        binary += bytes(-len(binary) % 4)
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def simple_gltf(vertices: Any, faces: Any, code: str = "u4") -> Gltf:
    """Return a file of one mesh."""
    file = Gltf()
    position = file.accessor(vertices, "f4", limits=True)
    mesh = file.mesh({"attributes": {"POSITION": position}, "indices": file.accessor(np.asarray(faces).ravel(), code)})
    return file.scene({"mesh": mesh})


def object_xml(number: int, vertices: Any, faces: Any, attributes: str = "") -> str:
    """Return a 3MF object with a mesh."""
    points = "".join('<vertex x="{!r}" y="{!r}" z="{!r}"/>\n'.format(*row) for row in np.asarray(vertices, float).tolist())
    triangles = "".join('<triangle v1="{}" v2="{}" v3="{}"/>\n'.format(*row) for row in np.asarray(faces).tolist())
    return (
        f'<object id="{number}" type="model" {attributes}><mesh>\n<vertices>\n{points}</vertices>\n'
        f"<triangles>\n{triangles}</triangles>\n</mesh></object>\n"
    )


def model_xml(resources: str, build: str = '<item objectid="1"/>', attributes: str = 'unit="millimeter"') -> str:
    """Return a 3MF model part."""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<model xmlns="{THREEMF}" {attributes}>\n'
        f"<resources>\n{resources}</resources>\n"
        f"<build>{build}</build>\n</model>\n"
    )


def pack_zip(parts: dict[str, bytes | str], *, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Return a ZIP archive, the same bytes each time."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, content in parts.items():
            info = zipfile.ZipInfo(name)
            info.compress_type = method
            archive.writestr(info, content)
    return file.getvalue()


def pack_3mf(model: str | bytes, more: dict[str, bytes | str] | None = None, relations: str = RELATIONS) -> bytes:
    """Return a 3MF file."""
    return pack_zip(
        {"[Content_Types].xml": _CONTENT_TYPES, "_rels/.rels": relations, "3D/3dmodel.model": model, **(more or {})}
    )


class Vtp:
    """Collects the arrays of a VTP file in one of the ways that VTK stores them."""

    def __init__(
        self, layout: str = "ascii", *, order: str = "<", word: str = "u4", packed: bool = False, block: int = 256
    ) -> None:
        self.layout, self.order, self.word, self.packed, self.block = layout, order, word, packed, block
        self.appended = b""

    def words(self, *numbers: int) -> bytes:
        """Return numbers of a header."""
        return np.array(numbers, dtype=self.order + self.word).tobytes()

    def stored(self, data: bytes) -> tuple[bytes, bytes]:
        """Return the header and the data, packed if asked."""
        if not self.packed:
            return self.words(len(data)), data
        blocks = [data[start : start + self.block] for start in range(0, len(data), self.block)]
        packed = [zlib.compress(block) for block in blocks]
        last = len(blocks[-1]) % self.block if blocks else 0
        return self.words(len(blocks), self.block, last, *(len(block) for block in packed)), b"".join(packed)

    def array(self, values: Any, kind: str, name: str = "", **attributes: Any) -> str:
        """Return the element of an array."""
        array = np.asarray(values)
        more = "".join(f' {key}="{value}"' for key, value in attributes.items())
        width = 1 if array.ndim == 1 else array.shape[1]
        start = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}"{more}'
        if self.layout == "ascii":
            return f'{start} format="ascii">\n{" ".join(map(repr, array.ravel().tolist()))}\n</DataArray>\n'
        code = kind.replace("UInt", "u").replace("Int", "i").replace("Float", "f")
        data = array.astype(f"{self.order}{code[0]}{int(code[1:]) // 8}").tobytes()
        header, content = self.stored(data)
        if self.layout == "binary":
            parts = [header, content] if self.packed else [header + content]
            return f'{start} format="binary">\n{"".join(base64.b64encode(part).decode() for part in parts)}\n</DataArray>\n'
        offset = len(self.appended)
        parts = [header, content] if self.packed else [header + content]
        self.appended += b"".join(parts if self.layout == "raw" else [base64.b64encode(part) for part in parts])
        return f'{start} format="appended" offset="{offset}"/>\n'

    def cells(self, section: str, cells: Any) -> str:
        """Return a section of cells."""
        corners = [corner for cell in cells for corner in cell]
        ends = np.cumsum([len(cell) for cell in cells]) if len(cells) else np.zeros(0, dtype=int)
        arrays = self.array(corners, "Int64", "connectivity") + self.array(ends, "Int32", "offsets")
        return f"<{section}>\n{arrays}</{section}>\n"

    def piece(
        self, points: Any, polygons: Any, strips: Any = (), lines: Any = (), data: str = "", kind: str = "Float64"
    ) -> str:
        """Return a piece."""
        values = np.asarray(points, dtype=float).reshape(-1, 3)
        content = f"<PointData>\n{data}</PointData>\n<Points>\n{self.array(values, kind, 'Points')}</Points>\n"
        content += self.cells("Lines", lines) + self.cells("Strips", strips) + self.cells("Polys", polygons)
        return (
            f'<Piece NumberOfPoints="{len(values)}" NumberOfVerts="0" NumberOfLines="{len(lines)}" '
            f'NumberOfStrips="{len(strips)}" NumberOfPolys="{len(polygons)}">\n{content}</Piece>\n'
        )

    def file(self, *pieces: str, kind: str = "PolyData") -> bytes:
        """Return the whole file."""
        order = "LittleEndian" if self.order == "<" else "BigEndian"
        header = {"u4": "UInt32", "u8": "UInt64"}[self.word]
        packed = ' compressor="vtkZLibDataCompressor"' if self.packed else ""
        text = (
            f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" byte_order="{order}" '
            f'header_type="{header}"{packed}>\n'
            f"<{kind}>\n{''.join(pieces)}</{kind}>\n"
        ).encode()
        if self.layout in ("raw", "base64"):
            text += f'<AppendedData encoding="{self.layout}">\n_'.encode() + self.appended + b"\n</AppendedData>\n"
        return text + b"</VTKFile>\n"


def vtk_file(
    points: Any, polygons: Any, *, binary: bool = False, version: int = 3, strips: Any = (), tail: bytes = b""
) -> bytes:
    """Return a legacy VTK file."""
    values = np.asarray(points, dtype=float).reshape(-1, 3)
    out = f"# vtk DataFile Version {version}.0\nmade by hand\n{'BINARY' if binary else 'ASCII'}\nDATASET POLYDATA\n".encode()

    def numbers(array: Any, code: str) -> bytes:
        data = np.asarray(array)
        if binary:
            return data.astype(">" + code).tobytes() + b"\n"
        return b" ".join(repr(number).encode() for number in data.ravel().tolist()) + b"\n"

    out += f"POINTS {len(values)} double\n".encode() + numbers(values, "f8")
    for keyword, cells in (("POLYGONS", polygons), ("TRIANGLE_STRIPS", strips)):
        if not len(cells):
            continue
        corners = [corner for cell in cells for corner in cell]
        if version >= 5:
            offsets = np.cumsum([0, *(len(cell) for cell in cells)])
            out += f"{keyword} {len(offsets)} {len(corners)}\nOFFSETS vtktypeint64\n".encode() + numbers(offsets, "i8")
            out += b"CONNECTIVITY vtktypeint64\n" + numbers(corners, "i8")
        else:
            flat = [number for cell in cells for number in (len(cell), *cell)]
            out += f"{keyword} {len(cells)} {len(flat)}\n".encode()
            if binary:
                out += numbers(flat, "i4")
            else:
                out += b"".join(b" ".join(str(n).encode() for n in (len(cell), *cell)) + b"\n" for cell in cells)
    return out + tail


def binary_off(vertices: Any, faces: Any, keyword: str = "OFF", more: Any = None, colours: Any = ()) -> bytes:
    """Return a binary OFF file; ``more`` are further values of the vertices, ``colours`` those of the first faces."""
    table = np.asarray(vertices, dtype=float)
    table = table if more is None else np.concatenate([table, np.asarray(more, dtype=float)], axis=1)
    out = f"{keyword} BINARY\n".encode() + struct.pack(">3i", len(table), len(faces), 0) + table.astype(">f4").tobytes()
    for index, face in enumerate(faces):
        colour = colours[index] if index < len(colours) else ()
        out += struct.pack(f">{2 + len(face)}i{len(colour)}f", len(face), *face, len(colour), *colour)
    return out
