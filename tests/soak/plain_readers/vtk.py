"""Plain readers of the formats of VTK, the old one and the one in XML."""

from __future__ import annotations

import base64
import io
import re
import struct
import zlib
from collections.abc import Iterator
from itertools import pairwise
from xml.etree import ElementTree

from tests.soak.plain_readers.values import Point, Polygons, faces_of, lines_of, number_of, point_of, text_of


def read_vtp(content: bytes) -> Polygons:
    appended = b""
    match = re.search(rb"<AppendedData[^>]*>", content)
    encoding = ""
    if match:
        tail = content.rindex(b"</AppendedData>")
        start = content.index(b"_", match.end())
        appended, content = content[start + 1 : tail], content[: match.end()] + content[tail:]
        encoding = "raw" if b"raw" in match[0] else "base64"
    root = ElementTree.fromstring(content)
    order = "<" if root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
    word = "I" if root.get("header_type", "UInt32") == "UInt32" else "Q"
    size = struct.calcsize("<" + word)

    def decoded(text: bytes) -> bytes:
        return b"".join(base64.b64decode(part) for part in re.findall(rb"[A-Za-z0-9+/]+=*", b"".join(text.split())))

    def numbers(array: ElementTree.Element) -> list[float]:
        kind = array.get("type", "")
        code = {"Int8": "b", "UInt8": "B", "Int16": "h", "UInt16": "H", "Int32": "i", "UInt32": "I", "Int64": "q"}
        code |= {"UInt64": "Q", "Float32": "f", "Float64": "d"}
        if array.get("format", "ascii") == "ascii":
            words = (array.text or "").split()
            return [number_of(text) if "Float" in kind else int(text) for text in words]
        if array.get("format") == "binary":
            data = decoded((array.text or "").encode())
        else:
            data = appended[int(array.get("offset", "0")) :]
            data = decoded(data) if encoding == "base64" else data
        if root.get("compressor"):
            count, _, _ = struct.unpack_from(f"{order}3{word}", data)
            sizes = struct.unpack_from(f"{order}{count}{word}", data, 3 * size)
            at, parts = (3 + count) * size, []
            for packed in sizes:
                parts.append(zlib.decompress(data[at : at + packed]))
                at += packed
            data = b"".join(parts)
        else:
            data = data[size : size + struct.unpack_from(order + word, data)[0]]
        return list(struct.unpack(f"{order}{len(data) // struct.calcsize(code[kind])}{code[kind]}", data))

    points: list[Point] = []
    polygons: list[list[int]] = []
    for piece in root.iterfind("PolyData/Piece"):
        first = len(points)
        n = int(piece.get("NumberOfPoints", "0"))
        values = numbers(_only(piece.findall("Points/DataArray"))) if n else []
        assert len(values) == 3 * n
        points += [point_of(values[i : i + 3]) for i in range(0, len(values), 3)]
        for section in ("Polys", "Strips"):
            cells = int(piece.get(f"NumberOf{section}", "0"))
            if not cells:
                continue
            arrays = {array.get("Name"): array for array in piece.iterfind(f"{section}/DataArray")}
            corners, ends = ([int(value) for value in numbers(arrays[name])] for name in ("connectivity", "offsets"))
            assert len(ends) == cells
            for begin, end in zip([0, *ends], ends, strict=False):
                polygons += faces_of([first + corner for corner in corners[begin:end]], strip=section == "Strips")
    return points, polygons


def _only(found: list[ElementTree.Element]) -> ElementTree.Element:
    if len(found) != 1:
        raise ValueError(len(found))
    return found[0]


def read_vtk(content: bytes) -> Polygons:
    if b"BINARY" not in content.split(b"\n", 3)[2].upper():
        content = "\n".join(lines_of(text_of(content))).encode("latin-1", errors="replace")
    _, _, mode, rest = content.split(b"\n", 3)
    binary = mode.strip().upper() == b"BINARY"
    stream = io.BytesIO(rest)
    types = {"float": "f", "double": "d", "int": "i", "vtktypeint64": "q", "long": "q", "vtkidtype": "i"}

    def words() -> Iterator[str]:
        while line := stream.readline():
            yield from line.decode("latin-1").split()

    def take(n: int, code: str) -> list[float]:
        if binary:
            return list(struct.unpack(f">{n}{code}", stream.read(n * struct.calcsize(code))))
        found: list[str] = []
        while len(found) < n:
            line = stream.readline()
            if not line:
                raise EOFError
            found += line.decode("latin-1").split()
        if len(found) != n:
            raise ValueError("a number too many")
        return [number_of(word) if code in "fd" else int(word) for word in found]

    points: list[Point] = []
    polygons: dict[str, list[list[int]]] = {"POLYGONS": [], "TRIANGLE_STRIPS": []}
    while raw := stream.readline():
        line = raw.decode("latin-1").replace("\0", " ").split()
        if not line or line[0].upper() == "DATASET":
            continue
        keyword = line[0].upper()
        if keyword == "POINTS":
            values = take(3 * int(line[1]), types[line[2].lower()])
            points = [point_of(values[i : i + 3]) for i in range(0, len(values), 3)]
        elif keyword in ("POLYGONS", "TRIANGLE_STRIPS", "VERTICES", "LINES"):
            here = stream.tell()
            following = next(words(), "")
            if following.upper() == "OFFSETS":
                stream.seek(here)
                kinds = stream.readline().split()
                ends = [int(value) for value in take(int(line[1]), types[kinds[1].decode().lower()])]
                kinds = []
                while not kinds:
                    kinds = stream.readline().split()
                assert kinds[0].upper() == b"CONNECTIVITY"
                corners = [int(value) for value in take(int(line[2]), types[kinds[1].decode().lower()])]
                cells = [corners[begin:end] for begin, end in pairwise(ends)]
            else:
                stream.seek(here)
                flat = [int(value) for value in take(int(line[2]), "i")]
                cells, at = [], 0
                for _ in range(int(line[1])):
                    cells.append(flat[at + 1 : at + 1 + flat[at]])
                    at += 1 + flat[at]
                assert at == len(flat)
            if keyword in polygons:
                polygons[keyword] = [face for cell in cells for face in faces_of(cell, strip=keyword == "TRIANGLE_STRIPS")]
        elif keyword in ("POINT_DATA", "CELL_DATA"):
            break
        else:
            raise ValueError(keyword)
    return points, polygons["POLYGONS"] + polygons["TRIANGLE_STRIPS"]
