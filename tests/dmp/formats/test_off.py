"""Reading OFF and its variants; the counts, and every row, must fit to what follows."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import numpy as np
import pytest

from tests.dmp.formats.containers import binary_off
from tests.dmp.formats.files import SQUARE_VERTICES, read, refusal

ROWS = "0 0 0\n1 0 0\n1 1 .5\n0 1 0\n"
PLAIN = f"OFF\n4 2 5\n{ROWS}3 0 1 2\n3 0 2 3\n"


@pytest.mark.parametrize(
    "content",
    [
        PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        PLAIN.replace(" ", "\t  "),
        PLAIN.replace("OFF\n4 2 5", "OFF 4 2 5"),
        PLAIN.replace("OFF\n4 2 5", "off\n4 2"),
        PLAIN.removeprefix("OFF\n"),
        PLAIN.replace("OFF\n", "# made by hand\n\nOFF # keyword\n# counts\n").replace(
            "1 1 .5\n", "1 1 .5 # a corner\n\n# and so on\n"
        ),
        PLAIN.replace("4 2 5", "4\n2\n5"),
        PLAIN.replace("1 0 0\n", "1\n0\n0\n").replace("3 0 2 3", "3 0\n2\n3"),
        PLAIN.replace(" ", "\n"),
        f"OFF\n4 2 0\n{ROWS.replace(chr(10), ' ')}\n3 0 1 2\n3 0 2 3\n",
        "OFF\n4 2 0\n0 0 0 1 0\n0 1 1 .5 0\n1 0\n3 0 1 2\n3 0 2 3\n",
        PLAIN.replace("3 0 1 2", "3 0 1 2 255 0 0").replace("3 0 2 3", "3 0 2 3 0.5 0.5 0.5 1"),
        PLAIN.replace("3 0 1 2", "3 0 1 2 7"),
        PLAIN.rstrip("\n"),
        PLAIN.encode("utf-16"),
        "\ufeff" + PLAIN,
        "NOFF\n4 2 0\n" + ROWS.replace("\n", " 0 0 1\n") + "3 0 1 2\n3 0 2 3\n",
        "4OFF\n4 2 0\n0 0 0 1\n2 0 0 2\n-1 -1 -.5 -1\n0 5 0 5\n3 0 1 2\n3 0 2 3\n",
        "nOFF\n3\n4 2 0\n" + ROWS + "3 0 1 2\n3 0 2 3\n",
    ],
)
def test_the_same_square_in_every_spelling(tmp_path: Path, content: str | bytes) -> None:
    mesh, _ = read(tmp_path, "a.off", content)
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0.5], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def rows_with(values: str) -> str:
    return ROWS.replace("\n", f" {values}\n") + "3 0 1 2\n3 0 2 3\n"


@pytest.mark.parametrize(
    ("content", "colour", "dtype"),
    [
        ("COFF\n4 2 0\n" + rows_with("255 128 0 255"), [255, 128, 0, 255], np.uint8),
        ("COFF\n4 2 0\n" + rows_with("255 128 0"), [255, 128, 0], np.uint8),
        ("COFF\n4 2 0\n" + rows_with("0.5 0.25 0 1"), [0.5, 0.25, 0, 1], np.float64),
        ("OFF\n4 2 0\n" + rows_with("0.5 0.25 0"), [0.5, 0.25, 0], np.float64),
        ("CNOFF\n4 2 0\n" + rows_with("0 0 1 0.5 0.25 0 1"), [0.5, 0.25, 0, 1], np.float64),
        ("NCOFF\n4 2 0\n" + rows_with("255 128 0 255 0 0 1"), [255, 128, 0, 255], np.uint8),
        ("coff\n4 2 0\n" + rows_with("0.5 0.25 0"), [0.5, 0.25, 0], np.float64),
        ("COFF\n4 2 0\n" + rows_with("0.5 0.25\n0 1"), [0.5, 0.25, 0, 1], np.float64),
    ],
)
def test_colours_of_vertices(tmp_path: Path, content: str, colour: list, dtype: type) -> None:
    mesh, _ = read(tmp_path, "a.off", content)
    assert mesh.n_faces == 2
    assert mesh.vertex_attributes["color"].dtype == dtype
    assert mesh.vertex_attributes["color"].tolist() == [colour] * 4


def test_texture_coordinates_follow_normals_and_colours(tmp_path: Path) -> None:
    mesh, notes = read(tmp_path, "a.off", "STCNOFF\n4 2 0\n" + rows_with("0 0 1 0.1 0.2 0.3 0.4 0.25 0.75"))
    assert mesh.vertex_attributes["color"].tolist() == [[0.1, 0.2, 0.3, 0.4]] * 4
    assert mesh.vertex_attributes["texture_u"].tolist() == [0.25] * 4
    assert mesh.vertex_attributes["texture_v"].tolist() == [0.75] * 4
    assert notes == ("Normals of the file were left out; they follow from the faces.",)


def test_polygons_and_edges(tmp_path: Path) -> None:
    mesh, notes = read(tmp_path, "a.off", f"OFF\n4 2 0\n{ROWS}4 0 1 2 3\n2 0 2\n")
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert "Split 1 polygon" in notes[0]
    assert "1 degenerate face" in notes[1]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (PLAIN.replace("4 2 5", "5 2 5"), "line 7: a vertex has 4 values instead of 3"),
        (PLAIN.replace("4 2 5", "3 2 5"), "line 6: the index|line 6|declares"),
        (PLAIN.replace("4 2 5", "4 3 5"), "declares 3 faces, but the lines after its vertices are 2"),
        (PLAIN.replace("4 2 5", "4 1 5"), "line 8: the file goes on after"),
        (PLAIN.replace("4 2 5", "999999999999 2 5"), "declares 999,999,999,999 vertices, but only 20 numbers follow"),
        (PLAIN.replace("4 2 5", "4 999999999999 5"), "declares 999,999,999,999 faces"),
        (PLAIN.replace("4 2 5", "-4 2 5"), "line 2: -4 and 2 are not numbers of vertices"),
        (PLAIN.replace("4 2 5", "4.5 2 5"), "line 2: 4.5 and 2 are not numbers of vertices"),
        (PLAIN.replace("4 2 5", "nan 2 5"), "line 2: nan and 2 are not numbers"),
        (PLAIN.replace("4 2 5", "four 2 5"), "line 2: 'four' is not a number"),
        ("OFF\n", "ends before the numbers"),
        ("OFF\n4\n", "ends before the numbers"),
        (PLAIN.replace("1 0 0\n", "1 0\n"), "line 4: a vertex has 2 values instead of 3"),
        (PLAIN.replace("1 0 0\n", "1 0 0 0\n"), "line 4: a vertex has 4 values instead of 3"),
        (PLAIN.replace("0 0 0\n1 0 0\n", "0 0\n1 0 0 0\n"), "line 3: a vertex has 2 values instead of 3"),
        (PLAIN.replace("1 0 0\n", "1 nan 0\n"), "line 4: vertex 1 has a value that is not a finite number"),
        (PLAIN.replace("1 0 0\n", "1\nnan\n0\n"), "line 5: vertex 1 has a value that is not a finite number|line 4: vertex 1"),
        (PLAIN.replace("1 0 0\n", "1 1,5 0\n"), "line 4: the number '1,5' has a decimal comma"),
        (PLAIN.replace("1 0 0\n", "1 -1.#IND 0\n"), "line 4: '-1.#IND' is not a finite number"),
        (PLAIN.replace("3 0 2 3", "3 0 2 4"), "line 8: a face refers to vertex 4, but the file has vertices 0 to 3"),
        (PLAIN.replace("3 0 2 3", "3 0 2 -1"), "line 8: a face refers to vertex -1"),
        (PLAIN.replace("3 0 2 3", "3 0 2 2.5"), "line 8: the index of a vertex is not a whole number"),
        (PLAIN.replace("3 0 2 3", "3 0 2"), "line 8: 3 is not a possible number of corners"),
        (PLAIN.replace("3 0 2 3", "-3 0 2 3"), "line 8: -3 is not a possible number of corners"),
        (PLAIN.replace("3 0 2 3", "1e18 0 2 3"), "line 8: 1e+18 is not a possible number of corners"),
        (PLAIN.replace("3 0 2 3", "3 0 2 3 1 2"), "line 8: 2 values follow the 3 corners"),
        (PLAIN[:-9], "declares 2 faces"),
        (PLAIN[:-4], "line 8: 3 is not a possible number of corners"),
        (PLAIN + "3 0 1 3\n", "line 9: the file goes on after"),
        # A count that is wrong swallows the rows that follow.
        (
            PLAIN.replace("4 2 5", "4 3 5").replace("3 0 1 2", "6 0\n3 0 1 2\n1 2") + "3 0 1 3\n",
            "line 7: a face with 6 corners goes on over",
        ),
        (PLAIN + "\0\0\0", "zero byte"),
        (f"OFF\n4 0 0\n{ROWS}", "4 vertices but no faces"),
        ("OFF\n0 0 0\n", "no vertices"),
        ("4OFF\n3 1 0\n0 0 0 1\n1 0 0 0\n0 1 0 1\n3 0 1 2\n", "vertex 1 lies at infinity"),
        ("nOFF\n4\n3 1 0\n0 0 0 0\n1 0 0 0\n0 1 0 0\n3 0 1 2\n", "not three-dimensional"),
        ("hello\n", "does not begin with 'OFF'; it begins with 'hello'"),
        ("OFFSET 4 2 0\n" + ROWS, "does not begin with 'OFF'"),
    ],
)
def test_refusals(tmp_path: Path, content: str | bytes, expected: str) -> None:
    text = refusal(tmp_path, "a.off", content)
    assert any(part in text for part in expected.split("|"))


COLOURS = [[0.5, 0.25, 0, 1]] * 4
ROUNDED = np.float32(SQUARE_VERTICES).astype(float).tolist()
FACES = [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(
    "content",
    [
        binary_off(SQUARE_VERTICES, FACES),
        b"# remark   \n# another\n" + binary_off(SQUARE_VERTICES, FACES),
        binary_off(SQUARE_VERTICES, FACES, colours=[[1, 0, 0], [1, 0, 0, 1]]),
        binary_off(SQUARE_VERTICES, FACES, "NOFF", more=[[0, 0, 1]] * 4),
        binary_off(SQUARE_VERTICES, FACES, "4OFF", more=[[1]] * 4),
        binary_off(SQUARE_VERTICES, FACES) + b"\n",
    ],
)
def test_the_same_square_in_binary_files(tmp_path: Path, content: bytes) -> None:
    mesh, _ = read(tmp_path, "a.off", content)
    assert mesh.vertices.tolist() == ROUNDED
    assert mesh.faces.tolist() == FACES


def test_attributes_of_binary_files(tmp_path: Path) -> None:
    more = np.concatenate([[[0, 0, 1]] * 4, COLOURS, [[0.25, 0.75]] * 4], axis=1)
    mesh, notes = read(tmp_path, "a.off", binary_off(SQUARE_VERTICES, [[0, 1, 2, 3]], "STCNOFF", more))
    assert mesh.vertex_attributes["color"].tolist() == COLOURS
    assert mesh.vertex_attributes["texture_v"].tolist() == [0.75] * 4
    assert "Split 1 polygon" in notes[1]


BINARY = binary_off(SQUARE_VERTICES, FACES)


def swapped(position: int, *numbers: int) -> bytes:
    replacement = struct.pack(f">{len(numbers)}i", *numbers)
    start = 11 + 4 * position
    return BINARY[:start] + replacement + BINARY[start + len(replacement) :]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (BINARY[:20], "ends before the numbers"),
        (BINARY[:-1], "byte 91: face 1 has 3 corners or a colour that are not possible"),
        (BINARY[:-30], "4 vertices and 2 faces are declared, but 70 bytes follow|face 0"),
        (swapped(0, 2**31 - 1), "2,147,483,647 vertices and 2 faces are declared"),
        (swapped(0, -1), "-1 vertices and 2 faces are declared"),
        (swapped(1, 3), "face 2 has -1 corners|are declared"),
        (swapped(1, 1), "bytes follow after the last face"),
        (swapped(15, 2**31 - 1), "face 0 has 2,147,483,647 corners"),
        (swapped(15, -3), "face 0 has -3 corners"),
        (swapped(17, 4), "byte 71: a face refers to vertex 4"),
        (swapped(19, 9), "face 0 has 3 corners or a colour"),
        (swapped(3, 0x7FC00000), "byte 23: vertex 0 has a value that is not finite"),
        (swapped(21, 0, 0, 0), "the last of them holds only zeros"),
        (BINARY + b"more than enough", "16 bytes follow after the last face"),
        (BINARY.replace(b"OFF", b"nOFF"), "of the kind 'nOFF'"),
    ],
)
def test_refusals_of_binary_files(tmp_path: Path, content: bytes, expected: str) -> None:
    text = refusal(tmp_path, "a.off", content)
    assert any(part in text for part in expected.split("|"))


def test_remarks_at_the_top_are_read_in_no_time(tmp_path: Path) -> None:
    start = time.perf_counter()
    assert read(tmp_path, "a.off", "#          \n" * 5000 + PLAIN)[0].n_faces == 2
    assert time.perf_counter() - start < 1
