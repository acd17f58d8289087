"""MeshLab in its own process: results arrive, and whatever goes wrong there becomes a sentence here."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from dmp import meshlab
from dmp.boundary import boundary_loops
from dmp.errors import MeshError
from dmp.mesh import TriangleMesh
from dmp.smoothing import smooth
from tests.dmp import holed_meshes

SMOOTHING: meshlab.Filter = ("apply_coord_laplacian_smoothing", {"stepsmoothnum": 3, "cotangentweight": False})


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A program to write, which runs in place of the real one."""
    path = tmp_path / "worker.py"
    monkeypatch.setattr(meshlab, "_WORKER", path)
    return path


@pytest.fixture(autouse=True)
def _nothing_stays_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> object:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield
    assert list(folder.iterdir()) == []


def test_a_filter_does_what_its_formula_says(sphere: TriangleMesh) -> None:
    vertices, faces = meshlab.run_filters(sphere, [SMOOTHING])
    np.testing.assert_array_equal(faces, sphere.faces)
    np.testing.assert_allclose(vertices, smooth(sphere, "laplacian", 3), atol=1e-12)


def test_holes_are_closed_and_the_rest_stays() -> None:
    mesh = holed_meshes.sphere_with_six_holes()
    loops = boundary_loops(mesh)
    vertices, faces = meshlab.close_holes(mesh, loops[:2], 0.1)
    np.testing.assert_array_equal(vertices[: mesh.n_vertices], mesh.vertices)
    np.testing.assert_array_equal(faces[: mesh.n_faces], mesh.faces)
    assert len(boundary_loops(TriangleMesh(vertices, faces))) == 4


def test_it_is_never_imported_here() -> None:
    program = (
        "import sys, numpy, dmp.meshlab\n"
        "from dmp.mesh import TriangleMesh\n"
        "mesh = TriangleMesh(numpy.eye(3), numpy.array([[0, 1, 2]]))\n"
        "dmp.meshlab.run_filters(mesh, [('compute_normal_per_face', {})])\n"
        "assert not {name for name in sys.modules if name.startswith(('pymeshlab', 'PySide', 'PyQt'))}\n"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False, timeout=60).returncode == 0


def test_a_hang_is_ended_and_the_next_call_works(worker: Path, sphere: TriangleMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    worker.write_text("import time\ntime.sleep(60)\n")
    begin = time.monotonic()
    with pytest.raises(MeshError, match=r"longer than 0\.5 seconds"):
        meshlab.run_filters(sphere, [SMOOTHING], time_limit=0.5)
    assert time.monotonic() - begin < 10
    monkeypatch.undo()
    assert len(meshlab.run_filters(sphere, [SMOOTHING])[0]) == sphere.n_vertices


@pytest.mark.skipif(sys.platform == "win32", reason="there are no signals")
@pytest.mark.parametrize("name", ["SIGSEGV", "SIGABRT", "SIGKILL"])
def test_a_crash_is_told(worker: Path, sphere: TriangleMesh, name: str) -> None:
    worker.write_text(
        f"import os, resource, signal\nresource.setrlimit(resource.RLIMIT_CORE, (0, 0))\nos.kill(os.getpid(), signal.{name})\n"
    )
    with pytest.raises(MeshError, match=name):
        meshlab.run_filters(sphere, [SMOOTHING])


def test_any_other_end_is_a_crash(worker: Path, sphere: TriangleMesh) -> None:
    worker.write_text("raise RuntimeError\n")
    with pytest.raises(MeshError, match=r"crashed \(exit code 1\)"):
        meshlab.run_filters(sphere, [SMOOTHING])


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux enforces the limit")
def test_too_little_memory_is_told(sphere: TriangleMesh) -> None:
    with pytest.raises(MeshError, match=r"more than 0\.125 GB of memory"):
        meshlab.run_filters(sphere, [SMOOTHING], memory_limit=2**27)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux enforces the limit")
@pytest.mark.parametrize(
    "program",
    [
        "kept = []\nwhile True:\n    kept.append(bytearray(10_000_000))\n",
        # What a C++ library does: it cannot be caught, and ends in an abort.
        "import os, resource, sys\nresource.setrlimit(resource.RLIMIT_CORE, (0, 0))\n"
        "print(\"terminate called after throwing an instance of 'std::bad_alloc'\", file=sys.stderr, flush=True)\nos.abort()\n",
    ],
)
def test_memory_that_runs_out_is_told_whatever_the_child_does(worker: Path, sphere: TriangleMesh, program: str) -> None:
    worker.write_text(program)
    with pytest.raises(MeshError, match=r"more than 0\.5 GB of memory"):
        meshlab.run_filters(sphere, [SMOOTHING], memory_limit=2**29)


def test_a_child_that_never_stops_talking_is_ended(worker: Path, sphere: TriangleMesh) -> None:
    worker.write_text("import sys\nwhile True:\n    sys.stderr.write('x' * 100_000)\n    sys.stdout.write('x' * 100_000)\n")
    with pytest.raises(MeshError, match=r"longer than|crashed"):
        meshlab.run_filters(sphere, [SMOOTHING], time_limit=0.5)


def test_a_child_that_cannot_be_ended_nicely_is_killed(worker: Path, sphere: TriangleMesh) -> None:
    worker.write_text(
        "import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "time.sleep(60)\n"
    )
    begin = time.monotonic()
    with pytest.raises(MeshError, match="longer than"):
        meshlab.run_filters(sphere, [SMOOTHING], time_limit=0.3)
    assert time.monotonic() - begin < 5


def test_no_room_for_the_exchange_is_told(sphere: TriangleMesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(np, "savez", full)
        with pytest.raises(MeshError, match="because the disk is full"):
            meshlab.run_filters(sphere, [SMOOTHING])
        patch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
        with pytest.raises(MeshError, match="does not exist"):
            meshlab.run_filters(sphere, [SMOOTHING])


def test_a_refusal_is_passed_on(sphere: TriangleMesh) -> None:
    with pytest.raises(MeshError, match=r"could not do it: .*exist"):
        meshlab.run_filters(sphere, [("no_such_filter", {})])


def test_a_missing_installation_is_told(worker: Path, sphere: TriangleMesh) -> None:
    worker.write_text("import sys\nprint('No module named pymeshlab', file=sys.stderr)\nsys.exit(3)\n")
    with pytest.raises(MeshError, match="pip install pymeshlab"):
        meshlab.run_filters(sphere, [SMOOTHING])


@pytest.mark.parametrize(
    "program",
    [
        "",  # writes nothing
        "import sys, pathlib\n(pathlib.Path(sys.argv[1]) / 'output.npz').write_bytes(b'PK rubbish')\n",
        "import sys, numpy\nnumpy.savez(sys.argv[1] + '/output.npz', vertices=numpy.ones((3, 3)), faces=[[0, 1, 7]])\n",
        "import sys, numpy\nnumpy.savez(sys.argv[1] + '/output.npz', vertices=numpy.eye(3) * numpy.nan, faces=[[0, 1, 2]])\n",
        "import sys, numpy\nnumpy.savez(sys.argv[1] + '/output.npz', vertices=numpy.ones((3, 3)))\n",
        "import sys, numpy\nnumpy.savez(sys.argv[1] + '/output.npz', vertices=numpy.array([None]), faces=[[0, 1, 2]])\n",
    ],
)
def test_rubbish_is_refused(worker: Path, sphere: TriangleMesh, program: str) -> None:
    worker.write_text(program)
    with pytest.raises(MeshError, match="no valid mesh"):
        meshlab.run_filters(sphere, [SMOOTHING])


def test_a_mesh_changed_around_the_holes_is_refused(worker: Path) -> None:
    worker.write_text(
        "import sys, numpy\n"
        "given = numpy.load(sys.argv[1] + '/input.npz')\n"
        "numpy.savez(sys.argv[1] + '/output.npz', vertices=given['vertices'] + 1e-9, faces=given['faces'])\n"
    )
    mesh = holed_meshes.sphere_with_six_holes()
    with pytest.raises(MeshError, match="changed the mesh"):
        meshlab.close_holes(mesh, boundary_loops(mesh), 0.1)


def test_a_mesh_without_faces_is_not_sent() -> None:
    with pytest.raises(MeshError, match="no faces"):
        meshlab.run_filters(TriangleMesh(np.zeros((3, 3)), np.empty((0, 3), dtype=np.int64)), [SMOOTHING])
