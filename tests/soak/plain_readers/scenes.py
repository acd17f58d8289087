"""Plain readers of the formats that place several meshes in a scene: glTF and 3MF."""

from __future__ import annotations

import base64
import io
import json
import math
import struct
import zipfile
from typing import Any
from xml.etree import ElementTree

from tests.soak.plain_readers.values import Point, Polygons, number_of, point_of, welded


def glb_parts(content: bytes) -> tuple[dict[str, Any], bytes]:
    length = struct.unpack_from("<I", content, 12)[0]
    return json.loads(content[20 : 20 + length].decode().rstrip("\0 ")), content[28 + length :]


def read_gltf(document: dict[str, Any], binary: bytes) -> Polygons:
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
                corners.extend(point_of(values) for values in placed)
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
    return welded(corners, polygons)


def read_threemf(content: bytes) -> Polygons:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        root = ElementTree.fromstring(archive.read("3D/3dmodel.model"))
    space = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    objects = {item.get("id"): item for item in root.iterfind(f"{space}resources/{space}object")}
    points: list[Point] = []
    polygons: list[list[int]] = []

    def transform(item: ElementTree.Element) -> list[list[float]]:
        text = item.get("transform")
        values = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0] if text is None else [number_of(word) for word in text.split()]
        return [[*values[3 * i : 3 * i + 3], 1.0 if i == 3 else 0.0] for i in range(4)]

    def add(number: str | None, places: list[list[list[float]]]) -> None:
        item, first = objects[number], len(points)
        for vertex in item.iterfind(f"{space}mesh/{space}vertices/{space}vertex"):
            p = [number_of((vertex.get(axis) or "").strip()) for axis in "xyz"]
            for m in places:
                p = [p[0] * m[0][i] + p[1] * m[1][i] + p[2] * m[2][i] + m[3][i] for i in range(3)]
            points.append(point_of(p))
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
