"""Reading and writing PLY: the three encodings agree, attributes come back, counts are checked against the bytes."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from dmp.errors import MeshFileError
from dmp.formats.ply_writing import write_ply
from dmp.mesh import TriangleMesh
from dmp.meshio import write_mesh
from tests.dmp.formats.files import SQUARE_FACES, SQUARE_VERTICES, binary_ply, ply_header, read, refusal, square
from tests.meshes import grid_mesh

ROWS = "".join("{!r} {!r} {!r}\n".format(*vertex) for vertex in SQUARE_VERTICES)
ASCII = ply_header("ascii", 4, 2) + ROWS + "3 0 1 2\n3 0 2 3\n"

# A number whose first byte, when it is little endian, is 0x0A, as is a line feed.
LIKE_LINE_END: float = struct.unpack("<d", b"\x0a" + struct.pack("<d", 1.5)[1:])[0]


def written(mesh: TriangleMesh) -> bytes:
    return b"".join(write_ply(mesh))


@pytest.mark.parametrize(
    "content",
    [
        ASCII,
        ASCII.replace("\n", "\r\n"),
        ASCII.replace("\n", "\r"),
        ASCII.encode("utf-16"),
        "\ufeff" + ASCII,
        ASCII.replace("comment made by hand", "comment " + "x" * 100_000 + "\nobj_info y").replace(
            "vertex_indices", "vertex_index"
        ),
        ASCII.replace("comment made by hand", "comment Größe").encode("latin-1"),
        ASCII.replace("3 0 1 2", "\n  3\t0 1   2 "),
        binary_ply("<"),
        binary_ply(">"),
        binary_ply("<").replace(b"\n", b"\r\n", 10),
        binary_ply("<").replace(b"\n", b"\r", 10),
        binary_ply("<") + b"\n",
    ],
)
def test_the_same_square_in_every_spelling(tmp_path: Path, content: str | bytes) -> None:
    mesh, _ = read(tmp_path, "a.ply", content)
    assert mesh.vertices.tolist() == SQUARE_VERTICES
    assert mesh.faces.tolist() == SQUARE_FACES


def test_a_body_that_looks_like_a_line_end_after_a_carriage_return(tmp_path: Path) -> None:
    vertices = [[LIKE_LINE_END, 0.0, 0.0], *SQUARE_VERTICES[1:]]
    mesh, _ = read(tmp_path, "a.ply", binary_ply("<", vertices).replace(b"\n", b"\r", 10))
    assert mesh.vertices.tolist() == vertices


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("position_type", ["float", "double", "float32", "float64", "short", "int"])
@pytest.mark.parametrize("index_type", ["uchar", "short", "ushort", "int", "uint", "int32", "uint8", "int64", "uint64"])
def test_all_types(tmp_path: Path, order: str, position_type: str, index_type: str) -> None:
    codes = {"float": "f", "double": "d", "short": "h", "int": "i", "float32": "f", "float64": "d", "uchar": "B", "uint8": "B"}
    codes |= {"ushort": "H", "uint": "I", "int32": "i", "int64": "q", "uint64": "Q"}
    kind = "binary_little_endian" if order == "<" else "binary_big_endian"
    header = ply_header(kind, 3, 1).replace("property double", f"property {position_type}")
    header = header.replace("list uchar int", f"list ushort {index_type}")
    body = struct.pack(order + "9" + codes[position_type], 0, 0, 0, 7, 0, 0, 0, 5, -1)
    body += struct.pack(f"{order}H3{codes[index_type]}", 3, 0, 1, 2)
    mesh, _ = read(tmp_path, "a.ply", header.encode() + body)
    assert mesh.vertices.tolist() == [[0, 0, 0], [7, 0, 0], [0, 5, -1]]
    assert mesh.faces.tolist() == [[0, 1, 2]]


def test_text_positions_keep_all_digits_also_as_float(tmp_path: Path) -> None:
    mesh, _ = read(tmp_path, "a.ply", ASCII.replace("property double", "property float"))
    assert mesh.vertices.tolist() == SQUARE_VERTICES


def test_polygons_of_mixed_sizes_among_other_face_properties(tmp_path: Path) -> None:
    points = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [3, 1, 0], [1, 3, 0]]
    header = ply_header("binary_big_endian", 6, 3, face="uchar flag;list uint float weights;short last").encode()
    body = b"".join(struct.pack(">3d", *point) for point in points)
    for corners, weights in (([0, 1, 2, 3], [0.5]), ([1, 4, 2], []), ([3, 2, 5], [1.0, 2.0])):
        body += struct.pack(f">B{len(corners)}iBI{len(weights)}fh", len(corners), *corners, 1, len(weights), *weights, -1)
    binary, notes = read(tmp_path, "a.ply", header + body)
    assert binary.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2], [3, 2, 5]]
    assert notes == ("Split 1 polygon with more than three corners into 2 triangles.",)
    text = header.decode().replace("binary_big_endian", "ascii")
    text += "".join("{} {} {}\n".format(*point) for point in points)
    text += "4 0 1 2 3 1 1 0.5 -1\n3 1 4 2 1 0 -1\n3 3 2 5 1 2 1.0 2.0 -1\n"
    ascii_mesh, _ = read(tmp_path, "b.ply", text)
    np.testing.assert_array_equal(ascii_mesh.faces, binary.faces)


def test_a_large_mixed_mesh_equals_its_triangles(tmp_path: Path) -> None:
    mesh = grid_mesh(40, 0.2)
    quads = mesh.faces[: mesh.n_faces // 2].tolist()
    third = mesh.faces[mesh.n_faces // 2 :].tolist()
    rng = np.random.default_rng(0)
    faces, expected = [], []
    for (a, b, c), (_, _, d) in zip(quads, third, strict=True):
        if rng.random() < 0.5:
            faces.append([a, b, c, d])
        else:
            faces += [[a, b, c], [a, c, d]]
        expected += [[a, b, c], [a, c, d]]
    read_mesh, _ = read(tmp_path, "a.ply", binary_ply("<", mesh.vertices.tolist(), faces))
    assert read_mesh.faces.tolist() == expected


def test_lists_in_the_vertices_are_left_out(tmp_path: Path) -> None:
    header = ply_header("binary_little_endian", 3, 1, vertex="list uchar short neighbours;float quality").encode()
    body = b""
    for index, (point, n) in enumerate(zip(SQUARE_VERTICES[:3], (2, 0, 5), strict=True)):
        body += struct.pack(f"<3dB{n}hf", *point, n, *range(n), index / 2)
    mesh, notes = read(tmp_path, "a.ply", header + body + struct.pack("<B3i", 3, 0, 1, 2))
    assert mesh.vertices.tolist() == SQUARE_VERTICES[:3]
    assert mesh.vertex_attributes["quality"].tolist() == [0, 0.5, 1]
    assert notes == ("Left out the list 'neighbours' of the vertices.",)


def test_faces_before_vertices_and_further_elements(tmp_path: Path) -> None:
    text = (
        "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement camera 1\n"
        "property float view_px\nproperty float view_py\nelement empty 0\nelement bare 7\nelement vertex 3\nproperty float z\n"
        "property float y\nproperty float x\nend_header\n3 0 1 2\n0.5 0.5\n1 2 3\n4 5 6\n7 8 10\n"
    )
    mesh, notes = read(tmp_path, "a.ply", text)
    assert mesh.vertices.tolist() == [[3, 2, 1], [6, 5, 4], [10, 8, 7]]
    assert notes == ("Left out other elements of the file: 1 'camera', 7 'bare'.",)


def test_triangle_strips(tmp_path: Path) -> None:
    strip = [0, 1, 3, 2, -1, 2, 3, 3, 5, 4]
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 2, 0], [0, 2, 0]]
    header = ply_header("ascii", 6, 1).replace("element face", "element tristrips").replace("list uchar", "list int")
    text = header + "".join("{} {} {}\n".format(*point) for point in points) + f"{len(strip)} {' '.join(map(str, strip))}\n"
    mesh, notes = read(tmp_path, "a.ply", text)
    # The strips 0 1 3 2 and 2 3 3 5 4, the latter with two stitches.
    assert mesh.faces.tolist() == [[0, 1, 3], [3, 1, 2], [3, 5, 4]]
    assert notes == ("Split triangle strips into 3 triangles.",)


def test_colours_and_other_numbers_keep_name_and_type(tmp_path: Path) -> None:
    header = ply_header(
        "ascii", 3, 1, "uchar red;uchar green;uchar blue;float quality;float nx;float ny;float nz;short a_0;short a_1;float b_x"
    )
    text = header + "0 0 0 255 0 7 0.5 0 0 1 -1 2 1\n1 0 0 1 2 3 nan 0 0 1 -2 3 2\n0 1 0 4 5 6 1e3 0 0 1 -3 4 3\n3 0 1 2\n"
    mesh, notes = read(tmp_path, "a.ply", text)
    attributes = mesh.vertex_attributes
    assert set(attributes) == {"color", "quality", "a", "b_x"}
    assert attributes["color"].dtype == np.uint8
    assert attributes["color"].tolist() == [[255, 0, 7], [1, 2, 3], [4, 5, 6]]
    assert attributes["quality"].dtype == np.float32
    np.testing.assert_array_equal(attributes["quality"], np.array([0.5, np.nan, 1e3], dtype=np.float32))
    assert attributes["a"].dtype == np.int16
    assert attributes["a"].tolist() == [[-1, 2], [-2, 3], [-3, 4]]
    assert notes == ("Normals of the file were left out; they follow from the faces.",)


def test_attributes_follow_their_vertices_when_others_are_left_out(tmp_path: Path) -> None:
    text = ply_header("ascii", 4, 1, "int id") + "9 9 9 100\n0 0 0 101\n1 0 0 102\n0 1 0 103\n3 1 2 3\n"
    mesh, _ = read(tmp_path, "a.ply", text)
    assert mesh.vertex_attributes["id"].tolist() == [101, 102, 103]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("color", np.arange(12, dtype=np.uint8).reshape(4, 3)),
        ("color", np.arange(16, dtype=np.uint8).reshape(4, 4)),
        ("color", np.linspace(0, 1, 12).reshape(4, 3)),
        ("color", np.arange(8, dtype=np.float32).reshape(4, 2)),
        ("displacement", np.linspace(-1, 1, 12).reshape(4, 3)),
        ("displacement", np.linspace(-1, 1, 4)),
        ("field", np.linspace(-1, 1, 20).reshape(4, 5)),
        ("field", np.linspace(-1, 1, 4).reshape(4, 1)),
        ("length_of_displacement", np.array([0.1, np.nan, np.inf, -0.0])),
        *(
            ("number", np.array([0, 1, 2, 100], dtype=code))
            for code in ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8", ">f8", ">i2")
        ),
    ],
)
def test_attributes_come_back_with_name_shape_type_and_value(tmp_path: Path, name: str, values: np.ndarray) -> None:
    mesh, notes = read(tmp_path, "a.ply", written(square().with_attributes(**{name: values})))
    assert list(mesh.vertex_attributes) == [name]
    read_back = mesh.vertex_attributes[name]
    assert read_back.dtype == values.dtype.newbyteorder("=")
    np.testing.assert_array_equal(read_back, values)
    assert notes == ()


@pytest.mark.parametrize(
    ("values", "stored"),
    [
        (np.array([True, False, True, True]), np.uint8),
        (np.array([0, 1, -5, 2**31 - 1]), np.int32),
        (np.array([0, 1, -5, 2**31]), np.float64),
        (np.array([0.5, 1, 2, 3], dtype=np.float16), np.float32),
    ],
)
def test_types_that_ply_does_not_know_keep_their_values(tmp_path: Path, values: np.ndarray, stored: type) -> None:
    read_back = read(tmp_path, "a.ply", written(square().with_attributes(number=values)))[0].vertex_attributes["number"]
    assert read_back.dtype == stored
    np.testing.assert_array_equal(read_back, values)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("x", np.zeros(4)),
        ("two words", np.zeros(4)),
        ("", np.zeros(4)),
        ("line\nbreak", np.zeros(4)),
        ("words", np.array(["a", "b", "c", "d"])),
        ("complex", np.zeros(4, dtype=complex)),
        ("large", np.array([0, 1, 2, 2**60 + 1])),
    ],
)
def test_attributes_that_ply_cannot_hold_are_refused(tmp_path: Path, name: str, values: np.ndarray) -> None:
    with pytest.raises(MeshFileError, match="attribute"):
        write_mesh(tmp_path / "a.ply", square().with_attributes(**{name: values}))
    assert list(tmp_path.iterdir()) == []


def test_the_written_file_is_binary_little_endian_double() -> None:
    assert written(square()).replace(b"comment Written by dmp-viewer", b"comment made by hand") == binary_ply("<")


def without(line: str) -> str:
    return ASCII.replace(line + "\n", "", 1)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("ply\n", "no end"),
        (without("end_header"), "no end"),
        (without("format ascii 1.0"), "no line 'format'"),
        (ASCII.replace("ascii 1.0", "ascii 2.0"), "line 2: the PLY version '2.0' is unknown"),
        (ASCII.replace("ascii 1.0", "binary 1.0"), "line 2: the PLY format 'binary 1.0' is unknown"),
        (ASCII.replace("comment", "remark"), "line 3: 'remark' does not belong"),
        (ASCII.replace("element vertex 4", "element vertex four"), "line 4: 'four' is not a number of rows"),
        (ASCII.replace("element vertex 4", "element vertex -4"), "line 4: '-4' is not a number of rows"),
        (ASCII.replace("element vertex 4", "element vertex 4.0"), "line 4: '4.0' is not a number of rows"),
        (ASCII.replace("element vertex 4", "element vertex"), "line 4: an element needs"),
        (ASCII.replace("double x", "quadruple x"), "line 5: the type 'quadruple' is unknown"),
        (ASCII.replace("double x", "double"), "line 5: 'property double' does not declare"),
        (ASCII.replace("double y", "double x"), "line 6: the property 'x' is declared twice"),
        (ASCII.replace("element face", "element vertex"), "line 8: the element 'vertex' is declared twice"),
        (ASCII.replace("element vertex 4\n", ""), "line 4: a property stands before"),
        (ASCII.replace("double z", "double w"), "no number 'z'"),
        (ASCII.replace("element vertex", "element point"), "no element 'vertex'"),
        (ASCII.replace("vertex_indices", "corners"), "no list 'vertex_indices'"),
        (ASCII.replace("list uchar int", "list float int"), "line 9: the length of the list"),
        (ASCII.replace("list uchar int", "list uchar float"), "declared as 'float'"),
        (ASCII.replace("element vertex 4", "element vertex 5"), "line 15 has more values"),
        (ASCII.replace("element vertex 4", "element vertex 3"), "line 14 has more values"),
        (ASCII.replace("element vertex 4", "element vertex 999999999999999999"), "but the file has 6"),
        (ASCII.replace("element face 2", "element face 3"), "3 rows of 'face', but the file has 2"),
        (ASCII.replace("element face 2", "element face 1"), "line 16: the file goes on"),
        (ASCII[:-9], "2 rows of 'face', but the file has 1"),
        (ASCII[:-2], "line 16 has a list whose length"),
        (ASCII.replace("3 0 2 3", "3 0 2 4"), "line 16: a face refers to vertex 4, but the file has vertices 0 to 3"),
        (ASCII.replace("3 0 2 3", "3 0 2 -1"), "line 16: a face refers to vertex -1"),
        (ASCII.replace("3 0 2 3", "3 0 2 1.5"), "line 16: the index of a vertex is not a whole number"),
        (ASCII.replace("3 0 2 3", "3 0 2 nan"), "line 16: the index of a vertex is not a whole number"),
        (ASCII.replace("3 0 2 3", "-3 0 2 3"), "line 16 has a list whose length"),
        (ASCII.replace("3 0 2 3", "2.5 0 2 3"), "line 16 has a list whose length"),
        (ASCII.replace("3 0 2 3", "nan 0 2 3"), "line 16 has a list whose length"),
        (ASCII.replace("3 0 2 3", "3 0 2 3 1"), "line 16 has more values"),
        (ASCII.replace("1.0 0.25 0.0", "1.0 nan 0.0"), "line 12: vertex 1 has a coordinate that is not a finite number"),
        (ASCII.replace("1.0 0.25 0.0", "1.0 1e400 0.0"), "line 12: vertex 1 has a coordinate that is not a finite number"),
        (ASCII.replace("1.0 0.25 0.0", "1.0 0,25 0.0"), "line 12: the number '0,25' has a decimal comma"),
        (ASCII.replace("1.0 0.25 0.0", "1.0 half 0.0"), "line 12: 'half' is not a number"),
        (ASCII.replace("1.0 0.25 0.0", "1.0 0.25"), "line 12 has fewer values"),
        (ASCII.replace("1.0 0.25 0.0", "1.0 0.25 0.0 1"), "line 12 has more values"),
        (ASCII.replace("3 0 2 3\n", "3 0 \0\0\0\0"), "zero byte at byte"),
        (ASCII.replace("comment", "com\0ment"), "zero byte"),
        (ply_header("ascii", 4, 0) + ROWS, "4 vertices but no faces"),
        (ASCII.split("element face")[0] + "end_header\n" + ROWS, "4 vertices but no faces"),
        (ply_header("ascii", 0, 0), "no vertices"),
        (ASCII.replace("element face 2", "obj_info num_cols 2\nelement range_grid 2"), "range grid"),
        (ply_header("ascii", 3, 1, "uchar red") + "0 0 0 1\n1 0 0 256\n0 1 0 3\n3 0 1 2\n", "line 13: the value of 'red'"),
        (ply_header("ascii", 3, 1, "uchar red") + "0 0 0 1\n1 0 0 0.5\n0 1 0 3\n3 0 1 2\n", "line 13: the value of 'red'"),
        (binary_ply("<").decode("latin-1").encode("utf-16"), "converted like a text"),
        (b"PLY" + ASCII[3:].encode(), "does not begin with 'ply'"),
    ],
)
def test_refusals_of_headers_and_text(tmp_path: Path, content: str | bytes, expected: str) -> None:
    assert expected in refusal(tmp_path, "a.ply", content)


HEADER_BYTES = len(ply_header("binary_little_endian", 4, 2))
FACES_AT = HEADER_BYTES + 4 * 24


def with_bytes(position: int, replacement: bytes) -> bytes:
    content = binary_ply("<")
    return content[:position] + replacement + content[position + len(replacement) :]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (binary_ply("<")[:-1], f"byte {len(binary_ply('<')) - 1}: the file ends inside|list of 3 values"),
        (binary_ply("<")[: FACES_AT + 5], "list of 3 values"),
        (binary_ply("<")[: FACES_AT - 30], "take at least 98 bytes, but only 66 follow"),
        (binary_ply("<")[:HEADER_BYTES], "but only 0 follow"),
        (binary_ply("<").replace(b"vertex 4", b"vertex 999999999999"), "take at least 23,999,999,999,978 bytes"),
        (binary_ply("<").replace(b"face 2", b"face 4000000000"), "take at least 4,000,000,096 bytes"),
        (binary_ply("<").replace(b"face 2", b"face 3"), "the file ends inside row 2"),
        (binary_ply("<").replace(b"face 2", b"face 1"), "13 bytes follow after"),
        (binary_ply("<").replace(b"vertex 4", b"vertex 5"), ""),
        (binary_ply("<").replace(b"vertex 4", b"vertex 3"), ""),
        (binary_ply("<").replace(b"little", b"big"), ""),
        (with_bytes(HEADER_BYTES + 24, struct.pack("<d", np.nan)), f"byte {HEADER_BYTES + 24}: vertex 1 has a coordinate"),
        (with_bytes(HEADER_BYTES + 24, struct.pack("<d", -np.inf)), f"byte {HEADER_BYTES + 24}: vertex 1 has a coordinate"),
        (with_bytes(FACES_AT + 14, struct.pack("<i", 4)), f"byte {FACES_AT + 13}: a face refers to vertex 4"),
        (with_bytes(FACES_AT + 14, struct.pack("<i", -1)), f"byte {FACES_AT + 13}: a face refers to vertex -1"),
        (with_bytes(FACES_AT, b"\xff"), f"byte {FACES_AT}: row 0 of 'face' has a list of 255 values"),
        (with_bytes(FACES_AT + 13, bytes(13)), f"from byte {FACES_AT + 12} on the file holds only zeros|only zeros"),
        (with_bytes(FACES_AT, bytes(26)), "only zeros"),
        (binary_ply("<") + b"more than a whole face", "22 bytes follow"),
        (binary_ply("<", [[LIKE_LINE_END, 0.0, 0.0], *SQUARE_VERTICES[1:]]).replace(b"\n", b"\r\n"), ""),
        (binary_ply("<").replace(b"list uchar", b"list char").replace(b"\x03", b"\xfd"), "list of -3 values"),
        (binary_ply("<").replace(b"list uchar", b"list int"), "values"),
        (binary_ply("<").replace(b"list uchar", b"list uint64"), "values"),
    ],
)
def test_refusals_of_binary_files(tmp_path: Path, content: bytes, expected: str) -> None:
    text = refusal(tmp_path, "a.ply", content)
    assert any(part in text for part in expected.split("|"))


def test_a_tail_of_zeros_after_good_faces_is_told_with_its_byte(tmp_path: Path) -> None:
    mesh = grid_mesh(30, 0.1)
    content = written(mesh)
    text = refusal(tmp_path, "a.ply", content[:-2000] + bytes(2000))
    byte = int(text.split("from byte ")[1].split(" ")[0].replace(",", ""))
    assert len(content) - 2004 <= byte <= len(content) - 2000


def test_vertices_of_zeros_at_the_end_are_refused(tmp_path: Path) -> None:
    header = (
        b"ply\nformat binary_little_endian 1.0\nelement face 2\nproperty list uchar int vertex_indices\nelement vertex 4\n"
        b"property double x\nproperty double y\nproperty double z\nend_header\n"
    )
    faces = b"".join(struct.pack("<B3i", 3, *face) for face in SQUARE_FACES)
    vertices = b"".join(struct.pack("<3d", *vertex) for vertex in SQUARE_VERTICES)
    assert read(tmp_path, "a.ply", header + faces + vertices)[0].vertices.tolist() == SQUARE_VERTICES
    assert "only zeros" in refusal(tmp_path, "b.ply", header + faces + vertices[:48] + bytes(48))


def test_a_few_bytes_after_the_end_are_noted(tmp_path: Path) -> None:
    assert read(tmp_path, "a.ply", binary_ply("<") + b"\r\n")[1] == ("Ignored 2 bytes after the end of the mesh.",)
    assert read(tmp_path, "b.ply", binary_ply("<") + bytes(512))[1] == ("Ignored 512 bytes after the end of the mesh.",)


def test_too_many_elements_and_properties(tmp_path: Path) -> None:
    many = "".join(f"element e{i} 0\n" for i in range(1000))
    assert "more than 100 elements" in refusal(tmp_path, "a.ply", ASCII.replace("end_header\n", many + "end_header\n"))
    wide = "".join(f"property float p{i}\n" for i in range(2000))
    assert "more than 1,000 properties" in refusal(tmp_path, "b.ply", ASCII.replace("end_header\n", wide + "end_header\n"))


def test_faces_for_which_there_is_no_room_are_refused_before_each_is_looked_at(tmp_path: Path) -> None:
    header = ply_header("binary_little_endian", 3, 200_000).replace("uchar int", "uchar uchar").encode()
    body = np.eye(3).tobytes() + b"\3\0\1\2" + bytes(199_999)
    text = refusal(tmp_path, "a.ply", header + body)
    assert f"byte {len(header) + 72:,}: 200,000 faces are declared, but most of them cannot have three corners" in text
    mixed = np.eye(3).tobytes() + b"\3\0\1\2\4\2\1\0\1" * 100_000
    assert read(tmp_path, "b.ply", header + mixed)[0].n_faces >= 200_000


def test_two_lists_of_corners_are_refused(tmp_path: Path) -> None:
    content = ply_header("ascii", 3, 1, face="list uchar int vertex_index") + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 3 0 2 1\n"
    assert "both vertex_indices and vertex_index" in refusal(tmp_path, "a.ply", content)
