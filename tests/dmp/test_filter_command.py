from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dmp.cli import main
from dmp.filters import FILTERS, filtered
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh, write_mesh
from dmp.metrics import GroundTruth


@pytest.fixture
def files(tmp_path: Path, sphere: TriangleMesh, noisy_sphere: TriangleMesh, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_mesh(tmp_path / "noisy.ply", noisy_sphere.with_attributes(quality=np.arange(noisy_sphere.n_vertices, dtype=float)))
    write_mesh(tmp_path / "truth.ply", sphere)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _run(*arguments: object, output: str = "out.ply") -> int:
    with pytest.raises(SystemExit) as left:
        main(["filter", "noisy.ply", "-o", output, *(str(argument) for argument in arguments)])
    return int(left.value.code or 0)


@pytest.mark.parametrize(
    ("method", "options", "parameters"),
    [
        ("taubin", ["--passes", "4", "--inflate", "0.6"], {"passes": 4, "inflate": 0.6}),
        ("bilateral_normal", ["--sigma", "0.5", "--neighbourhood", "edge"], {"sigma": 0.5, "neighbourhood": "edge"}),
        ("guided_normal", ["--iterations", "2", "--vertex-steps", "3"], {"iterations": 2, "vertex_steps": 3}),
        ("hc_laplacian", [], {}),
    ],
)
def test_the_result_is_that_of_the_library(
    files: Path, noisy_sphere: TriangleMesh, method: str, options: list[str], parameters: dict[str, object]
) -> None:
    assert _run("--method", method, *options) == 0
    written = read_mesh(files / "out.ply")
    np.testing.assert_array_equal(written.vertices, filtered(noisy_sphere, method, **parameters))
    assert written.same_connectivity(noisy_sphere)
    assert written.vertex_attributes["quality"][17] == 17


def test_with_a_ground_truth_the_distance_to_it_is_printed(
    files: Path, sphere: TriangleMesh, noisy_sphere: TriangleMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run("--method", "laplacian", "--steps", "1", "--ground-truth", "truth.ply") == 0
    truth = GroundTruth.for_input(sphere, noisy_sphere)
    after = truth.measures(filtered(noisy_sphere, "laplacian", steps=1))
    printed = capsys.readouterr().out
    assert f"{after['mad']:.3f} degrees (before {truth.mad(noisy_sphere.vertices):.3f})" in printed
    assert f"{after['vertex_error']:.4f} mean edge lengths" in printed


def test_tuning_prints_options_that_repeat_its_result(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run("--method", "taubin", "--ground-truth", "truth.ply", "--tune") == 0
    options, angle, distance = capsys.readouterr().out.splitlines()
    tuned = read_mesh(files / "out.ply").vertices
    (files / "out.ply").unlink()
    assert _run("--method", "taubin", "--ground-truth", "truth.ply", *options.split()) == 0
    assert capsys.readouterr().out.splitlines() == [angle, distance]
    np.testing.assert_array_equal(read_mesh(files / "out.ply").vertices, tuned)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--method", "taubin", "--sigma", "0.3"], "taubin has no parameter sigma; it has passes, shrink, inflate"),
        (["--method", "median"], "bilateral_normal"),
        (["--method", "guided_normal", "--sigma", "-1"], "sigma"),
        (["--method", "laplacian", "--steps", "-2"], "a whole number from 0 to 10000, not -2"),
        (["--method", "laplacian", "--tune"], "--ground-truth"),
        (["--method", "laplacian", "--tune", "--ground-truth", "truth.ply", "--steps", "3"], "Leave out --steps"),
        (["--method", "laplacian", "--ground-truth", "out.ply"], "is read"),
        ([], "--method"),
    ],
)
def test_wrong_usage_is_one_line_and_writes_nothing(
    files: Path, sphere: TriangleMesh, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_mesh(files / "out.ply", sphere)
    before = {path.name: path.read_bytes() for path in files.iterdir() if path.is_file()}
    assert _run(*arguments) == 2
    message = capsys.readouterr().err
    assert words in message
    assert len(message.strip().splitlines()) == 1
    assert {path.name: path.read_bytes() for path in files.iterdir() if path.is_file()} == before


@pytest.mark.parametrize(
    ("output", "words"), [("noisy.ply", "is read"), ("out.xyz", "no format"), ("no/out.ply", "no does not")]
)
def test_an_output_that_cannot_be_meant_is_refused(
    files: Path, output: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (files / "noisy.ply").read_bytes()
    assert _run("--method", "laplacian", output=output) == 2
    assert words in capsys.readouterr().err
    assert (files / "noisy.ply").read_bytes() == before


def test_the_help_tells_what_each_filter_is_and_every_default(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["filter", "--help"])
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for name, chosen in FILTERS.items():
        assert f"{name}: {chosen.description}" in shown
        for parameter in chosen.parameters:
            assert f"--{parameter.name.replace('_', '-')}" in shown
            assert f"{name}: {parameter.default}" in shown
