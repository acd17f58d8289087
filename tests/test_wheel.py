"""The wheel carries everything that the program needs, and nothing else."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(PROJECT)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (made,) = folder.glob("*.whl")
    return made


@pytest.fixture(scope="module")
def names(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def test_samples_and_icons_travel_with_the_wheel(names: set[str]) -> None:
    for path in (PROJECT / "assets").rglob("*"):
        if path.is_file():
            assert f"dmp/assets/{path.relative_to(PROJECT / 'assets').as_posix()}" in names


def test_every_module_travels_with_the_wheel_and_no_test_does(names: set[str]) -> None:
    for package in ("dmp", "dmp_viewer"):
        for path in (PROJECT / package).rglob("*.py"):
            assert path.relative_to(PROJECT).as_posix() in names
    assert not [name for name in names if name.startswith(("tests/", "docs/", "scripts/"))]


def test_both_commands_are_installed(wheel: Path, names: set[str]) -> None:
    (entry_points,) = (name for name in names if name.endswith("entry_points.txt"))
    with zipfile.ZipFile(wheel) as archive:
        text = archive.read(entry_points).decode()
    assert "dmp = dmp.__main__:main" in text
    assert "dmp-viewer = dmp_viewer.__main__:main" in text
