"""Writing meshes: what each format keeps, and that nothing is lost when writing fails."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dmp.errors import MeshFileError
from dmp.mesh import TriangleMesh
from dmp.meshio import WRITABLE_SUFFIXES, read_mesh, write_mesh
from tests.meshes import grid_mesh, sphere_mesh

MESH = sphere_mesh(1)
COLOURS = np.full((MESH.n_vertices, 3), 51, dtype=np.uint8)


@pytest.mark.parametrize("suffix", [".ply", ".vtp"])
def test_ply_and_vtp_keep_everything(tmp_path: Path, suffix: str) -> None:
    mesh = MESH.with_attributes(color=COLOURS, displacement=MESH.vertices * 0.1, quality=MESH.vertices[:, 0].astype(np.float32))
    assert write_mesh(tmp_path / f"a{suffix}", mesh) == ()
    read_back = read_mesh(tmp_path / f"a{suffix}")
    assert read_back.same_connectivity(mesh)
    assert set(read_back.vertex_attributes) == set(mesh.vertex_attributes)
    for name, values in mesh.vertex_attributes.items():
        assert read_back.vertex_attributes[name].dtype == values.dtype
        np.testing.assert_array_equal(read_back.vertex_attributes[name], values)


def test_obj_keeps_colours_and_tells_what_it_cannot_hold(tmp_path: Path) -> None:
    mesh = MESH.with_attributes(color=COLOURS / 255, displacement=MESH.vertices)
    assert write_mesh(tmp_path / "a.obj", mesh) == ("OBJ cannot hold displacement; PLY can.",)
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.obj").vertex_attributes["color"], COLOURS / 255)
    opaque = MESH.with_attributes(color=np.ones((MESH.n_vertices, 4)))
    assert write_mesh(tmp_path / "a.obj", opaque) == ("OBJ cannot hold the opacity of the colours.",)
    assert read_mesh(tmp_path / "a.obj").vertex_attributes["color"].shape == (MESH.n_vertices, 3)
    strange = MESH.with_attributes(color=np.ones(MESH.n_vertices))
    assert write_mesh(tmp_path / "a.obj", strange) == ("OBJ cannot hold color; PLY can.",)


def test_off_and_stl_tell_what_they_cannot_hold(tmp_path: Path) -> None:
    mesh = MESH.with_attributes(quality=MESH.vertices[:, 0], color=COLOURS)
    assert write_mesh(tmp_path / "a.off", mesh) == ("OFF cannot hold color, quality; PLY can.",)
    assert write_mesh(tmp_path / "a.stl", mesh) == (
        "STL cannot hold color, quality; PLY can.",
        "STL holds coordinates in single precision only; PLY is exact.",
    )


def test_a_mesh_far_from_the_origin_is_exact_or_warned_about(tmp_path: Path) -> None:
    far = MESH.with_vertices(MESH.vertices + 1e7)
    for suffix in WRITABLE_SUFFIXES:
        notes = write_mesh(tmp_path / f"a{suffix}", far)
        if suffix == ".stl":
            # Single precision has steps of 1 at 1e7, so that rounding changes a coordinate by up to 0.5.
            change = np.abs(far.vertices.astype(np.float32) - far.vertices).max() / np.linalg.norm(np.ptp(far.vertices, axis=0))
            assert 0.01 < change < 0.5
            assert notes == (f"STL rounded coordinates by up to {change:.2g} of the size of the mesh; PLY is exact.",)
        else:
            assert notes == ()
            np.testing.assert_array_equal(read_mesh(tmp_path / f"a{suffix}").vertices, far.vertices)


def test_coordinates_beyond_single_precision_cannot_become_stl(tmp_path: Path) -> None:
    with pytest.raises(MeshFileError, match=r"beyond 3\.4e38"):
        write_mesh(tmp_path / "a.stl", MESH.with_vertices(MESH.vertices * 1e39))
    assert not (tmp_path / "a.stl").exists()


def test_extensions(tmp_path: Path) -> None:
    write_mesh(tmp_path / "A.PLY", MESH)
    assert (tmp_path / "A.PLY").read_bytes().startswith(b"ply\n")
    write_mesh(str(tmp_path / "name.with.dots.off"), MESH)
    for name in ("a.glb", "a", "a.ply.gz", "a.3MF"):
        with pytest.raises(MeshFileError, match=r"\.obj, \.ply, \.stl, \.off, \.vtp"):
            write_mesh(tmp_path / name, MESH)


def test_a_mesh_without_faces_is_written_all_the_same(tmp_path: Path) -> None:
    points = TriangleMesh(np.eye(3), np.zeros((0, 3), dtype=int))
    for suffix in WRITABLE_SUFFIXES:
        write_mesh(tmp_path / f"a{suffix}", points)


# ---------------------------------------------------------------------------------------------------------- what goes wrong


def files_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if path.is_file()}


def full_disk(descriptor: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def other_data(descriptor: int) -> None:
    os.pwrite(descriptor, b"?", 40)


@pytest.mark.parametrize("suffix", WRITABLE_SUFFIXES)
@pytest.mark.parametrize(("fault", "words"), [(full_disk, "the disk is full"), (other_data, "the disk reports an error")])
def test_a_failing_disk_keeps_the_old_file_and_a_second_attempt_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, fault: Callable[[int], None], words: str
) -> None:
    path = tmp_path / f"a{suffix}"
    write_mesh(path, MESH)
    old = path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fault)
        with pytest.raises(MeshFileError) as caught:
            write_mesh(path, grid_mesh(30))
    assert f"{path}: the file cannot be written because {words}. " in str(caught.value)
    assert path.read_bytes() == old
    assert files_in(tmp_path) == {path.name}
    write_mesh(path, grid_mesh(30))
    assert read_mesh(path).n_faces == grid_mesh(30).n_faces


def test_a_disk_that_is_full_while_writing(tmp_path: Path) -> None:
    code = """
        import resource, sys
        from dmp.errors import MeshFileError
        from dmp.meshio import write_mesh
        from tests.meshes import grid_mesh
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
        for path in sys.argv[1:]:
            try:
                write_mesh(path, grid_mesh(60))
            except MeshFileError as error:
                print(error)
    """
    paths = [tmp_path / f"a{suffix}" for suffix in WRITABLE_SUFFIXES]
    for path in paths:
        path.write_bytes(b"old")
    root = Path(__file__).resolve().parents[2]
    command = [sys.executable, "-c", textwrap.dedent(code), *map(str, paths)]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.count("the file is larger than the system allows") == len(paths)
    assert [path.read_bytes() for path in paths] == [b"old"] * len(paths)
    assert files_in(tmp_path) == {path.name for path in paths}


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "folder.ply").mkdir()
    os.mkfifo(tmp_path / "pipe.ply")
    (tmp_path / "file").write_bytes(b"old")
    expected = {
        tmp_path / "missing" / "a.ply": "the file or its folder does not exist",
        tmp_path / "folder.ply": "it is a folder",
        tmp_path / "pipe.ply": "it is a pipe",
        tmp_path / "file" / "a.ply": "a part of its path is a file",
        tmp_path / ("a" * 300 + ".ply"): "its name is too long",
        Path("a\0.ply"): "no file name can hold",
    }
    for path, words in expected.items():
        with pytest.raises(MeshFileError) as caught:
            write_mesh(path, MESH)
        assert words in str(caught.value)
    assert files_in(tmp_path) == {"file"}


def test_a_folder_without_the_right_to_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def deny(*_: object, **__: object) -> int:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(os, "open", deny)  # for the superuser, who may run this, no folder is read-only
    with pytest.raises(MeshFileError, match="there is no permission"):
        write_mesh(tmp_path / "a.ply", MESH)


def test_long_and_foreign_names(tmp_path: Path) -> None:
    for name in ("a" * 251 + ".ply", "Größe 模型 🐉.obj", " leading and trailing .off", "100%s{}.stl", "-o.ply"):
        write_mesh(tmp_path / name, MESH)
        assert read_mesh(tmp_path / name).n_faces == MESH.n_faces
