"""``dmp metrics`` and the options of ``dmp noise``, through the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dmp.cli import main
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh, write_mesh
from dmp.metrics import GroundTruth, surface_measures
from dmp.noise import add_noise


@pytest.fixture
def files(tmp_path: Path, sphere: TriangleMesh, noisy_sphere: TriangleMesh, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_mesh(tmp_path / "noisy.ply", noisy_sphere)
    write_mesh(tmp_path / "truth.ply", sphere)
    write_mesh(tmp_path / "other.ply", TriangleMesh(1.1 * sphere.vertices, sphere.faces[::-1]))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        main([str(argument) for argument in arguments])
    return int(left.value.code or 0)


def test_metrics_are_all_that_the_library_measures(
    files: Path, sphere: TriangleMesh, noisy_sphere: TriangleMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = GroundTruth.for_input(sphere, noisy_sphere)
    expected = truth.full_measures(noisy_sphere.vertices)
    assert _run("metrics", "noisy.ply", "truth.ply", "--json") == 0
    values = json.loads(capsys.readouterr().out)
    assert {name: values[name] for name in expected} == pytest.approx(expected)
    assert values["alignment_scale"] == truth.alignment.scale

    assert _run("metrics", "noisy.ply", "truth.ply") == 0
    lines = capsys.readouterr().out.splitlines()
    for start, number in (
        ("mean angular difference", f"{expected['mad']:.3f} degrees"),
        ("flipped faces", f"{100 * expected['flipped_faces']:.2f} %"),
        ("mean vertex distance", f"{expected['vertex_error']:.4f} (root mean square {expected['vertex_error_rms']:.4f}"),
        ("  mesh to reference", f"{expected['surface_distance']:.4f}"),
        ("  reference to mesh", f"at most {expected['surface_distance_back_max']:.3f}"),
        ("Hausdorff distance", f"{expected['hausdorff']:.3f}"),
    ):
        assert any(line.startswith(start) and number in line for line in lines), start


def test_meshes_with_other_faces_are_compared_by_their_surfaces_alone(
    files: Path, sphere: TriangleMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run("metrics", "other.ply", "truth.ply", "--json") == 0
    values = json.loads(capsys.readouterr().out)
    assert values.pop("mean_edge_length") > 0
    assert values == pytest.approx(surface_measures(read_mesh(files / "other.ply"), sphere))
    assert _run("metrics", "other.ply", "truth.ply") == 0
    printed = capsys.readouterr().out
    assert "other faces" in printed
    assert "angular" not in printed


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        (["--kind", "impulsive", "--share", "0.3"], {"kind": "impulsive", "share": 0.3}),
        (["--kind", "scanner", "--correlation-steps", "0"], {"kind": "scanner", "correlation_steps": 0}),
        (["--kind", "scanner", "--view", "0", "1", "-2.5"], {"kind": "scanner", "view": (0, 1, -2.5)}),
        (["--kind", "scanner"], {"kind": "scanner"}),
    ],
)
def test_noise_takes_the_options_of_its_kind(
    files: Path, sphere: TriangleMesh, options: list[str], arguments: dict[str, object]
) -> None:
    assert _run("noise", "truth.ply", "-o", "out.ply", *options) == 0
    np.testing.assert_array_equal(read_mesh(files / "out.ply").vertices, add_noise(sphere, 0.2, **arguments).vertices)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--share", "0.3"], "--share belongs to --kind impulsive"),
        (["--kind", "impulsive", "--correlation-steps", "3"], "--correlation-steps belongs to --kind scanner"),
        (["--kind", "uniform", "--view", "0", "0", "1"], "--view belongs to --kind scanner"),
        (["--kind", "impulsive", "--share", "1.5"], "at most 1, not 1.5"),
        (["--kind", "scanner", "--correlation-steps", "-1"], "0 or more, not -1"),
        (["--kind", "scanner", "--view", "0", "0", "0"], "not all 0"),
        (["--kind", "scanner", "--view", "0", "0"], "--view"),
    ],
)
def test_options_of_other_kinds_of_noise_are_refused(
    files: Path, options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run("noise", "truth.ply", "-o", "out.ply", *options) == 2
    message = capsys.readouterr().err
    assert words in message
    assert len(message.strip().splitlines()) == 1
    assert not (files / "out.ply").exists()
