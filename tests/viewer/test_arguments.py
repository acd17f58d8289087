"""The command line of the window, without a window."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dmp_viewer.__main__ import main
from dmp_viewer.arguments import parse

HEAVY = ("torch", "vtkmodules", "pyvista", "PySide6", "qtpy", "pyqtgraph", "scipy")


def test_everything_can_be_said() -> None:
    arguments = parse(
        [
            "scan.ply",
            "--ground-truth",
            "clean.ply",
            "--task",
            "denoise",
            "--start",
            "--steps",
            "300",
            "--preset",
            "paper",
            "--seed",
            "7",
            "--snapshot-every",
            "10",
            "--device",
            "cpu",
            "--theme",
            "dark",
            "--size",
            "1280x800",
            "--screenshot",
            "out.png",
            "--at-step",
            "300",
        ]
    )
    assert arguments.path == Path("scan.ply")
    assert arguments.ground_truth == Path("clean.ply")
    assert arguments.overrides == {"steps": 300, "seed": 7, "snapshot_every": 10, "device": "cpu"}
    assert (arguments.preset, arguments.start, arguments.theme) == ("paper", True, "dark")
    assert (arguments.screenshot, arguments.at_step, arguments.size) == (Path("out.png"), 300, (1280, 800))


def test_what_is_not_said_is_left_to_the_preset() -> None:
    assert set(parse([]).overrides.values()) == {None}


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("--start", "need a mesh"),
        ("--ground-truth clean.ply", "need a mesh"),
        ("scan.ply --at-step 5", "--screenshot"),
        ("scan.ply --screenshot a.png --at-step -1", "-1"),
        ("scan.ply --screenshot a.png --steps 10 --at-step 20", "20"),
        ("scan.ply --size large", "large"),
        ("scan.ply --preset fast", "fast"),
    ],
)
def test_wrong_usage_is_told_with_code_2(line: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        parse(line.split())
    assert stop.value.code == 2
    assert told in capsys.readouterr().err


def test_versions_for_a_bug_report(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        parse(["--version"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    for package in ("dmp-viewer", "torch", "Qt", "VTK"):
        assert package in text


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_loads_nothing_heavy(option: str) -> None:
    code = (
        "import sys\nfrom dmp_viewer.__main__ import main\ntry:\n    main([sys.argv[1]])\nexcept SystemExit as stop:\n"
        "    assert not stop.code\n"
        f"print('LOADED', [name for name in {HEAVY!r} if name in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code, option], capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-1] == "LOADED []"


def _without_display(*line: str, **changes: str) -> subprocess.CompletedProcess[str]:
    environment = {
        name: text for name, text in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    }
    command = [sys.executable, "-m", "dmp_viewer", *line]
    return subprocess.run(command, capture_output=True, text=True, env={**environment, **changes}, check=False)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems always have a display")
@pytest.mark.parametrize("changes", [{}, {"DISPLAY": ":7999"}, {"QT_QPA_PLATFORM": "offscreen"}])
def test_without_a_display_one_line_names_the_command_line(changes: dict[str, str]) -> None:
    result = _without_display("scan.ply", **changes)
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1
    assert "dmp denoise" in result.stderr


@pytest.mark.usefixtures("qapp")
def test_a_file_that_is_not_there_is_refused_before_anything_is_loaded(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["no/such/mesh.ply"]) == 2
    assert capsys.readouterr().err == "dmp-viewer: no/such/mesh.ply: there is no such file or folder.\n"


@pytest.mark.usefixtures("qapp")
def test_a_setting_out_of_range_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path), "--steps", "0"]) == 2
    assert "--steps is 0" in capsys.readouterr().err
