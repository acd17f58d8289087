"""The front of reading: which files are opened at all, how the format is told, what is refused in every format."""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from dmp.errors import MeshFileError
from dmp.formats.names import NAMES
from dmp.formats.source import SourceFile
from dmp.mesh import TriangleMesh
from dmp.meshio import READABLE_SUFFIXES, read_mesh, read_mesh_with_notes, write_mesh
from tests.dmp.formats.files import SQUARE_VERTICES, binary_stl, ply_header, read, refusal, square
from tests.dmp.formats.samples import ALL_SAMPLES, SAMPLES, content_of
from tests.meshes import grid_mesh, sphere_mesh

# ------------------------------------------------------------------------------------------------------ what is opened


def refused(path: Path | str) -> str:
    start = time.perf_counter()
    with pytest.raises(MeshFileError) as caught:
        read_mesh(path)
    assert time.perf_counter() - start < 2
    assert caught.value.remedy.endswith(".")
    return str(caught.value)


def test_folders_pipes_devices_sockets_and_links_are_never_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder.obj").mkdir()
    os.mkfifo(tmp_path / "pipe.ply")
    (tmp_path / "endless.stl").symlink_to("/dev/zero")
    (tmp_path / "waiting.off").symlink_to("pipe.ply")
    (tmp_path / "nothing.obj").symlink_to("missing.obj")
    (tmp_path / "circle.obj").symlink_to("circle.obj")
    monkeypatch.chdir(tmp_path)  # names of sockets must be short
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket.obj")
        with monkeypatch.context() as patch:
            patch.setattr(os, "open", None)
            assert "this is a folder" in refused(tmp_path / "folder.obj")
            assert "this is a pipe" in refused(tmp_path / "pipe.ply")
            assert "this is a device" in refused(tmp_path / "endless.stl")
            assert "this is a pipe" in refused(tmp_path / "waiting.off")
            assert "this is a socket" in refused("socket.obj")
            assert "a link to a file that does not exist" in refused(tmp_path / "nothing.obj")
            assert "leads in a circle" in refused(tmp_path / "circle.obj")
            assert "there is no such file" in refused(tmp_path / "missing.obj")
            assert "name is too long" in refused(tmp_path / ("a" * 300 + ".obj"))
            assert "a part of its path is a file" in refused(Path(__file__) / "a.obj")
            assert "no file name can hold" in refused("a\0b.obj")


def test_a_pipe_that_takes_the_place_of_a_file_at_the_last_moment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.obj"
    path.write_bytes(SAMPLES["written.obj"])
    real_open = os.open

    def swap_and_open(name: Path, flags: int) -> int:
        path.unlink()
        os.mkfifo(path)
        return real_open(name, flags)

    monkeypatch.setattr(os, "open", swap_and_open)
    assert "this is a pipe" in refused(path)


def test_a_file_that_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.obj"
    path.write_bytes(SAMPLES["written.obj"])

    def deny(name: Path, flags: int) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", deny)
    assert "there is no permission" in refused(path)


def test_links_to_files_are_followed(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(SAMPLES["written.ply"])
    (tmp_path / "link.ply").symlink_to("a.ply")
    assert read_mesh(tmp_path / "link.ply").n_vertices == sphere_mesh(1).n_vertices


@pytest.mark.parametrize("suffix", READABLE_SUFFIXES)
def test_empty_and_blank_files(tmp_path: Path, suffix: str) -> None:
    assert "the file is empty (0 bytes)" in refusal(tmp_path, f"empty{suffix}", "")
    refusal(tmp_path, f"blank{suffix}", " \n\t\r\n")
    refusal(tmp_path, f"remarks{suffix}", "# nothing\n# here\n")
    assert "zeros, so it was never written" in refusal(tmp_path, f"zeros{suffix}", bytes(100_000))
    refusal(tmp_path, f"noise{suffix}", np.random.default_rng(0).bytes(100_000))


@pytest.mark.parametrize("suffix", [*READABLE_SUFFIXES, ".txt", ""])
@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"<!DOCTYPE html><html><body>404</body></html>", "a web page"),
        (b"\n<html>", "a web page"),
        (b"<?xml version='1.0'?><COLLADA/>", "an XML file"),
        (b"<VTKFile type='UnstructuredGrid'/>", "no PolyData"),
        (b"# vtk DataFile Version 3.0\n", "those of a VTK file"),
        (b'{"asset": {"version": "2.0"}}', "holds no meshes"),
        (b'{"name": "settings"}', "JSON file, but no glTF|version missing"),
        (b"[1, 2]", "a JSON file"),
        (b"glTF\x02\0\0\0\x10\0\0\0", "the GLB file ends"),
        (b"PK\x03\x04\x14\0\0\0", "no valid list of its parts"),
        (b"\x1f\x8b\x08\0\0\0", "a gzip archive"),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "a picture"),
        (b"Kaydara FBX Binary  \0\x1a\0", "an FBX file"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull"),
        (b"# material\nnewmtl red\nKd 1 0 0\n", "a material library"),
    ],
)
def test_other_content_is_named(tmp_path: Path, suffix: str, content: bytes, expected: str) -> None:
    text = refusal(tmp_path, f"file{suffix}", content)
    assert any(part in text for part in expected.split("|"))


@pytest.mark.parametrize("name", SAMPLES)
@pytest.mark.parametrize("wrong", [".obj", ".PLY", ".stl", ".off", ".glb", ""])
def test_the_content_wins_over_the_extension(tmp_path: Path, name: str, wrong: str) -> None:
    mesh, notes = read(tmp_path, name, SAMPLES[name])
    other, other_notes = read(tmp_path, f"Größe (1){wrong}", SAMPLES[name])
    np.testing.assert_array_equal(other.vertices, mesh.vertices)
    np.testing.assert_array_equal(other.faces, mesh.faces)
    if Path(name).suffix != wrong.lower():
        kind = {"gltf": "glTF"}.get(Path(name).suffix[1:], Path(name).suffix[1:].upper())
        assert f"content is {kind}" in other_notes[0]
        assert other_notes[1:] == notes
    else:
        assert other_notes == notes


def test_names_that_are_no_text_can_be_told(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path / "a.") + b"\xff\x1b[31m"))
    path.write_bytes(SAMPLES["written.ply"])
    _, notes = read_mesh_with_notes(path)
    assert notes[0].encode() == "The content is PLY, although the name ends in '.?\N{REPLACEMENT CHARACTER}[31m'.".encode()


def test_capital_extensions_need_no_note(tmp_path: Path) -> None:
    assert read(tmp_path, "A.PLY", SAMPLES["written.ply"])[1] == ()


def test_an_unknown_text_names_what_can_be_read(tmp_path: Path) -> None:
    text = refusal(tmp_path, "a.txt", "Dear reader,\n")
    assert "OBJ, PLY, STL, OFF, GLB, glTF, 3MF, VTP and VTK files can be read" in text
    assert {f".{name.lower()}" for name in NAMES.values()} == set(READABLE_SUFFIXES)
    assert all(suffix[1:] in text.lower() for suffix in READABLE_SUFFIXES)


# ------------------------------------------------------------------------------------------------- what changes or ends


@pytest.mark.parametrize("name", SAMPLES)
def test_files_that_change_while_they_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(SAMPLES[name])
    seek = SourceFile.seek

    def change_and_seek(source: SourceFile, position: int) -> None:
        with path.open("ab") as file:
            file.write(b"\n")
        seek(source, position)

    monkeypatch.setattr(SourceFile, "seek", change_and_seek)
    assert "changed while it was being read" in refused(path)


@pytest.mark.parametrize("name", SAMPLES)
def test_files_that_change_within_one_tick_of_the_clock_of_their_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    path = tmp_path / name
    path.write_bytes(SAMPLES[name])
    times = path.stat().st_atime_ns, path.stat().st_mtime_ns
    seek = SourceFile.seek

    def change_and_seek(source: SourceFile, position: int) -> None:
        with path.open("r+b") as file:
            file.seek(len(SAMPLES[name]) // 2)
            file.write(bytes([SAMPLES[name][len(SAMPLES[name]) // 2] ^ 1]))
        os.utime(path, ns=times)
        seek(source, position)

    monkeypatch.setattr(SourceFile, "seek", change_and_seek)
    assert "changed while it was being read" in refused(path)
    assert path.stat().st_mtime_ns == times[1]


@pytest.mark.parametrize("name", ["written.ply", "written.stl"])
def test_files_that_become_shorter_while_they_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(SAMPLES[name])
    read_exactly = SourceFile.read_exactly

    def cut_and_read(source: SourceFile, n_bytes: int) -> bytearray:
        os.truncate(path, len(SAMPLES[name]) // 2)
        return read_exactly(source, n_bytes)

    monkeypatch.setattr(SourceFile, "read_exactly", cut_and_read)
    assert "changed while it was being read" in refused(path)


def test_a_file_that_is_replaced_meanwhile_is_read_as_it_was(tmp_path: Path) -> None:
    path, other = tmp_path / "a.ply", tmp_path / "b.ply"
    stop = threading.Event()
    meshes = [grid_mesh(10, 0.1, seed) for seed in range(2)]

    def keep_replacing() -> None:
        turn = 0
        while not stop.is_set():
            other.write_bytes(content_of(".ply", meshes[turn % 2]))
            other.replace(path)
            turn += 1

    path.write_bytes(content_of(".ply", meshes[0]))
    thread = threading.Thread(target=keep_replacing)
    thread.start()
    try:
        for _ in range(100):
            vertices = read_mesh(path).vertices
            assert any(np.array_equal(vertices, mesh.vertices) for mesh in meshes)
    finally:
        stop.set()
        thread.join()


@pytest.mark.parametrize("name", ALL_SAMPLES)
def test_every_cut_is_refused_or_noted_or_harmless(tmp_path: Path, name: str) -> None:
    content = ALL_SAMPLES[name]
    whole, _ = read(tmp_path, name, content)
    lengths = sorted({*range(0, len(content), 1 + len(content) // 60), *range(len(content) - 30, len(content))})
    for length in lengths:
        if name == "rich.obj" and content[length - 1 : length] == b"\n":
            continue  # an OBJ file may end after any line
        if content[length : length + 15] == b"TRIANGLE_STRIPS":
            continue  # a legacy VTK file may end after any section
        try:
            mesh, notes = read(tmp_path, name, content[:length])
        except MeshFileError:
            continue
        same = np.array_equal(mesh.vertices, whole.vertices) and np.array_equal(mesh.faces, whole.faces)
        assert same or any("cut off" in note for note in notes), length


@pytest.mark.parametrize("name", ALL_SAMPLES)
def test_every_tail_of_zeros_is_refused(tmp_path: Path, name: str) -> None:
    content = ALL_SAMPLES[name]
    smallest = 1 if name.startswith("text") or name in ("written.obj", "written.off") else 64
    for n_zeros in {*range(smallest, len(content), 1 + len(content) // 40), len(content)}:
        refusal(tmp_path, name, content[: len(content) - n_zeros] + bytes(n_zeros))


# ------------------------------------------------------------------------------------------ what is absurd in any format


def mesh_with(scale: float, offset: float) -> TriangleMesh:
    mesh = sphere_mesh(1)
    return mesh.with_vertices(mesh.vertices * scale + offset)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".off", ".vtp"])
@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        (mesh_with(1e300, 0), "the coordinates are absurd: they reach 1e+300"),
        (mesh_with(1e308, 0), "the coordinates are absurd"),
        (mesh_with(1e13, 0), "the coordinates are absurd: they reach 1e+13"),
        (mesh_with(1e-30, 0), "only 3.46e-30 units large|units large"),
        (mesh_with(1e-200, 0), "units large"),
        (mesh_with(1, 1e15), "units away from the origin, where even double precision cannot hold its shape"),
        (mesh_with(0, 7), "all vertices lie in one point"),
        (TriangleMesh(np.eye(3), [[0, 0, 0], [1, 1, 2]]), "no face has three different corners"),
        (TriangleMesh(np.outer(np.arange(4.0), [1, 2, 3]), [[0, 1, 2], [1, 2, 3]]), "2 of 2 faces have no area"),
        (TriangleMesh(np.eye(3), np.zeros((0, 3), dtype=int)), "3 vertices but no faces"),
    ],
)
def test_absurd_meshes_are_refused(tmp_path: Path, suffix: str, mesh: TriangleMesh, expected: str) -> None:
    text = refusal(tmp_path, f"a{suffix}", content_of(suffix, mesh))
    assert any(part in text for part in expected.split("|"))


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".off", ".vtp"])
@pytest.mark.parametrize(("scale", "offset"), [(1.0, 1e7), (1e-6, 0.0), (1e-6, 1.0), (1e9, -3e9), (1e-9, 0.0)])
def test_unusual_scales_and_places_are_exact(tmp_path: Path, suffix: str, scale: float, offset: float) -> None:
    mesh = mesh_with(scale, offset)
    read_back, notes = read(tmp_path, f"a{suffix}", content_of(suffix, mesh))
    np.testing.assert_array_equal(read_back.vertices, mesh.vertices)
    np.testing.assert_array_equal(read_back.faces, mesh.faces)
    assert notes == ()


def test_some_flat_faces_are_noted(tmp_path: Path) -> None:
    mesh = grid_mesh(5)
    flat = TriangleMesh(mesh.vertices, np.concatenate([mesh.faces, [[0, 1, 2]]]))
    read_back, notes = read(tmp_path, "a.ply", content_of(".ply", flat))
    assert read_back.n_faces == mesh.n_faces + 1
    assert notes == ("1 of 33 faces have no area.",)


def test_memory_that_does_not_suffice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def exhaust(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("dmp.meshio.assemble", exhaust)
    path = tmp_path / "a.ply"
    path.write_bytes(SAMPLES["written.ply"])
    assert "not enough memory" in refused(path)


def test_a_fault_of_a_reader_is_told_as_an_unreadable_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RecursionError("too deep")

    monkeypatch.setattr("dmp.meshio.assemble", fail)
    path = tmp_path / "a.ply"
    path.write_bytes(SAMPLES["written.ply"])
    assert "the file cannot be read (RecursionError: too deep)" in refused(path)


# ----------------------------------------------------------------------------------------------- small files, large harm


def sparse(path: Path, head: bytes, size: int) -> Path:
    path.write_bytes(head)
    os.truncate(path, size)
    return path


def test_sparse_files_of_gigabytes_are_refused_at_once(tmp_path: Path) -> None:
    size = 84 + 50 * 70_000_000
    assert "zero bytes follow" in refused(sparse(tmp_path / "a.stl", b"x" * 80 + struct.pack("<I", 70_000_000), size))
    header = ply_header("binary_little_endian", 100_000_000, 80_000_000).encode()
    assert "zero bytes follow" in refused(sparse(tmp_path / "a.ply", header, len(header) + 3_500_000_000))
    assert "zero byte at byte 4" in refused(sparse(tmp_path / "a.off", b"OFF\n", 3_500_000_000))
    assert "zero byte at byte 8" in refused(sparse(tmp_path / "a.obj", b"v 0 0 0\n", 3_500_000_000))
    assert "at most 4,000,000,000" in refused(sparse(tmp_path / "b.obj", b"v 0 0 0\n", 5_000_000_000))


TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("continued.obj", TRIANGLE + b"\\\n" * 500_000),
        ("continued_numbers.obj", TRIANGLE + b"f 1 2 3" + b" \\\n1" * 300_000),
        ("groups.obj", TRIANGLE + b"g a\nf 1 2 3\n" * 200_000),
        ("objects.obj", b"".join(b"o part%d\n" % i for i in range(200_000)) + TRIANGLE),
        ("remarks.obj", TRIANGLE + b"#\n" * 1_000_000),
        ("blank.obj", TRIANGLE + b"\n" * 2_000_000),
        ("long_line.obj", TRIANGLE + b"f" + b" 1 2 3" * 300_000 + b"\n"),
        ("long_word.obj", TRIANGLE + b"v " + b"1" * 2_000_000 + b" 0 0\n"),
        ("long_index.obj", TRIANGLE + b"f 1 2 " + b"9" * 2_000_000 + b"\n"),
        ("slashes.obj", TRIANGLE + b"f " + b"/" * 2_000_000 + b"\n"),
        ("colours_now_and_then.obj", TRIANGLE + b" v 0 0 0 1 1 1\n v 0 0 0\n" * 100_000),
        ("long_header.ply", b"ply\nformat ascii 1.0\n" + b"comment x\n" * 300_000),
        ("no_header_end.ply", b"ply\n" + b"c" * 3_000_000),
        ("many_lists.ply", ply_header("binary_little_endian", 0, 2_000_000).encode() + bytes(2_000_000)),
        ("one_line.off", b"OFF 3 1 0 " + b"0 " * 1_000_000),
        ("no_faces.off", b"OFF\n3 500000 0\n0 0 0\n1 0 0\n0 1 0\n" + b"0\n" * 500_000),
        ("words.stl", b"solid x\n" + b"facet\n" * 500_000),
        ("solids.stl", b"solid\nendsolid\n" * 200_000),
    ],
)
def test_small_hostile_files_take_seconds_at_most(tmp_path: Path, name: str, content: bytes) -> None:
    start = time.perf_counter()
    try:
        mesh, _ = read(tmp_path, name, content)
        assert mesh.n_faces >= 1
    except MeshFileError as error:
        assert "cannot be read (" not in str(error)
    assert time.perf_counter() - start < 5


# ------------------------------------------------------------------------------------------------------------ round trips


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".off", ".vtp"])
def test_written_files_come_back_bit_for_bit(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(7)
    mesh = grid_mesh(20, 0.3)
    mesh = mesh.with_vertices(mesh.vertices + rng.standard_normal(mesh.vertices.shape) * 1e-3 + np.pi)
    path = tmp_path / f"a{suffix}"
    write_mesh(path, mesh)
    read_back, notes = read_mesh_with_notes(path)
    np.testing.assert_array_equal(read_back.vertices, mesh.vertices)
    np.testing.assert_array_equal(read_back.faces, mesh.faces)
    assert notes == ()
    # Writing what was read gives the same bytes.
    write_mesh(tmp_path / f"b{suffix}", read_back)
    assert (tmp_path / f"b{suffix}").read_bytes() == path.read_bytes()


def test_other_programs_read_what_is_written(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    mesh = sphere_mesh(2)
    for suffix, tolerance in ((".obj", 1e-15), (".ply", 1e-15), (".off", 1e-15), (".stl", 1e-7)):
        path = tmp_path / f"a{suffix}"
        write_mesh(path, mesh)
        other = trimesh.load(path, process=False)
        np.testing.assert_allclose(
            np.asarray(other.vertices)[np.asarray(other.faces)], mesh.vertices[mesh.faces], rtol=0, atol=tolerance
        )


def test_vtk_reads_what_is_written_and_we_read_what_it_writes(tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    mesh = sphere_mesh(2).with_attributes(quality=np.linspace(0, 1, 66), color=np.full((66, 3), 7, dtype=np.uint8))
    write_mesh(tmp_path / "a.vtp", mesh)
    other = pyvista.read(tmp_path / "a.vtp")
    np.testing.assert_array_equal(other.points, mesh.vertices)
    np.testing.assert_array_equal(other.regular_faces, mesh.faces)
    for name, values in mesh.vertex_attributes.items():
        np.testing.assert_array_equal(other.point_data[name], values)
    for name, binary in (("b.vtp", True), ("c.vtp", False), ("d.vtk", True), ("e.vtk", False)):
        other.save(tmp_path / name, binary=binary)
        read_back = read_mesh(tmp_path / name)
        # As a text, VTK writes fewer digits.
        np.testing.assert_allclose(read_back.vertices, mesh.vertices, rtol=0, atol=0 if binary else 1e-5)
        np.testing.assert_array_equal(read_back.faces, mesh.faces)
    assert set(read_mesh(tmp_path / "b.vtp").vertex_attributes) == set(mesh.vertex_attributes)
    other.strip().save(tmp_path / "f.vtp")
    stripped = read_mesh(tmp_path / "f.vtp")
    normals = np.cross(*(stripped.vertices[stripped.faces[:, k]] - stripped.vertices[stripped.faces[:, 0]] for k in (1, 2)))
    assert stripped.n_faces == mesh.n_faces
    assert ((normals * stripped.vertices[stripped.faces].mean(axis=1)).sum(axis=1) > 0).all()


def test_nothing_but_the_chosen_file_is_opened(tmp_path: Path) -> None:
    code = """
        import sys, pathlib
        sys.path.insert(0, sys.argv[2])
        from tests.dmp.formats.broken_files import broken_files
        from dmp.errors import MeshFileError
        from dmp.meshio import read_mesh
        folder = pathlib.Path(sys.argv[1])
        files = [file for file in broken_files() if len(file[1]) < 100_000]
        files = [file for number, file in enumerate(files) if number % 4 == 0 or "outside" in file[0] or "seams" in file[0]]
        chosen, others = None, []

        def watch(event, arguments):
            opened = event in ("open", "os.open", "os.listdir", "os.scandir") and not isinstance(arguments[0], int)
            if opened and chosen and str(arguments[0]) != chosen:
                others.append((event, str(arguments[0]), chosen))
            elif event.startswith(("socket.", "subprocess.", "os.exec", "os.spawn", "ctypes.", "urllib.")) and chosen:
                others.append((event, str(arguments), chosen))

        def read(path):
            try:
                read_mesh(path)
            except MeshFileError:
                pass

        for name, content, *_ in files:  # what readers import when they are first used is opened here
            (folder / name).write_bytes(content)
            read(folder / name)
        sys.addaudithook(watch)
        for name, *_ in files:
            chosen = str(folder / name)
            read(chosen)
        chosen = None
        assert not others, others[:5]
        print(len(files))
    """
    root = Path(__file__).resolve().parents[2]
    command = [sys.executable, "-c", textwrap.dedent(code), str(tmp_path), str(root)]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=60, check=False)
    assert done.stderr == ""
    assert int(done.stdout) > 150


def test_the_square_by_hand() -> None:
    assert square().vertices.tolist() == SQUARE_VERTICES
    assert len(binary_stl(square().vertices[square().faces])) == 184
