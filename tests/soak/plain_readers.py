"""Readers written for nothing but comparison: a few plain lines for each format, by the book, one value at a time.

They share no code with the readers under test, take no care of speed or size, and may raise anything: an exception
means that they have no opinion. What they return is what the bytes of a file say.
"""

from __future__ import annotations

import base64
import io
import json
import math
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

Point = tuple[float, float, float]
Polygons = tuple[list[Point], list[list[int]]]

_CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d"}
_CODES |= {"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f"}
_CODES |= {"float64": "d", "int64": "q", "uint64": "Q"}


def read_plainly(content: bytes) -> Polygons:
    """Return the positions and polygons of a file of any format; corners count from 0."""
    if content.startswith(b"glTF"):
        return _gltf(*_glb_parts(content))
    if content.startswith(b"PK"):
        return _threemf(content)
    facets = struct.unpack_from("<I", content, 80)[0] if len(content) >= 84 else 0
    if facets and len(content) == 84 + 50 * facets:
        return _binary_stl(content, facets)
    head = _text(content).lstrip()
    if head.startswith("ply"):
        return _ply(content)
    if head.startswith("# vtk"):
        return _vtk(content)
    if "<VTKFile" in head[:3000]:
        return _vtp(content)
    if head.startswith("{"):
        return _gltf(json.loads(head.lstrip("\ufeff")), b"")
    if head[:5].lower() == "solid" and "facet" in head.lower():
        return _text_stl(_text(content))
    first = next((line for line in head.splitlines() if line.strip() and not line.strip().startswith("#")), "").split()
    if first and re.fullmatch(r"(ST|C|N|4)*n?OFF|(st|c|n|4)*off", first[0]):
        return _binary_off(content) if first[1:2] == ["BINARY"] else _off(head)
    if first and re.fullmatch(r"[\d.+-].*", first[0]):
        return _off("OFF\n" + head)
    if facets and b"\0" in content and len(content) > 84 + 50 * facets:
        return _binary_stl(content, facets)
    return _obj(_text(content))


def _text(content: bytes) -> str:
    if content.startswith((b"\xff\xfe\0\0", b"\0\0\xfe\xff")):
        return content.decode("utf-32", errors="replace")
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    return content.removeprefix(b"\xef\xbb\xbf").decode("latin-1")


def _lines(text: str) -> list[str]:
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _number(word: str) -> float:
    if not re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", word):
        raise ValueError(word)
    return float(word)


def _point(values: list[float]) -> Point:
    if not all(map(math.isfinite, values)):
        raise ValueError(values)
    return values[0], values[1], values[2]


def _welded(corners: list[Point], polygons: list[list[int]]) -> Polygons:
    """Join equal points in the order of their first appearance."""
    numbers: dict[Point, int] = {}
    new = [numbers.setdefault((x + 0.0, y + 0.0, z + 0.0), len(numbers)) for x, y, z in corners]
    return list(numbers), [[new[corner] for corner in polygon] for polygon in polygons]


def _obj(text: str) -> Polygons:
    points: list[Point] = []
    polygons: list[list[int]] = []
    # A remark ends its line, also when a backslash closes it.
    bare = "\n".join(re.sub(r"(?<!\S)#.*", "", line) for line in _lines(text))
    for line in bare.replace("\\\n", " ").split("\n"):
        words = line.split()
        if words[:1] == ["v"]:
            points.append(_point([_number(word) for word in words[1:4]]))
        elif words[:1] in (["f"], ["fo"]):
            corners = [int(word.split("/")[0]) for word in words[1:]]
            polygons.append([corner - 1 if corner > 0 else len(points) + corner for corner in corners])
    return points, polygons


def _text_stl(text: str) -> Polygons:
    corners: list[Point] = []
    words: list[str] = []
    for line in _lines(text):
        if line.split()[:1] and line.split()[0].lower() in ("solid", "endsolid"):
            continue
        words += line.lower().split()
    for index, word in enumerate(words):
        if word == "vertex":
            corners.append(_point([_number(value) for value in words[index + 1 : index + 4]]))
    if len(corners) % 3 or words.count("facet") * 3 != len(corners):
        raise ValueError("not whole triangles")
    return _welded(corners, [[i, i + 1, i + 2] for i in range(0, len(corners), 3)])


def _binary_stl(content: bytes, facets: int) -> Polygons:
    corners: list[Point] = []
    for facet in range(facets):
        values = struct.unpack_from("<9f", content, 84 + 50 * facet + 12)
        corners += [_point(list(values[k : k + 3])) for k in (0, 3, 6)]
    return _welded(corners, [[i, i + 1, i + 2] for i in range(0, len(corners), 3)])


def _off(text: str) -> Polygons:
    """Rows of vertices may be wrapped in any way; each face begins a line, and its colour ends one."""
    rows = [row for row in (re.sub(r"(?<!\S)#.*", "", line).split() for line in _lines(text)) if row]
    keyword = rows[0].pop(0).upper()
    rows = [row for row in rows if row]
    if re.search(r"^n|[^C]nOFF|^nOFF", keyword) or rows[0] == ["3"]:
        raise ValueError("no opinion about nOFF")
    flat = [word for row in rows for word in row]
    head = 2 if len(rows[0]) == 2 else 3
    n_vertices, n_faces = int(flat[0]), int(flat[1])
    lengths = [len(row) for row in rows[1 : 1 + n_vertices]]
    width = 3 + ("4" in keyword) + 3 * ("N" in keyword) + 2 * ("ST" in keyword)
    if "C" in keyword:
        width = max(set(lengths), key=lengths.count)
    elif len(set(lengths)) == 1 and head == len(rows[0]) and lengths[0] - width in (3, 4):
        width = lengths[0]
    points = []
    for vertex in range(n_vertices):
        values = [_number(word) for word in flat[head + width * vertex : head + width * (vertex + 1)]]
        points.append(_point([value / values[3] for value in values[:3]] if "4" in keyword else values[:3]))
    taken = head + width * n_vertices
    while taken > 0:
        taken -= len(rows.pop(0))
    if taken:
        raise ValueError("the last vertex does not end its line")
    polygons = []
    for _ in range(n_faces):
        face = rows.pop(0)
        size = _index(face[0])
        while len(face) < 1 + size:
            face = face + rows.pop(0)
        if len(face) - 1 - size not in (0, 1, 3, 4):
            raise ValueError("no colour")
        polygons.append([_index(word) for word in face[1 : 1 + size]])
    if rows:
        raise ValueError("more faces")
    return points, polygons


def _index(word: str) -> int:
    value = _number(word)
    if value != int(value):
        raise ValueError(word)
    return int(value)


def _binary_off(content: bytes) -> Polygons:
    line_end = content.index(b"\n", content.index(b"BINARY")) + 1
    keyword = content[:line_end].decode("latin-1").rsplit("BINARY", 1)[0].split()[-1]
    n_vertices, n_faces, _ = struct.unpack_from(">3i", content, line_end)
    width = 3 + ("4" in keyword) + 3 * ("N" in keyword) + 4 * ("C" in keyword) + 2 * ("ST" in keyword)
    position = line_end + 12
    points = []
    for _ in range(n_vertices):
        values = list(struct.unpack_from(f">{width}f", content, position))
        points.append(_point([v / values[3] for v in values[:3]] if "4" in keyword else values[:3]))
        position += 4 * width
    polygons = []
    for _ in range(n_faces):
        (size,) = struct.unpack_from(">i", content, position)
        polygons.append(list(struct.unpack_from(f">{size}i", content, position + 4)))
        (colours,) = struct.unpack_from(">i", content, position + 4 + 4 * size)
        position += 8 + 4 * size + 4 * colours
    return points, polygons


def _ply(content: bytes) -> Polygons:
    text = _text(content)
    end = re.search(r"(?:^|[\r\n])[ \t]*end_header[ \t]*(\r\n|\r|\n|$)", text)
    assert end is not None
    elements: list[tuple[str, int, list[list[str]]]] = []
    kind = ""
    for line in _lines(text[: end.end()]):
        words = line.split()
        if words[:1] == ["format"]:
            kind = words[1]
        elif words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    if kind == "ascii":
        rows = iter([line.split() for line in _lines(text[end.end() :]) if line.split()])
        values = (iter(row) for row in rows)
        read = lambda row, code: float(next(row))  # noqa: E731
    else:
        if "\r" in text[: end.end()]:
            raise ValueError("no opinion about carriage returns before bytes")
        mark = 3 if content.startswith(b"\xef\xbb\xbf") else 0
        stream = io.BytesIO(content[mark + end.end() :])
        order = "<" if kind == "binary_little_endian" else ">"
        values = iter(lambda: stream, None)
        read = lambda row, code: struct.unpack(order + code, row.read(struct.calcsize(code)))[0]  # noqa: E731
    points: list[Point] = []
    polygons: list[list[int]] = []
    for name, count, properties in elements:
        for _ in range(count if properties else 0):
            row, found = next(values), {}
            for item in properties:
                if item[0] == "list":
                    size = int(read(row, _CODES[item[1]]))
                    found[item[3]] = [read(row, _CODES[item[2]]) for _ in range(size)]
                else:
                    found[item[1]] = read(row, _CODES[item[0]])
            if name == "vertex":
                points.append(_point([found["x"], found["y"], found["z"]]))
            elif name == "face":
                polygons.append([int(value) for value in found.get("vertex_indices", found.get("vertex_index"))])
            elif name == "tristrips":
                raise ValueError("no opinion about strips")
    return points, polygons


def _glb_parts(content: bytes) -> tuple[dict[str, Any], bytes]:
    length = struct.unpack_from("<I", content, 12)[0]
    return json.loads(content[20 : 20 + length].decode().rstrip("\0 ")), content[28 + length :]


def _gltf(document: dict[str, Any], binary: bytes) -> Polygons:
    corners: list[Point] = []
    polygons: list[list[int]] = []

    def buffer(index: int) -> bytes:
        uri = document["buffers"][index].get("uri")
        data = binary if uri is None else base64.b64decode(uri.partition(",")[2])
        return data[: document["buffers"][index]["byteLength"]]

    def items(source: dict[str, Any], count: int, code: str, width: int) -> list[list[float]]:
        view = document["bufferViews"][source["bufferView"]]
        start = view.get("byteOffset", 0)
        data = buffer(view["buffer"])[start : start + view["byteLength"]]
        size = struct.calcsize("<" + code * width)
        stride = view.get("byteStride", size)
        return [
            list(struct.unpack_from("<" + code * width, data, source.get("byteOffset", 0) + stride * i)) for i in range(count)
        ]

    def accessor(index: int) -> list[list[float]]:
        entry = document["accessors"][index]
        code = {5120: "b", 5121: "B", 5122: "h", 5123: "H", 5125: "I", 5126: "f"}[entry["componentType"]]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[entry["type"]]
        values = items(entry, entry["count"], code, width) if "bufferView" in entry else [[0.0] * width] * entry["count"]
        if "sparse" in entry:
            sparse = entry["sparse"]
            small = {5121: "B", 5123: "H", 5125: "I"}[sparse["indices"]["componentType"]]
            rows = items(sparse["indices"], sparse["count"], small, 1)
            for row, value in zip(rows, items(sparse["values"], sparse["count"], code, width), strict=True):
                values[int(row[0])] = value
        if entry.get("normalized") and code != "f":
            raise ValueError("no opinion about normalised positions")
        return values

    def place(node: dict[str, Any]) -> list[list[float]]:
        if "matrix" in node:
            m = node["matrix"]
            return [[m[4 * column + row] for column in range(4)] for row in range(4)]
        x, y, z, w = node.get("rotation", [0, 0, 0, 1])
        n = math.sqrt(x * x + y * y + z * z + w * w)
        x, y, z, w = x / n, y / n, z / n, w / n
        s, t = node.get("scale", [1, 1, 1]), node.get("translation", [0, 0, 0])
        r = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        return [[r[i][j] * s[j] for j in range(3)] + [t[i]] for i in range(3)] + [[0, 0, 0, 1]]

    def times(a: list[list[float]], b: list[list[float]]) -> list[list[float]]:
        return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]

    def add(mesh: int, m: list[list[float]]) -> None:
        det = sum(m[0][i] * (m[1][(i + 1) % 3] * m[2][(i + 2) % 3] - m[1][(i + 2) % 3] * m[2][(i + 1) % 3]) for i in range(3))
        first_of: dict[tuple[int, int], int] = {}
        for primitive in document["meshes"][mesh]["primitives"]:
            mode = primitive.get("mode", 4)
            if mode < 4 or "POSITION" not in primitive["attributes"]:
                continue
            source = primitive["attributes"]["POSITION"], primitive["attributes"].get("COLOR_0", -1)
            if source not in first_of:
                first_of[source] = len(corners)
                placed = ([sum(m[i][k] * p[k] for k in range(3)) + m[i][3] for i in range(3)] for p in accessor(source[0]))
                corners.extend(_point(values) for values in placed)
            n = len(accessor(source[0]))
            indices = [int(row[0]) for row in accessor(primitive["indices"])] if "indices" in primitive else list(range(n))
            assert max(indices) < n
            if mode == 4:
                faces = [indices[i : i + 3] for i in range(0, len(indices), 3)]
            elif mode == 5:
                faces = [[indices[i + i % 2], indices[i + 1 - i % 2], indices[i + 2]] for i in range(len(indices) - 2)]
            else:
                faces = [[indices[0], indices[i], indices[i + 1]] for i in range(1, len(indices) - 1)]
            faces = [face[::-1] for face in faces] if det < 0 else faces
            polygons.extend([first_of[source] + corner for corner in face] for face in faces)

    def walk(number: int, above: list[list[float]]) -> None:
        node = document["nodes"][number]
        matrix = times(above, place(node))
        if "skin" in node or "extensions" in node:
            raise ValueError("no opinion")
        if "mesh" in node:
            add(node["mesh"], matrix)
        for child in node.get("children", []):
            walk(child, matrix)

    identity = [[float(i == j) for j in range(4)] for i in range(4)]
    if not document.get("nodes"):
        for mesh in range(len(document["meshes"])):
            add(mesh, identity)
    else:
        children = {child for node in document["nodes"] for child in node.get("children", [])}
        roots = [number for number in range(len(document["nodes"])) if number not in children]
        if document.get("scenes"):
            roots = document["scenes"][document.get("scene", 0)]["nodes"]
        for number in roots:
            walk(number, identity)
    return _welded(corners, polygons)


def _threemf(content: bytes) -> Polygons:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        root = ElementTree.fromstring(archive.read("3D/3dmodel.model"))
    space = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    objects = {item.get("id"): item for item in root.iterfind(f"{space}resources/{space}object")}
    points: list[Point] = []
    polygons: list[list[int]] = []

    def transform(item: ElementTree.Element) -> list[list[float]]:
        text = item.get("transform")
        values = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0] if text is None else [_number(word) for word in text.split()]
        return [[*values[3 * i : 3 * i + 3], 1.0 if i == 3 else 0.0] for i in range(4)]

    def add(number: str | None, places: list[list[list[float]]]) -> None:
        item, first = objects[number], len(points)
        for vertex in item.iterfind(f"{space}mesh/{space}vertices/{space}vertex"):
            p = [_number((vertex.get(axis) or "").strip()) for axis in "xyz"]
            for m in places:
                p = [p[0] * m[0][i] + p[1] * m[1][i] + p[2] * m[2][i] + m[3][i] for i in range(3)]
            points.append(_point(p))
        mirrored = False
        for m in places:
            det = sum(
                m[0][i] * (m[1][(i + 1) % 3] * m[2][(i + 2) % 3] - m[1][(i + 2) % 3] * m[2][(i + 1) % 3]) for i in range(3)
            )
            mirrored ^= det < 0
        for triangle in item.iterfind(f"{space}mesh/{space}triangles/{space}triangle"):
            corners = [first + int(triangle.get(f"v{k}") or "") for k in (1, 2, 3)]
            polygons.append(corners[::-1] if mirrored else corners)
        for component in item.iterfind(f"{space}components/{space}component"):
            add(component.get("objectid"), [transform(component), *places])

    items = list(root.iterfind(f"{space}build/{space}item"))
    for item in items:
        add(item.get("objectid"), [transform(item)])
    if not items:
        raise ValueError("no opinion about files that build nothing")
    return points, polygons


def _vtp(content: bytes) -> Polygons:
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
            return [_number(text) if "Float" in kind else int(text) for text in words]
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
        points += [_point(values[i : i + 3]) for i in range(0, len(values), 3)]
        for section in ("Polys", "Strips"):
            cells = int(piece.get(f"NumberOf{section}", "0"))
            if not cells:
                continue
            arrays = {array.get("Name"): array for array in piece.iterfind(f"{section}/DataArray")}
            corners, ends = ([int(value) for value in numbers(arrays[name])] for name in ("connectivity", "offsets"))
            assert len(ends) == cells
            for begin, end in zip([0, *ends], ends, strict=False):
                polygons += _faces([first + corner for corner in corners[begin:end]], strip=section == "Strips")
    return points, polygons


def _only(found: list[ElementTree.Element]) -> ElementTree.Element:
    if len(found) != 1:
        raise ValueError(len(found))
    return found[0]


def _faces(cell: list[int], *, strip: bool) -> list[list[int]]:
    if not strip:
        return [cell]
    faces = [[cell[i + i % 2], cell[i + 1 - i % 2], cell[i + 2]] for i in range(len(cell) - 2)]
    return [face for face in faces if len(set(face)) == 3]


def _vtk(content: bytes) -> Polygons:
    if b"BINARY" not in content.split(b"\n", 3)[2].upper():
        content = "\n".join(_lines(_text(content))).encode("latin-1", errors="replace")
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
        return [_number(word) if code in "fd" else int(word) for word in found]

    points: list[Point] = []
    polygons: dict[str, list[list[int]]] = {"POLYGONS": [], "TRIANGLE_STRIPS": []}
    while raw := stream.readline():
        line = raw.decode("latin-1").replace("\0", " ").split()
        if not line or line[0].upper() == "DATASET":
            continue
        keyword = line[0].upper()
        if keyword == "POINTS":
            values = take(3 * int(line[1]), types[line[2].lower()])
            points = [_point(values[i : i + 3]) for i in range(0, len(values), 3)]
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
                polygons[keyword] = [face for cell in cells for face in _faces(cell, strip=keyword == "TRIANGLE_STRIPS")]
        elif keyword in ("POINT_DATA", "CELL_DATA"):
            break
        else:
            raise ValueError(keyword)
    return points, polygons["POLYGONS"] + polygons["TRIANGLE_STRIPS"]
