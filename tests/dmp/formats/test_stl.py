"""Reading and writing STL: corners are joined on exact equality, sizes are checked, cut files are refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from dmp.formats.stl import weld, write_stl
from tests.dmp.formats.files import binary_stl, read, refusal, text_stl
from tests.meshes import grid_mesh, sphere_mesh

# Two triangles of a square; 0.1 is not a single-precision number.
SOUP = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0.1]], [[-0.0, 0, 0], [1, 1, 0.1], [0, 1, 0]]])
TEXT = text_stl(SOUP)
ONE_FACET = "facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet"


@pytest.mark.parametrize(
    "content",
    [
        TEXT,
        TEXT.upper().replace("E", "e").replace("e", "E"),
        TEXT.replace("\n", "\r\n"),
        TEXT.replace("\n", "\r"),
        TEXT.replace("      vertex", "vertex").replace(" ", "\t"),
        TEXT.replace("0 0 1\n", "nan -nan(ind) 1.#QNAN\n"),
        TEXT.replace("solid part", "solid"),
        TEXT.replace("part", "Größe facet"),
        TEXT.replace("outer loop\n", "outer\nloop\n"),
        TEXT.replace("\n", "\n\n"),
        TEXT.replace("    endloop\n  endfacet\n", "endloop endfacet "),
        "\n\n" + TEXT,
        TEXT.encode("utf-16"),
        text_stl(SOUP[:1]) + text_stl(SOUP[1:], "second"),
        f"solid a b c\n{TEXT.split(chr(10), 1)[1].replace(chr(10), ' ')}",
    ],
)
def test_the_same_square_in_every_spelling_of_text(tmp_path: Path, content: str | bytes) -> None:
    mesh, notes = read(tmp_path, "a.stl", content)
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert notes == ("Joined 6 corners with equal coordinates into 4 vertices.",)


@pytest.mark.parametrize(
    "header", [b"by hand", b"solid from a CAD program", b"solid\nfacet", bytes(80), b"\xff" * 80, b"OFF 1 2 3", b"ply\n"]
)
def test_binary_files_with_any_header(tmp_path: Path, header: bytes) -> None:
    mesh, notes = read(tmp_path, "a.stl", binary_stl(SOUP, header))
    np.testing.assert_array_equal(mesh.vertices, np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]]).astype(float))
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert notes == ("Joined 6 corners with equal coordinates into 4 vertices.",)


def test_welding_agrees_with_sorting_rows(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for dtype in (np.float32, np.float64):
        soup = rng.integers(-3, 3, (500, 3, 3)).astype(dtype) * dtype(0.1)
        found = weld(soup, str, [])
        corners = soup.reshape(-1, 3)
        np.testing.assert_array_equal(found.vertices[found.corners], corners)
        assert len(found.vertices) == len(np.unique(corners + 0, axis=0))
        # In the order of their first appearance.
        first_seen = [int(np.flatnonzero(found.corners == vertex)[0]) for vertex in range(len(found.vertices))]
        assert first_seen == sorted(first_seen)


def test_welding_survives_equal_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    soup = rng.integers(0, 4, (200, 3, 3)).astype(np.float64)
    expected = weld(soup, str, [])
    monkeypatch.setattr("dmp.formats.weld._MIXER", np.uint64(0))
    found = weld(soup, str, [])
    np.testing.assert_array_equal(found.vertices, expected.vertices)
    np.testing.assert_array_equal(found.corners, expected.corners)


def test_a_large_text_file_equals_the_binary_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dmp.formats.text._BLOCK_BYTES", 100_000)
    mesh = grid_mesh(50, 0.2)
    soup = mesh.vertices[mesh.faces].astype(np.float32)
    text = text_stl(soup.astype(np.float64))
    from_text, _ = read(tmp_path, "a.stl", text)
    from_binary, _ = read(tmp_path, "b.stl", binary_stl(soup))
    np.testing.assert_array_equal(from_text.vertices, from_binary.vertices)
    np.testing.assert_array_equal(from_text.faces, from_binary.faces)
    lines = text.split("\n")
    lines[7 * 3000 + 4] = "vertex 1 2 3.4.5"
    assert f"line {7 * 3000 + 5}: '3.4.5' is not a number" in refusal(tmp_path, "c.stl", "\n".join(lines))


def test_triangles_that_weld_to_a_line_are_left_out(tmp_path: Path) -> None:
    soup = np.concatenate([SOUP, [[[0, 0, 0], [1, 0, 0], [1, 0, 0]]]])
    mesh, notes = read(tmp_path, "a.stl", binary_stl(soup))
    assert mesh.n_faces == 2
    assert notes[1] == "Left out 1 degenerate face with fewer than three different vertices."


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (TEXT[: TEXT.index("endsolid")], "ends without 'endsolid' after line 15"),
        (TEXT[: len(TEXT) // 2], "ends without 'endsolid' after line 9"),
        (TEXT[: TEXT.index("vertex 1.0 1.0") + 8], "ends inside a triangle after line 6"),
        ("solid nothing\nendsolid\n", "no triangles"),
        ("solid", "ends without 'endsolid'"),
        (TEXT.rpartition("endfacet")[0] + "e\n", "'e' stands where 'endfacet' is expected"),
        (TEXT + "endsolid\n", "line 17: 'endsolid' is out of place"),
        (TEXT.replace("endsolid part", "solid part"), "line 16: 'solid' is out of place"),
        (TEXT + ONE_FACET, "line 17: a triangle stands outside"),
        (TEXT.replace("endloop", "vertex 0 0 0\nendloop", 1), "line 7: a facet has more than three corners"),
        (TEXT.replace("      vertex 1.0 0.0 0.0\n", "", 1), "line 6: 'endloop' stands where 'vertex' is expected"),
        (TEXT.replace("outer loop", "outer lop", 1), "line 3: 'lop' stands where 'loop' is expected"),
        (TEXT.replace("vertex 1.0 0.0 0.0", "vertex 1.0 0.0", 1), "line 6: 'vertex' is not a number"),
        (TEXT.replace("vertex 1.0 0.0 0.0", "vertex 1.0 0.0 0.0 0.0", 1), "line 5: '0.0' stands where 'vertex'"),
        (TEXT.replace("vertex 1.0 0.0 0.0", "vertex 1.0 nan 0.0", 1), "line 5: 'nan' is not a finite number"),
        (TEXT.replace("vertex 1.0 0.0 0.0", "vertex 1,0 0.0 0.0", 1), "line 5: the number '1,0' has a decimal comma"),
        (TEXT.replace("vertex 1.0 0.0 0.0", "vertex 1e999 0.0 0.0", 1), "line 5: the number '1e999' is too large"),
        (TEXT.replace("endsolid", "\0\0\0"), "zero byte at byte"),
    ],
)
def test_refusals_of_text(tmp_path: Path, content: str, expected: str) -> None:
    text = refusal(tmp_path, "a.stl", content)
    assert any(part in text for part in expected.split("|"))


BINARY = binary_stl(SOUP)


def with_count(count: int) -> bytes:
    return BINARY[:80] + struct.pack("<I", count) + BINARY[84:]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (BINARY[:-1], "declares 2 triangles, so 184 bytes, but the file has 183"),
        (BINARY[:100], "declares 2 triangles, so 184 bytes, but the file has 100"),
        (BINARY[:84], "declares 2 triangles, so 184 bytes, but the file has 84"),
        (b"\0" + BINARY[1:50], "50 bytes, fewer than the 84"),
        (with_count(3), "declares 3 triangles, so 234 bytes"),
        (with_count(1), "byte 134: 50 bytes follow"),
        (with_count(0), "holds no triangles"),
        (with_count(2**32 - 1), "declares 4,294,967,295 triangles"),
        (BINARY[:96] + struct.pack("<f", np.nan) + BINARY[100:], "byte 84: triangle 0 has a coordinate"),
        (BINARY[:150] + struct.pack("<f", np.inf) + BINARY[154:], "byte 134: triangle 1 has a coordinate"),
        (BINARY[:134] + bytes(50), "from byte 134 on there are only zeros"),
        (BINARY[:84] + bytes(100), "from byte 84 on there are only zeros"),
        (BINARY + b"\1" * 50, "byte 184: 50 bytes follow"),
    ],
)
def test_refusals_of_binary_files(tmp_path: Path, content: bytes, expected: str) -> None:
    assert expected in refusal(tmp_path, "a.stl", content)


def test_bytes_after_the_end_that_hold_no_triangle_are_noted(tmp_path: Path) -> None:
    assert read(tmp_path, "a.stl", BINARY + b"\r\n")[1][0] == "Ignored 2 bytes after the end of the mesh."
    assert read(tmp_path, "b.stl", BINARY + bytes(1000))[1][0] == "Ignored 1,000 bytes after the end of the mesh."


def test_written_files_have_unit_normals_and_single_precision_corners() -> None:
    mesh = sphere_mesh(1)
    content = b"".join(write_stl(mesh))
    assert not content.lower().startswith(b"solid")
    assert len(content) == 84 + 50 * mesh.n_faces
    values = np.array([struct.unpack("<12f", content[84 + 50 * face : 132 + 50 * face]) for face in range(mesh.n_faces)])
    np.testing.assert_array_equal(values[:, 3:].reshape(-1, 3, 3), mesh.vertices[mesh.faces].astype(np.float32))
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    np.testing.assert_allclose(np.linalg.norm(values[:, :3], axis=1), 1, atol=1e-6)
    assert ((values[:, :3] * centres).sum(axis=1) > 0.8).all()


def test_a_written_mesh_comes_back_with_its_single_precision_positions(tmp_path: Path) -> None:
    mesh = sphere_mesh(2)
    mesh = mesh.with_vertices(mesh.vertices + np.array([0.1, 5, -3]))
    read_back, _ = read(tmp_path, "a.stl", b"".join(write_stl(mesh)))
    assert read_back.n_vertices == mesh.n_vertices
    np.testing.assert_array_equal(
        read_back.vertices[read_back.faces], mesh.vertices[mesh.faces].astype(np.float32).astype(np.float64)
    )


def with_normals(count: int) -> bytes:
    """A sphere of 128 triangles, ``count`` of which have a normal of another one."""
    content = bytearray(b"".join(write_stl(sphere_mesh(2))))
    for facet in range(count):
        content[84 + 50 * facet : 96 + 50 * facet] = struct.pack("<3f", 0, 0, -1) if facet < 64 else struct.pack("<3f", 0, 0, 1)
    return bytes(content)


def test_a_few_normals_that_do_not_fit_are_noted(tmp_path: Path) -> None:
    assert read(tmp_path, "a.stl", with_normals(0))[1] == ("Joined 384 corners with equal coordinates into 66 vertices.",)
    note = read(tmp_path, "b.stl", with_normals(3))[1][0]
    assert note.startswith("The normals of 3 of 128 triangles do not fit to their corners, the first at byte 84;")
    # A program that writes any normals tells nothing.
    assert len(read(tmp_path, "c.stl", with_normals(128))[1]) == 1
    assert len(read(tmp_path, "d.stl", binary_stl(sphere_mesh(2).vertices[sphere_mesh(2).faces]))[1]) == 1


def test_bytes_that_were_added_in_the_middle_are_found(tmp_path: Path) -> None:
    content = with_normals(0)
    for position in (90, 1000, 6000):
        for added in (b"\0", b"\r", bytes(2), b"\xef\xbb\xbf", bytes(7)):
            text = refusal(tmp_path, "a.stl", content[:position] + added + content[position:])
            assert "added or lost on the way" in text or "follow after the 128" in text or "not a finite number" in text
