"""Reading VTP and legacy VTK: all the ways that VTK stores arrays hold the same mesh; sizes are checked before reading."""

from __future__ import annotations

import base64
import re
import struct
import time
import zlib
from pathlib import Path

import numpy as np
import pytest

from dmp.formats.ply_writing import write_ply
from tests.dmp.formats.containers import Vtp, vtk_file
from tests.dmp.formats.files import SQUARE_FACES, SQUARE_VERTICES, read, refusal
from tests.meshes import sphere_mesh

ROUNDED = np.float32(SQUARE_VERTICES).astype(float).tolist()


@pytest.mark.parametrize("layout", ["ascii", "binary", "raw", "base64"])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("word", ["u4", "u8"])
@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("kind", ["Float64", "Float32"])
def test_every_way_of_storing_arrays(tmp_path: Path, layout: str, order: str, word: str, packed: bool, kind: str) -> None:
    writer = Vtp(layout, order=order, word=word, packed=packed, block=32)
    content = writer.file(writer.piece(SQUARE_VERTICES, SQUARE_FACES, kind=kind))
    mesh, notes = read(tmp_path, "a.vtp", content)
    # Positions in a text keep their digits.
    assert mesh.vertices.tolist() == (SQUARE_VERTICES if kind == "Float64" or layout == "ascii" else ROUNDED)
    assert mesh.faces.tolist() == SQUARE_FACES
    assert notes == ()


def ascii_vtp(**more: object) -> str:
    writer = Vtp()
    return writer.file(writer.piece(SQUARE_VERTICES, SQUARE_FACES, **more)).decode()  # type: ignore[arg-type]


VTP = ascii_vtp()


@pytest.mark.parametrize(
    "content",
    [
        VTP.replace("\n", "\r\n"),
        "\ufeff" + VTP,
        VTP.replace('<?xml version="1.0"?>', "").encode("utf-16"),
        VTP.replace('version="1.0"?', 'version="1.0" encoding="UTF-16"?').encode("utf-16"),
        VTP.replace('version="1.0"?', 'version="1.0" encoding="ISO-8859-1"?').replace("Points<", "\xe4<").encode("latin-1"),
        VTP.replace('<?xml version="1.0"?>', '<?xml version="1.0"?>\n<!-- by hand > -->\n'),
        VTP.replace('Name="Points"', 'Name="a > b"'),
        VTP.replace("</Points>", "<!-- end --></Points>").replace("</DataArray>", "<Information/></DataArray>", 1),
        VTP.replace("<Polys>", "<Other><DataArray/></Other><Polys>"),
    ],
)
def test_the_same_square_in_every_spelling(tmp_path: Path, content: str | bytes) -> None:
    mesh, _ = read(tmp_path, "a.vtp", content)
    assert mesh.vertices.tolist() == SQUARE_VERTICES
    assert mesh.faces.tolist() == SQUARE_FACES


def test_pieces_polygons_and_strips_are_one_mesh(tmp_path: Path) -> None:
    writer = Vtp("raw")
    first = writer.piece(SQUARE_VERTICES, [[0, 1, 2, 3]])
    second = writer.piece(np.array(SQUARE_VERTICES) + 5, [], strips=[[0, 1, 3, 2]], lines=[[0, 1]])
    mesh, notes = read(tmp_path, "a.vtp", writer.file(first, second))
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 7], [7, 5, 6]]
    assert notes == (
        "Split triangle strips into 2 triangles.",
        "Left out 1 line.",
        "Split 1 polygon with more than three corners into 2 triangles.",
    )


def test_values_of_the_points_become_attributes_that_ply_can_keep(tmp_path: Path) -> None:
    writer = Vtp("binary")
    data = (
        writer.array(np.arange(4.0), "Float64", "a b")
        + writer.array(np.arange(12).reshape(4, 3), "UInt8", "RGB")
        + writer.array(np.arange(12).reshape(4, 3), "Float32", "Normals")
        + writer.array(np.arange(8).reshape(4, 2), "Int16", "pair")
        + writer.array(np.arange(4), "Int32", "pair_0")
        + writer.array(np.arange(4), "Int32", "x")
        + writer.array(np.full(4, 2**60 + 1), "Int64", "large")
        + writer.array(np.arange(4), "Int32", "red")
        + '<Array type="String" Name="words" format="ascii">65 0</Array>'
    )
    mesh, notes = read(tmp_path, "a.vtp", writer.file(writer.piece(SQUARE_VERTICES, SQUARE_FACES, data=data)))
    assert {name: (values.dtype.str[1:], values.tolist()) for name, values in mesh.vertex_attributes.items()} == {
        "a_b": ("f8", [0, 1, 2, 3]),
        "color": ("u1", [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]]),
        "pair": ("i2", [[0, 1], [2, 3], [4, 5], [6, 7]]),
    }
    assert notes == (
        "Texture coordinates and normals of the file were left out.",
        "Values of the vertices that are no numbers were left out.",
        "Left out values of the vertices whose names or types cannot be kept: 'pair_0', 'x', 'large', 'red'.",
    )
    back, _ = read(tmp_path, "a.ply", b"".join(write_ply(mesh)))
    assert set(back.vertex_attributes) == set(mesh.vertex_attributes)


def test_positions_beyond_the_range_that_the_file_tells_are_noted(tmp_path: Path) -> None:
    good = VTP.replace('Name="Points"', 'Name="Points" RangeMin="0.1" RangeMax="1.5"')
    assert read(tmp_path, "a.vtp", good)[1] == ()
    assert "may be damaged" in read(tmp_path, "b.vtp", good.replace('RangeMax="1.5"', 'RangeMax="1.4"'))[1][0]


def stored(layout: str, *, packed: bool = False) -> bytes:
    writer = Vtp(layout, packed=packed, block=32)
    return writer.file(writer.piece(SQUARE_VERTICES, SQUARE_FACES))


RAW, PACKED = stored("raw"), stored("raw", packed=True)
INLINE = stored("binary").decode()
RAW_START = RAW.index(b"\n_") + 2
PACKED_START = PACKED.index(b"\n_") + 2


def swap(content: bytes, position: int, replacement: bytes) -> bytes:
    return content[:position] + replacement + content[position + len(replacement) :]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (VTP.replace('NumberOfPoints="4"', 'NumberOfPoints="5"'), "array 'Points': it has 12 numbers instead of 15"),
        (VTP.replace('NumberOfPoints="4"', 'NumberOfPoints="3"'), "array 'Points': it has 12 numbers instead of 9"),
        (VTP.replace('NumberOfPoints="4"', 'NumberOfPoints="999999999999"'), "would take more than 33,554,432 bytes"),
        (VTP.replace('NumberOfPoints="4"', 'NumberOfPoints="-4"'), "line 4: 'NumberOfPoints' is not a number"),
        (VTP.replace('NumberOfPolys="2"', 'NumberOfPolys="3"'), "array 'offsets': it has 2 numbers instead of 3"),
        (VTP.replace('NumberOfPolys="2"', 'NumberOfPolys="1"'), "array 'offsets': it has 2 numbers instead of 1"),
        (VTP.replace('NumberOfPolys="2"', 'NumberOfPolys="0"'), "4 vertices but no faces"),
        (VTP.replace("\n3 6\n", "\n6 3\n"), "it has 6 numbers instead of 3"),
        (VTP.replace("\n3 6\n", "\n7 6\n"), "do not fit to their 6 corners"),
        (VTP.replace("\n3 6\n", "\n-3 6\n"), "do not fit to their 6 corners"),
        (VTP.replace("\n3 6\n", "\n3 -6\n"), "the places where cells end are negative"),
        (VTP.replace("0 1 2 0 2 3", "0 1 2 0 2 4"), "polygon 1 refers to vertex 4, but there are vertices 0 to 3"),
        (VTP.replace("0 1 2 0 2 3", "0 1 2 0 2 -1"), "polygon 1 refers to vertex -1"),
        (VTP.replace("0 1 2 0 2 3", "0 1 2 0 2 2.5"), "holds something that is not a number"),
        (VTP.replace("0.25", "nan"), "point 1 has a coordinate that is not a finite number"),
        (VTP.replace("0.25", "0,25"), "holds something that is not a number"),
        (VTP.replace("0.25", "&#48;"), "holds something that is not a number"),
        (VTP.replace('"Float64"', '"Quad"'), "the type 'Quad' is unknown"),
        (VTP.replace('NumberOfComponents="3"', 'NumberOfComponents="2"'), "no array of positions with three components"),
        (VTP.replace('format="ascii"', 'format="tape"'), "the format 'tape' is unknown"),
        (VTP.replace('Name="offsets"', 'Name="ends"'), "'connectivity' and 'offsets' are not both there"),
        (VTP.replace('"Int64"', '"Float32"'), "array 'connectivity': the array does not hold whole numbers"),
        (VTP.replace("LittleEndian", "MiddleEndian"), "the byte order or the type of the headers is unknown"),
        (VTP.replace("</VTKFile>", ""), "the XML text is damaged"),
        (VTP.replace("<VTKFile", '<!DOCTYPE a [<!ENTITY b "c">]><VTKFile'), "this is an XML file"),
        (VTP.replace("PolyData", "UnstructuredGrid"), "holds 'UnstructuredGrid' and no PolyData"),
        (VTP.replace("Polys", "Lines").replace('NumberOfLines="0"', ""), "2 lines but no faces"),
        (INLINE.replace("==\n", "\n"), "base64 text is cut off or damaged"),
        (re.sub("AAAA", "!!!!", INLINE, count=1), "base64 text is cut off or damaged"),
        (INLINE.replace('NumberOfPoints="4"', 'NumberOfPoints="5"'), "it has 96 bytes instead of 120"),
        (INLINE.replace("\n</DataArray>", "AAAA\n</DataArray>"), "base64 text goes on after its 96 bytes|damaged"),
        (INLINE.replace("=\n", "=\nAAAA"), "base64 text goes on after"),
        (RAW[:-20], "does not end with '</VTKFile>'"),
        (RAW[: len(RAW) // 2], "does not end with '</VTKFile>'|XML"),
        (RAW[: RAW_START + 60] + RAW[RAW_START + 100 :], "instead of|ends before|appended bytes"),
        (swap(RAW, RAW_START, struct.pack("<I", 2**32 - 1)), "it has 4,294,967,295 bytes instead of 96"),
        (swap(RAW, RAW_START - 1, b"-"), "do not begin with '_'"),
        (RAW.replace(b'encoding="raw"', b'encoding="zip"'), "encoding of the appended data is unknown"),
        (RAW.replace(b'offset="0"', b'offset="99999"'), "its data begin at byte 99,999"),
        (swap(RAW, RAW_START + 4, struct.pack("<d", np.inf)), "point 0 has a coordinate that is not a finite number"),
        (swap(PACKED, PACKED_START, struct.pack("<I", 2**31)), "it declares 2,147,483,648 blocks, more than the file can hold"),
        (swap(PACKED, PACKED_START + 4, struct.pack("<I", 64)), "it unpacks to 160 bytes instead of 96|instead of 96"),
        (swap(PACKED, PACKED_START + 24, b"\0\0\0\0"), "a compressed block is damaged"),
        (swap(PACKED, PACKED_START + 12, struct.pack("<I", 5)), "a compressed block is|damaged"),
        (PACKED.replace(b"ZLib", b"LZ44"), "the data are compressed by 'vtkLZ44DataCompressor'"),
    ],
)
def test_refusals_of_vtp(tmp_path: Path, content: str | bytes, expected: str) -> None:
    text = refusal(tmp_path, "a.vtp", content)
    assert any(part in text for part in expected.split("|"))


def test_small_files_do_not_unpack_to_large_ones(tmp_path: Path) -> None:
    n_points = 5_000_000
    packed = zlib.compress(bytes(24 * n_points), 9)
    data = base64.b64encode(struct.pack("<4I", 1, 24 * n_points, 0, len(packed))) + base64.b64encode(packed)
    text = INLINE.replace('header_type="UInt32"', 'header_type="UInt32" compressor="vtkZLibDataCompressor"')
    text = text.replace('NumberOfPoints="4"', f'NumberOfPoints="{n_points}"')
    content = re.sub(r"(?s)(Name=\"Points\".*?>).*?<", lambda match: match[1] + data.decode() + "<", text, count=1)
    start = time.perf_counter()
    assert "would take more than" in refusal(tmp_path, "a.vtp", content)
    assert time.perf_counter() - start < 1


# ---------------------------------------------------------------------------------------------------------- legacy files


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("version", [1, 3, 4, 5])
@pytest.mark.parametrize("tail", [b"", b"\nPOINT_DATA 4\nSCALARS a float 1\nLOOKUP_TABLE default\n1 2\n"])
def test_legacy_files_of_all_versions(tmp_path: Path, binary: bool, version: int, tail: bytes) -> None:
    content = vtk_file(SQUARE_VERTICES, SQUARE_FACES, binary=binary, version=version, tail=tail)
    mesh, notes = read(tmp_path, "a.vtk", content)
    assert mesh.vertices.tolist() == SQUARE_VERTICES
    assert mesh.faces.tolist() == SQUARE_FACES
    assert notes == (("Values of the vertices and faces of the file were left out.",) if tail else ())


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("version", [3, 5])
def test_polygons_and_strips_in_legacy_files(tmp_path: Path, binary: bool, version: int) -> None:
    points = [*SQUARE_VERTICES, [2, 0, 0], [2, 1, 0.5]]
    content = vtk_file(points, [[0, 1, 2, 3], [1, 4, 2]], strips=[[4, 5, 2]], binary=binary, version=version)
    mesh, _ = read(tmp_path, "a.vtk", content)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2], [4, 5, 2]]


LEGACY = vtk_file(SQUARE_VERTICES, SQUARE_FACES).decode()
LEGACY_5 = vtk_file(SQUARE_VERTICES, SQUARE_FACES, version=5).decode()
BINARY = vtk_file(SQUARE_VERTICES, SQUARE_FACES, binary=True)
FIELD = "FIELD FieldData 2\nTIME 1 1 double\n0.5\nCYCLE 1 1 int\n7\n"
METADATA = "METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1\n\n"


@pytest.mark.parametrize(
    "content",
    [
        LEGACY.replace("\n", "\r\n"),
        LEGACY.replace("\n", "\r"),
        LEGACY.encode("utf-16"),
        LEGACY.replace(" ", "\t", 20).replace("#\tvtk\tDataFile\tVersion\t", "# vtk DataFile Version "),
        LEGACY.replace("DATASET", FIELD + "DATASET"),
        LEGACY.replace("POINTS", FIELD + "POINTS"),
        LEGACY.replace("POLYGONS", METADATA + "POLYGONS"),
        LEGACY.replace("POLYGONS", "VERTICES 1 2\n1 0\nPOLYGONS"),
        LEGACY.replace("made by hand", ""),
        LEGACY.replace("double", "float").replace("polydata", "POLYDATA").replace("POINTS", "points"),
        BINARY.replace(b"DATASET", b"FIELD FieldData 1\nTIME 1 1 double\n" + bytes(8) + b"\nDATASET"),
        BINARY + bytes(4),
    ],
)
def test_legacy_files_in_every_spelling(tmp_path: Path, content: str | bytes) -> None:
    mesh, _ = read(tmp_path, "a.vtk", content)
    assert mesh.vertices.tolist() == SQUARE_VERTICES
    assert mesh.faces.tolist() == SQUARE_FACES


POINTS_AT = BINARY.index(b"double\n") + 7
CELLS_AT = BINARY.index(b"POLYGONS 2 8\n") + 13


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("# vtk DataFile Version 3.0\n", "the first three lines are not those of a VTK file"),
        (LEGACY.replace("Version 3.0", "Version 9.0"), "version 9.0; versions up to 5"),
        (LEGACY.replace("POLYDATA", "UNSTRUCTURED_GRID"), "holds 'UNSTRUCTURED_GRID' and no POLYDATA"),
        (LEGACY.replace("DATASET POLYDATA\n", ""), "line 4: the line 'DATASET …' is missing"),
        (LEGACY.replace("POINTS 4", "POINTS 5"), "line 6: 15 numbers are declared for the points, but 12 follow"),
        (LEGACY.replace("POINTS 4", "POINTS 3"), "line 6: 9 numbers are declared for the points, but 12 follow"),
        (LEGACY.replace("POINTS 4", "POINTS -4"), "the numbers of what follows are missing"),
        (LEGACY.replace("POINTS 4", "POINTS 999999999999999"), "but 12 follow"),
        (LEGACY.replace("double", "quadruple"), "line 5: the type 'quadruple' is unknown"),
        (LEGACY.replace("0.25", "nan"), "point 1 after this place has a coordinate that is not a finite number"),
        (LEGACY.replace("0.25", "0,25"), "line 6: the number '0,25' has a decimal comma"),
        (LEGACY.replace("0.25", "0x25"), "line 6: '0x25' is not a number"),
        (LEGACY.replace("POLYGONS 2 8", "POLYGONS 2 9"), "9 numbers are declared for the polygons, but 8 follow"),
        (LEGACY.replace("POLYGONS 2 8", "POLYGONS 3 8"), "the 8 numbers of the polygons are not 3 cells"),
        (LEGACY.replace("POLYGONS 2 8", "POLYGONS 1 8"), "the 8 numbers of the polygons are not 1 cell"),
        (LEGACY.replace("3 0 2 3", "3 0 2 4"), "polygon 1 refers to vertex 4"),
        (LEGACY.replace("3 0 2 3", "3 0 2 -1"), "polygon 1 refers to vertex -1"),
        (LEGACY.replace("3 0 2 3", "-3 0 2 3"), "are not 2 cells"),
        (LEGACY.replace("3 0 2 3", "3 0 2 2.5"), "one of the polygons from here on is not a whole number"),
        (LEGACY[:-5], "8 numbers are declared for the polygons, but 6 follow"),
        (LEGACY.split("POLYGONS")[0], "4 vertices but no faces"),
        (LEGACY + "3 0 1 3\n", "8 numbers are declared for the polygons, but 12 follow"),
        (LEGACY + "SURPRISE 1 2\n", "'SURPRISE' is not a number"),
        (LEGACY + LEGACY[LEGACY.index("POINTS") :], "'POINTS' is out of place"),
        (LEGACY + "\0\0\0", "zero byte at byte"),
        (LEGACY_5.replace("0 3 6", "0 4 3"), "do not fit to their 6 corners"),
        (LEGACY_5.replace("0 3 6", "1 3 6"), "does not begin at 0"),
        (LEGACY_5.replace("0 3 6", "0 3 5"), "do not fit to their 6 corners"),
        (LEGACY_5.replace("CONNECTIVITY vtktypeint64", "CONNECTIVITY float"), "the type of whole numbers is missing"),
        (LEGACY_5.replace("CONNECTIVITY", "CONECTIVITY"), "'CONECTIVITY' is not a number"),
        (BINARY[:-10], "the polygons take 32 bytes, but only 23 follow"),
        (BINARY[: POINTS_AT + 50], "the points take 96 bytes, but only 50 follow"),
        (BINARY.replace(b"POINTS 4", b"POINTS 999999999999"), "the points take 23,999,999,999,976 bytes"),
        (BINARY.replace(b"POINTS 4", b"POINTS 3"), "is out of place"),
        (swap(BINARY, POINTS_AT, struct.pack(">d", np.nan)), "point 0 after this place"),
        (swap(BINARY, CELLS_AT, bytes(32)), "are not 2 cells"),
        (swap(BINARY, CELLS_AT + 12, struct.pack(">i", 2**31 - 1)), "refers to vertex 2,147,483,647"),
        (BINARY + bytes(40), "many zero bytes follow"),
        (swap(BINARY, CELLS_AT + 20, bytes(12)), "the polygons: the last of them holds only zeros"),
        (BINARY + b"rubbish", "'rubbish' is out of place"),
    ],
)
def test_refusals_of_legacy_files(tmp_path: Path, content: str | bytes, expected: str) -> None:
    assert expected in refusal(tmp_path, "a.vtk", content)


def test_positions_that_were_never_written_are_refused(tmp_path: Path) -> None:
    mesh = sphere_mesh(2)
    content = vtk_file(mesh.vertices, mesh.faces, binary=True)
    start = content.index(b"double\n") + 7
    assert "the vertices 10 to 29 all lie at exactly 0 0 0" in refusal(
        tmp_path, "a.vtk", swap(content, start + 240, bytes(480))
    )


def test_the_one_word_that_is_no_number_is_found_in_a_long_text(tmp_path: Path) -> None:
    rows = ["0.1 0.2 0.3"] * 5000
    head = "# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\nPOINTS 5000 double\n"
    rows[3210] = "0.1 0,2 0.3"
    assert f"line {6 + 3210}: the number '0,2' has a decimal comma" in refusal(tmp_path, "a.vtk", head + "\n".join(rows) + "\n")
    rows[3210] = "0.1 0.2"
    text = refusal(tmp_path, "b.vtk", head + "\n".join(rows) + "\n")
    assert "15,000 numbers are declared for the points, but 14,999 follow" in text
