from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dmp.cli import main
from dmp.geometry import mean_edge_length
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh, write_mesh
from dmp.runs import Run
from dmp.topology import unique_edges

FAST = ["--steps", "20", "--snapshot-every", "10", "--threads", "1"]


@pytest.fixture
def files(noisy_sphere: TriangleMesh, sphere: TriangleMesh, tmp_path: Path) -> Path:
    write_mesh(tmp_path / "noisy.ply", noisy_sphere)
    write_mesh(tmp_path / "truth.obj", sphere)
    return tmp_path


def _run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_denoise_writes_mesh_report_and_run(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = _run("denoise", files / "noisy.ply", "-o", files / "out.ply", "--ground-truth", files / "truth.obj", *FAST,
                "--run", files / "run", "--report", files / "report.json", "--keep", "best")  # fmt: skip
    assert code == 0
    report = json.loads((files / "report.json").read_text())
    assert {"mesh", "vertices", "faces", "task", "settings", "device", "steps", "kept_step", "suggested_step", "seconds",
            "seconds_per_step", "peak_memory_mb", "curve", "input", "result"} <= report.keys()  # fmt: skip
    assert report["steps"] == 20
    assert report["result"]["mad"] == min(row["mad"] for row in report["curve"] if row["step"] in (0, 10, 20))
    saved = read_mesh(files / "out.ply")
    assert saved.vertex_attributes["displacement"].shape == (258, 3)
    assert Run.open(files / "run").kept_step == report["kept_step"]
    said = capsys.readouterr().err
    assert "MAD" in said
    assert re.search(r"About .+ for the remaining 16 of 20 steps\.", said)


def test_export_and_resume_of_a_run(files: Path) -> None:
    assert _run("denoise", files / "noisy.ply", "-o", files / "out.ply", *FAST, "--run", files / "run", "-q") == 0
    assert _run("export", files / "run", "--step", "10", "-o", files / "ten.obj") == 0
    assert read_mesh(files / "ten.obj").n_vertices == 258
    assert _run("export", files / "run", "--step", "11", "-o", files / "x.obj") == 2
    assert _run("resume", files / "run") == 2
    # A kill after the last step and before the result was written leaves a run that only lacks that.
    (files / "out.ply").rename(files / "whole.ply")
    assert _run("resume", files / "run", "-o", files / "out.ply") == 0
    assert (files / "out.ply").read_bytes() == (files / "whole.ply").read_bytes()
    assert _run("resume", files / "run", "--steps", "30", "-o", files / "thirty.stl", "--keep", "last") == 0
    assert Run.open(files / "run").snapshot_steps() == [0, 10, 20, 30]
    assert _run("export", files / "run", "-o", files / "kept.ply") == 0


def test_quiet_says_nothing(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run("denoise", files / "noisy.ply", "-o", files / "out.ply", *FAST, "--quiet") == 0
    captured = capsys.readouterr()
    assert captured.out == captured.err == ""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["denoise", "missing.ply", "-o", "out.ply"], "missing.ply"),
        (["denoise", "{noisy}", "-o", "out.xyz"], "out.xyz"),
        (["denoise", "{noisy}", "-o", "no/such/folder/out.ply"], "no/such/folder"),
        (["denoise", "{noisy}", "-o", "out.ply", "--steps", "0"], "--steps"),
        (["denoise", "{noisy}", "-o", "out.ply", "--keep", "best"], "--ground-truth"),
        (["denoise", "{noisy}", "-o", "out.ply", "--keep", "33"], "multiple"),
        (["denoise", "{noisy}", "-o", "out.ply", "--speed", "9"], "--speed"),
        (["export", "{noisy}", "-o", "out.ply"], "run folder"),
        (["noise", "{noisy}", "-o", "out.ply", "--kind", "pink"], "pink"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_two(
    files: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(files)
    assert _run(*(argument.format(noisy=files / "noisy.ply") for argument in arguments)) == 2
    message = capsys.readouterr().err
    assert words in message
    assert len(message.strip().splitlines()) == 1
    assert "Traceback" not in message


def test_noise_smooth_metrics_and_info(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run("noise", files / "truth.obj", "-o", files / "n.ply", "--level", "0.3", "--seed", "1") == 0
    assert _run("smooth", files / "n.ply", "-o", files / "s.ply") == 0
    capsys.readouterr()
    assert _run("metrics", files / "n.ply", files / "truth.obj", "--json") == 0
    values = json.loads(capsys.readouterr().out)
    assert 0.3 < values["vertex_error"] < 0.6
    assert _run("info", files / "n.ply", "--json") == 0
    described = json.loads(capsys.readouterr().out)
    assert (described["vertices"], described["closed"], described["trainable"]) == (258, True, True)
    assert _run("info", files / "n.ply") == 0
    assert "258" in capsys.readouterr().out


def test_interrupting_leaves_a_whole_run_and_exit_code_130(files: Path) -> None:
    paths = [str(files / "noisy.ply"), "-o", str(files / "out.ply"), "--run", str(files / "run")]
    command = [sys.executable, "-m", "dmp", "denoise", *paths, "--steps", "100000", "--snapshot-every", "10", "--threads", "1"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as child:
        until = time.monotonic() + 60
        while not (files / "run" / "snapshots" / "000020.npy").exists() and time.monotonic() < until:
            time.sleep(0.05)
        child.send_signal(signal.SIGINT)
        _, errors = child.communicate(timeout=20)
    assert child.returncode == 130
    assert "dmp resume" in errors
    run = Run.open(files / "run")
    assert run.state == "stopped"
    assert run.resume().step == run.last_step >= 20


def test_help_is_quick_because_nothing_heavy_is_imported() -> None:
    code = (
        "import sys\n"
        "try:\n    from dmp.cli import main; main(['denoise', '--help'])\n"
        "except SystemExit: pass\n"
        "print([m for m in ('torch', 'scipy', 'vtk', 'pymeshlab') if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"
    assert "--laplacian-weight" in done.stdout


@pytest.mark.parametrize(
    ("said", "expected"),
    [({}, "30000"), ({"GOMP_SPINCOUNT": "7"}, "7"), ({"OMP_WAIT_POLICY": "ACTIVE"}, "None")],
)
def test_threads_spin_only_briefly_unless_told_otherwise(said: dict[str, str], expected: str) -> None:
    code = (
        "import os\n"
        "try:\n    from dmp.cli import main; main(['--version'])\n"
        "except SystemExit: print(os.environ.get('GOMP_SPINCOUNT'))"
    )
    kept = {name: value for name, value in os.environ.items() if name not in ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=kept | said)
    assert done.stdout.split()[-1] == expected


def test_runs_are_listed_by_names_that_resume_and_export_take(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run("denoise", files / "noisy.ply", "-o", files / "out.ply", *FAST) == 0
    (folder,) = (path for path in Path(os.environ["XDG_DATA_HOME"]).rglob("run.json"))
    assert str(folder.parent) in capsys.readouterr().err
    assert _run("runs") == 0
    assert folder.parent.name in capsys.readouterr().out
    assert _run("export", folder.parent.name, "-o", files / "again.ply") == 0
    assert read_mesh(files / "again.ply").n_vertices == 258


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["denoise", "noisy.ply", "-o", "noisy.ply"], "is read"),
        (["denoise", "noisy.ply", "-o", "x.ply", "--preset", "best", "--hold-out", "0.1"], "--hold-out"),
        (["complete", "noisy.ply", "-o", "x.ply", "--denoise", "--preset", "best"], "--denoise"),
        (["denoise", "noisy.ply", "-o", "x.ply", "--report", "no/such/r.json"], "--report"),
        (["denoise", "noisy.ply", "-o", "x.ply", "--report", "noisy.ply"], "--report noisy.ply: this is the file that is read"),
        (["denoise", "noisy.ply", "-o", "x.ply", "--report", "x.ply"], "where the mesh is written"),
        (["denoise", "noisy.ply", "-o", "x.ply", "--run", "x.ply"], "cannot be both"),
        (["denoise", "noisy.ply", "-o", "run/input.ply", "--run", "run"], "part of the run"),
        (["noise", "noisy.ply", "-o", "noisy.ply"], "is read"),
        (["smooth", "noisy.ply", "-o", "linked.ply"], "is read"),
        (["filter", "noisy.ply", "-o", "noisy.ply", "--method", "taubin"], "is read"),
        (["noise", "noisy.ply", "-o", "pipe.ply"], "not a file"),
        (["noise", "noisy.ply", "-o", f"{'a' * 300}.ply"], "its name is too long"),
        (["noise", "noisy.ply", "-o", f"{'a' * 300}/b.ply"], "its name is too long"),
        (["picture", "noisy.ply", "-o", f"{'a' * 300}.png"], "its name is too long"),
        (["picture", f"{'a' * 300}.ply", "-o", "a.png"], "its name is too long"),
        (["export", "a" * 300, "-o", "b.ply"], "its name is too long"),
        (["batch", f"{'a' * 300}.ply", "--out", "many"], "its name is too long"),
    ],
)
def test_what_could_not_be_meant_is_refused_at_once(
    files: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(files)
    before = (files / "noisy.ply").read_bytes()
    (files / "run").mkdir()
    (files / "linked.ply").symlink_to("noisy.ply")
    os.mkfifo(files / "pipe.ply")
    assert _run(*arguments) == 2
    assert words in capsys.readouterr().err
    assert (files / "noisy.ply").read_bytes() == before


def test_no_output_takes_the_place_of_a_part_of_a_run_or_of_its_input(
    files: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(files)
    assert _run("denoise", "noisy.ply", "-o", "out.ply", "--run", "run", *FAST) == 0
    before = {path: path.read_bytes() for path in files.rglob("*") if path.is_file()}
    capsys.readouterr()
    for arguments in (
        ["export", "run", "-o", "run/input.ply"],
        ["export", "run", "-o", "noisy.ply"],
        ["resume", "run", "--steps", "100", "-o", "run/../run/input.ply"],
        ["resume", "run", "--steps", "100", "--report", "run/run.json"],
        ["resume", "run", "--steps", "100", "--report", "noisy.ply"],
        ["curve", "run", "-o", "run/curve.csv"],
    ):
        assert _run(*arguments) == 2
        assert re.search("part of the run|file that is read", capsys.readouterr().err), arguments
    assert {path: path.read_bytes() for path in files.rglob("*") if path.is_file()} == before
    assert _run("export", "run", "-o", "run/mesh.ply") == 0


def test_denoising_is_done_even_when_there_is_no_hole(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run("complete", files / "noisy.ply", "-o", files / "out.ply", "--denoise", *FAST) == 0
    assert "Its noise is removed" in capsys.readouterr().err
    assert (read_mesh(files / "out.ply").vertices != read_mesh(files / "noisy.ply").vertices).any()


def test_meshes_with_other_faces_are_measured_by_their_surfaces(
    files: Path, sphere: TriangleMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    edge_length = mean_edge_length(sphere.vertices, unique_edges(sphere.faces))
    turned = TriangleMesh(sphere.vertices * (1 + 0.5 * edge_length), sphere.faces[::-1])
    write_mesh(files / "larger.ply", turned)
    assert _run("metrics", files / "larger.ply", files / "truth.obj", "--json") == 0
    values = json.loads(capsys.readouterr().out)
    assert values["surface_distance"] == pytest.approx(0.5, rel=0.02)
    assert values["surface_distance_back"] == pytest.approx(0.5, rel=0.1)
    assert _run("metrics", files / "larger.ply", files / "truth.obj") == 0
    assert "mesh to reference" in capsys.readouterr().out
