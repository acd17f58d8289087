from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from dmp.cli import main
from dmp.commands.options import CompleteSettings, DenoiseSettings
from dmp.mesh import TriangleMesh
from dmp.meshio import write_mesh
from dmp.runs import Run
from dmp.settings import SETTING_FIELDS


def _help(options: object, name: str) -> str:
    return next(item.metadata["help"] for item in fields(options) if item.name == name)  # type: ignore[arg-type]


def _run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_each_setting_but_the_task_is_an_option_of_both_commands() -> None:
    for options in (DenoiseSettings, CompleteSettings):
        assert [item.name for item in fields(options)] == [name for name in SETTING_FIELDS if name != "task"]


@pytest.mark.parametrize(
    ("options", "name", "values"),
    [
        (DenoiseSettings, "preset", "[compact]"),
        (CompleteSettings, "preset", "[best]"),
        (DenoiseSettings, "steps", "[1000; paper: 5000; paper-2021-04: 4000; best: 200]"),
        (CompleteSettings, "steps", "[800; compact, paper: 8000]"),
        (DenoiseSettings, "snapshot_every", "[25; paper, paper-2021-04: 50; best: 10]"),
        (DenoiseSettings, "skip", "[off]"),
        (DenoiseSettings, "seed", "[42]"),
        (DenoiseSettings, "laplacian_epsilon", "[1e-12; paper-2021-04: 1e-06]"),
    ],
)
def test_help_tells_the_value_and_the_presets_that_have_another(options: object, name: str, values: str) -> None:
    assert _help(options, name).endswith(values)


def test_help_of_the_command_shows_the_choices(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert _run("denoise", "--help") == 0
    shown = capsys.readouterr().out
    for words in ("gmm-geometric", "spherical", "paper-2021-04", "--skip"):
        assert words in shown
    assert "HEAD" not in shown


@pytest.mark.parametrize(("option", "expected"), [("--skip", True), ("--no-skip", False)])
def test_a_switch_on_the_command_line(
    option: str, expected: bool, noisy_sphere: TriangleMesh, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_mesh(tmp_path / "noisy.ply", noisy_sphere)
    paths = (tmp_path / "noisy.ply", "-o", tmp_path / "out.ply", "--run", tmp_path / "run")
    assert _run("denoise", *paths, "--steps", 2, "--convolution", "gmm", "--gmm-kernels", 2, "--threads", 1, "-q", option) == 0
    assert Run.open(tmp_path / "run").settings.skip is expected
    assert Run.open(tmp_path / "run").settings.convolution == "gmm"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["complete", "--preset", "paper-2021-04"], "could not fill holes"),
        (["denoise", "--convolution", "gat"], "gat"),
        (["denoise", "--smoothing", "spherical"], "is open"),
        (["denoise", "--chebyshev-order", "0"], "--chebyshev-order"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    arguments: list[str], words: str, sphere: TriangleMesh, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_mesh(tmp_path / "open.ply", TriangleMesh(sphere.vertices, sphere.faces[:-1]))
    command, *options = arguments
    assert _run(command, tmp_path / "open.ply", "-o", tmp_path / "out.ply", *options) == 2
    message = capsys.readouterr().err
    assert words in message
    assert len(message.strip().splitlines()) == 1
    assert not (tmp_path / "out.ply").exists()
