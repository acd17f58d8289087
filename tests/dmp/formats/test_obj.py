"""Reading OBJ: every way of writing the same mesh gives the same mesh, and what is wrong is told with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dmp.formats.obj_writing import write_obj
from dmp.mesh import TriangleMesh
from tests.dmp.formats.files import TRIANGLE, read, refusal
from tests.meshes import grid_mesh

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    "content",
    [
        TRIANGLE + "f 1 2 3\n",
        TRIANGLE + "f 1 2 3",
        TRIANGLE + "f -3 -2 -1\n",
        TRIANGLE + "f 1/1 2/2 3/3\n",
        TRIANGLE + "f 1//1 2//1 3//1\n",
        TRIANGLE + "f 1/4/1 2/5/1 3/6/1\n",
        TRIANGLE + "f 1/1 2//2 3\n",
        TRIANGLE + "f -3/-1/-1 -2/-1/-1 -1/-1/-1\n",
        TRIANGLE + "fo 1 2 3\n",
        "f 1 2 3\n" + TRIANGLE,
        "v 0 0 0\nv 1 0 0\nv 0 1 0\n\n\ng part one\nusemtl x\ns off\nf 1 2 3\n# end\n",
        TRIANGLE.replace(" ", "\t") + "f\t1\t2\t3\n",
        TRIANGLE.replace(" ", "   ") + "  f 1 2 3   \n",
        TRIANGLE.replace("\n", "\r\n") + "f 1 2 3\r\n",
        TRIANGLE.replace("\n", "\r") + "f 1 2 3\r",
        TRIANGLE.replace("\n", " # a corner\n") + "f 1 2 3 # the face\n",
        TRIANGLE + "f 1 \\\n 2 \\\n3\n",
        TRIANGLE + "f 1 \\\r\n 2 3\r\n",
        "# C:\\scans\\\n" + TRIANGLE + "f 1 2 3\n",
        TRIANGLE.replace("0 0\n", "0 0 1.0\n") + "f 1 2 3\n",
        "v +0. -0 .0e5\nv 1E0 0 0\nv 0 10e-1 0\nf 1 2 3\n",
        "vt 0 0\nvn nan nan nan\n" + TRIANGLE + "f 1/1/1 2/1/1 3/1/1\n",
    ],
)
def test_the_same_triangle_in_every_spelling(tmp_path: Path, content: str) -> None:
    mesh, _ = read(tmp_path, "a.obj", content)
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32", "latin-1"])
def test_text_encodings(tmp_path: Path, encoding: str) -> None:
    mesh, _ = read(tmp_path, "a.obj", ("# Größe in Metern\n" + TRIANGLE + "o Öse\nf 1 2 3\n").encode(encoding))
    assert mesh.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("n_bytes", [3, 4, 7, 64, 1000])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
def test_the_borders_of_blocks_leave_no_trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, n_bytes: int, encoding: str, line_end: str
) -> None:
    monkeypatch.setattr("dmp.formats.text._BLOCK_BYTES", n_bytes)
    content = "# \N{GRINNING FACE}€\nv 0 0 0\nv 1 0 \\\n 0\n\nv 0 1 0\nf 1 2 \\\n\\\n3\nf 1 2 3 # \\\nv x 0 0\n"
    assert "line 11: 'x'" in refusal(tmp_path, "a.obj", content.replace("\n", line_end).encode(encoding))
    mesh, _ = read(tmp_path, "b.obj", content.replace("v x 0 0", "v 1 1 1").replace("\n", line_end).encode(encoding))
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 1, 2]]


def test_positions_keep_all_digits(tmp_path: Path) -> None:
    values = np.random.default_rng(1).standard_normal((30, 3)) * [1e-3, 1.0, 1e3]
    values[0] = [5e-324, 0.1 + 0.2, -1 / 3]
    lines = "".join("v " + " ".join(map(repr, row)) + "\n" for row in values.tolist())
    faces = "".join(f"f {i + 1} {i + 2} {i + 3}\n" for i in range(28))
    mesh, _ = read(tmp_path, "a.obj", lines + faces)
    np.testing.assert_array_equal(mesh.vertices, values)


def test_relative_indices_count_from_their_line(tmp_path: Path) -> None:
    first = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n"
    second = "v 0 0 5\nv 1 0 5\nv 0 1 5\nf -3 -2 -1\nf 1 -2 -1\n"
    mesh, _ = read(tmp_path, "a.obj", first + second)
    assert mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5], [0, 4, 5]]


def test_relative_indices_in_the_fast_and_the_slow_way_agree(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    lines = ["v 0 0 0", "v 1 0 0", "v 0 1 0"]
    n = 3
    for _ in range(300):
        if rng.random() < 0.5:
            lines.append("v {} {} {}".format(*rng.random(3).tolist()))
            n += 1
        else:
            lines.append("f {} {} {}".format(*(rng.choice(n, 3, replace=False) - n).tolist()))
    fast, _ = read(tmp_path, "fast.obj", "\n".join(lines) + "\n")
    slow, _ = read(tmp_path, "slow.obj", "\n".join(" " + line for line in lines) + "\n")
    np.testing.assert_array_equal(fast.faces, slow.faces)
    np.testing.assert_array_equal(fast.vertices, slow.vertices)


def test_several_objects_are_one_mesh(tmp_path: Path) -> None:
    mesh, _ = read(tmp_path, "a.obj", f"o one\n{TRIANGLE}f 1 2 3\no two\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf 4 5 6\n")
    assert (mesh.n_vertices, mesh.n_faces) == (6, 2)


def test_texture_seams_do_not_split_vertices(tmp_path: Path) -> None:
    mesh, notes = read(tmp_path, "a.obj", SQUARE + "vt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\nf 1/1 2/2 3/3\nf 1/4 3/1 4/2\n")
    assert mesh.n_vertices == 4
    assert notes == ("Texture coordinates and normals of the file were left out.",)


def test_colours_become_an_attribute(tmp_path: Path) -> None:
    content = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0.25 0.5 1\nf 1 2 3\n"
    mesh, notes = read(tmp_path, "a.obj", content)
    assert mesh.vertex_attributes["color"].tolist() == [[1, 0, 0], [0, 1, 0], [0.25, 0.5, 1]]
    assert notes == ()


def test_colours_of_a_part_of_the_vertices_are_left_out_with_a_note(tmp_path: Path) -> None:
    mesh, notes = read(tmp_path, "a.obj", "v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert not mesh.vertex_attributes
    assert "Colours were left out" in notes[0]


def test_weights_other_than_one_are_noted(tmp_path: Path) -> None:
    mesh, notes = read(tmp_path, "a.obj", "v 0 0 0 2\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert "weights" in notes[0]


def test_polygons_are_split_with_a_note(tmp_path: Path) -> None:
    mesh, notes = read(tmp_path, "a.obj", SQUARE + "f 1 2 3 4\n")
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert notes == ("Split 1 polygon with more than three corners into 2 triangles.",)


def test_degenerate_faces_and_loose_vertices_are_left_out_with_a_note(tmp_path: Path) -> None:
    mesh, notes = read(tmp_path, "a.obj", "v 7 7 7\n" + SQUARE + "f 2 3 4\nf 2 2 3\nf 2 4 5\nf 2 3 2\n")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert "2 degenerate faces" in notes[0]
    assert "1 of 5 vertices" in notes[1]


def test_lines_and_curves_are_left_out_with_a_note(tmp_path: Path) -> None:
    _, notes = read(tmp_path, "a.obj", TRIANGLE + "f 1 2 3\nl 1 2\np 3\ncurv 0 1 1 2\ncall other.obj\n")
    assert notes == (
        "Left out 2 line and point statements.",
        "Left out 1 statement on curves and surfaces.",
        "Left out 1 call of another file.",
    )


def test_a_missing_last_line_end_is_noted_only_where_it_may_hide_a_cut(tmp_path: Path) -> None:
    assert "cut off" in read(tmp_path, "a.obj", TRIANGLE + "f 1 2 3")[1][0]
    assert read(tmp_path, "a.obj", TRIANGLE + "f 1 2 3\n# end")[1] == ()


def test_other_files_are_not_opened(tmp_path: Path) -> None:
    import os

    os.mkfifo(tmp_path / "scene.mtl")  # reading it would wait for ever
    mesh, _ = read(tmp_path, "a.obj", "mtllib scene.mtl\n" + TRIANGLE + "usemtl scene\nf 1 2 3\n")
    assert mesh.n_faces == 1


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (TRIANGLE + "f 0 1 2\n", "line 4: a face refers to vertex 0"),
        (TRIANGLE + "f 1 2 4\n", "line 4: a face refers to vertex 4, but the file has vertices 1 to 3"),
        (TRIANGLE + "f 1 2 3\nf 1 2 99999999999999999999\n", "line 5: a face refers to vertex 9"),
        (TRIANGLE + "f -4 -2 -1\n", "line 4: a face refers to the vertex 4 before it"),
        (TRIANGLE + "f 1 2\n", "line 4: a face has 2 corners"),
        (TRIANGLE + "f 1 2 x\n", "line 4: 'x' is not the index"),
        (TRIANGLE + "f 1.0 2 3\n", "line 4: '1.0' is not the index"),
        (TRIANGLE + "f 1/a 2/b 3/c\n", "line 4: '1/a' is not a corner"),
        (TRIANGLE + "f /1 1 2 3\n", "line 4: '/1' is not a corner"),
        (TRIANGLE + "f 1/1/1/1 2 3\n", "line 4: '1/1/1/1' is not a corner"),
        ("v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", "line 2: a vertex has 2 values"),
        ("v 0 0 0\nv 1 0 0 0 0\nv 0 1 0\nf 1 2 3\n", "line 2: a vertex has 5 values"),
        ("v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "line 2: 'nan' is not a finite number"),
        ("v 0 0 0\nv 1 0 -Infinity\nv 0 1 0\nf 1 2 3\n", "line 2: '-Infinity' is not a finite number"),
        ("v 0 0 0\nv 1 0 -1.#IND\nv 0 1 0\nf 1 2 3\n", "line 2: '-1.#IND' is not a finite number"),
        ("v 0 0 0\nv 1 0 1e999\nv 0 1 0\nf 1 2 3\n", "line 2: the number '1e999' is too large"),
        ("v 0 0 0\nv 1,5 0 0\nv 0 1 0\nf 1 2 3\n", "line 2: the number '1,5' has a decimal comma"),
        ("v 0 0 0\nv 1.5.2 0 0\nv 0 1 0\nf 1 2 3\n", "line 2: '1.5.2' is not a number"),
        ("v 0 0 0\nv 1_0 0 0\nv 0 1 0\nf 1 2 3\n", "line 2: '1_0' is not a number"),
        ("v 0 0 0\nv 0x10 0 0\nv 0 1 0\nf 1 2 3\n", "line 2: '0x10' is not a number"),
        ("v 0 0 0\nv 1 zero 0\nv 0 1 0\nf 1 2 3\n", "line 2: 'zero' is not a number"),
        (TRIANGLE + "f 1 2 3\nw 0 0 0\n", "line 5: 'w' does not begin any OBJ statement"),
        (TRIANGLE + "V 1 2 3\nf 1 2 3\n", "line 4: 'V' does not begin any OBJ statement"),
        (TRIANGLE + "f 1 2 3\n\0\0\0\0", "zero byte at byte 32"),
        (TRIANGLE, "3 vertices but no faces"),
        (TRIANGLE + "l 1 2\n", "1 line or point statement but no faces"),
        ("# nothing\n", "no vertices"),
        ("v 0 0 0 \\\n\\\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1: 'v' is not a number"),
    ],
)
def test_refusals_name_the_line(tmp_path: Path, content: str, expected: str) -> None:
    assert expected in refusal(tmp_path, "a.obj", content)
    # The same with an indented line before it, which takes the slow way.
    if expected.startswith("line "):
        line = int(expected.removeprefix("line ").partition(":")[0])
        assert f"line {line + 1}:" in refusal(tmp_path, "b.obj", "  g indented\n" + content)


def test_a_file_shorter_than_its_own_comment_tells_is_refused(tmp_path: Path) -> None:
    content = b"".join(write_obj(grid_mesh(10, 0.1)))
    cut = content[: content.rindex(b"f ")]
    assert "162 faces, but the file holds 161" in refusal(tmp_path, "a.obj", cut)


def test_a_comment_may_count_the_triangles_of_polygons(tmp_path: Path) -> None:
    assert read(tmp_path, "a.obj", "# Vertices: 4\n# Faces: 2\n" + SQUARE + "f 1 2 3 4\n")[0].n_faces == 2


def test_lines_keep_their_numbers_in_large_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dmp.formats.text._BLOCK_BYTES", 10_000)
    lines = b"".join(write_obj(grid_mesh(50, 0.3))).split(b"\n")
    lines[5003] = b"f 1 2 many"
    assert "line 5004: 'many'" in refusal(tmp_path, "a.obj", b"\n".join(lines))


def test_the_slow_way_gives_the_same_mesh(tmp_path: Path) -> None:
    expected = grid_mesh(40, 0.3)
    plain = b"".join(write_obj(expected))
    odd = plain.replace(b"\n", b" \\\n\n").replace(b"f 1 2 42", b"\tf 1/1 2/2 42/3", 1)
    mesh, _ = read(tmp_path, "a.obj", odd)
    np.testing.assert_array_equal(mesh.vertices, expected.vertices)
    np.testing.assert_array_equal(mesh.faces, expected.faces)


def test_whole_number_colours_are_written_as_fractions(tmp_path: Path) -> None:
    colours = np.array([[0, 51, 255]] * 3, dtype=np.uint8)
    mesh = TriangleMesh(np.eye(3), np.array([[0, 1, 2]]), {"color": colours})
    read_back, _ = read(tmp_path, "a.obj", b"".join(write_obj(mesh)))
    np.testing.assert_allclose(read_back.vertex_attributes["color"], colours / 255, rtol=0, atol=0)
