"""Plain readers of the formats that hold nothing but one mesh: OBJ, STL, OFF and PLY."""

from __future__ import annotations

import io
import re
import struct

from tests.soak.plain_readers.values import Point, Polygons, lines_of, number_of, point_of, text_of, welded

_CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d"}
_CODES |= {"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f"}
_CODES |= {"float64": "d", "int64": "q", "uint64": "Q"}


def read_obj(text: str) -> Polygons:
    points: list[Point] = []
    polygons: list[list[int]] = []
    # A remark ends its line, also when a backslash closes it.
    bare = "\n".join(re.sub(r"(?<!\S)#.*", "", line) for line in lines_of(text))
    for line in bare.replace("\\\n", " ").split("\n"):
        words = line.split()
        if words[:1] == ["v"]:
            points.append(point_of([number_of(word) for word in words[1:4]]))
        elif words[:1] in (["f"], ["fo"]):
            corners = [int(word.split("/")[0]) for word in words[1:]]
            polygons.append([corner - 1 if corner > 0 else len(points) + corner for corner in corners])
    return points, polygons


def read_text_stl(text: str) -> Polygons:
    corners: list[Point] = []
    words: list[str] = []
    for line in lines_of(text):
        if line.split()[:1] and line.split()[0].lower() in ("solid", "endsolid"):
            continue
        words += line.lower().split()
    for index, word in enumerate(words):
        if word == "vertex":
            corners.append(point_of([number_of(value) for value in words[index + 1 : index + 4]]))
    if len(corners) % 3 or words.count("facet") * 3 != len(corners):
        raise ValueError("not whole triangles")
    return welded(corners, [[i, i + 1, i + 2] for i in range(0, len(corners), 3)])


def read_binary_stl(content: bytes, facets: int) -> Polygons:
    corners: list[Point] = []
    for facet in range(facets):
        values = struct.unpack_from("<9f", content, 84 + 50 * facet + 12)
        corners += [point_of(list(values[k : k + 3])) for k in (0, 3, 6)]
    return welded(corners, [[i, i + 1, i + 2] for i in range(0, len(corners), 3)])


def read_off(text: str) -> Polygons:
    """Rows of vertices may be wrapped in any way; each face begins a line, and its colour ends one."""
    rows = [row for row in (re.sub(r"(?<!\S)#.*", "", line).split() for line in lines_of(text)) if row]
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
        values = [number_of(word) for word in flat[head + width * vertex : head + width * (vertex + 1)]]
        points.append(point_of([value / values[3] for value in values[:3]] if "4" in keyword else values[:3]))
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
    value = number_of(word)
    if value != int(value):
        raise ValueError(word)
    return int(value)


def read_binary_off(content: bytes) -> Polygons:
    line_end = content.index(b"\n", content.index(b"BINARY")) + 1
    keyword = content[:line_end].decode("latin-1").rsplit("BINARY", 1)[0].split()[-1]
    n_vertices, n_faces, _ = struct.unpack_from(">3i", content, line_end)
    width = 3 + ("4" in keyword) + 3 * ("N" in keyword) + 4 * ("C" in keyword) + 2 * ("ST" in keyword)
    position = line_end + 12
    points = []
    for _ in range(n_vertices):
        values = list(struct.unpack_from(f">{width}f", content, position))
        points.append(point_of([v / values[3] for v in values[:3]] if "4" in keyword else values[:3]))
        position += 4 * width
    polygons = []
    for _ in range(n_faces):
        (size,) = struct.unpack_from(">i", content, position)
        polygons.append(list(struct.unpack_from(f">{size}i", content, position + 4)))
        (colours,) = struct.unpack_from(">i", content, position + 4 + 4 * size)
        position += 8 + 4 * size + 4 * colours
    return points, polygons


def read_ply(content: bytes) -> Polygons:
    text = text_of(content)
    end = re.search(r"(?:^|[\r\n])[ \t]*end_header[ \t]*(\r\n|\r|\n|$)", text)
    assert end is not None
    elements: list[tuple[str, int, list[list[str]]]] = []
    kind = ""
    for line in lines_of(text[: end.end()]):
        words = line.split()
        if words[:1] == ["format"]:
            kind = words[1]
        elif words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    if kind == "ascii":
        rows = iter([line.split() for line in lines_of(text[end.end() :]) if line.split()])
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
                points.append(point_of([found["x"], found["y"], found["z"]]))
            elif name == "face":
                polygons.append([int(value) for value in found.get("vertex_indices", found.get("vertex_index"))])
            elif name == "tristrips":
                raise ValueError("no opinion about strips")
    return points, polygons
