"""Descriptions and curves from others: what is impossible is refused, what is odd is not believed."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path
from typing import Any

import pytest

from dmp.errors import RunError
from dmp.run_files import parse_curve
from dmp.runs import Run, list_runs
from tests.dmp.hostile_runs.damages import change_description, use_everything


@pytest.mark.parametrize(
    "content",
    [b"", b"[]", b"{}", b"\0", b"\xff\xfe{", b'{"format": 9}', b'{"format": 1, "settings": {"steps": -1}}', b"[" * 100_000,
     b'{"a":' * 100_000, b"9" * 100_000, b"null", b'"run"', b" " * 2_000_000],
)  # fmt: skip
def test_a_description_that_is_none_is_one_sentence(content: bytes, folder: Path) -> None:
    (folder / "run.json").write_bytes(content)
    with pytest.raises(RunError) as caught:
        Run.open(folder)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 600
    (folder / "kept.json").write_bytes(content)
    shutil.copytree(folder, folder.parent / "among" / "run")
    assert list_runs(folder.parent / "among") == []


@pytest.mark.parametrize(
    "changes",
    [
        {"format": [1]},
        {"run_id": "../../etc"},
        {"run_id": 5},
        {"name": ["a"]},
        {"created": {}},
        {"state": "exploded"},
        {"last_step": 10**300},
        {"last_step": 1.5},
        {"last_step": True},
        {"vertices": -1},
        {"settings": []},
        {"settings": {"steps": 10**400}},
        {"settings": {"learning_rate": 10**400}},
        {"settings": {"learning_rate": float("nan")}},
        {"settings": {"device": "/dev/sda"}},
        {"settings": {"task": "destroy"}},
    ],
)
def test_a_description_with_something_impossible_is_refused(changes: dict[str, Any], folder: Path) -> None:
    change_description(folder, **changes)
    with pytest.raises(RunError):
        Run.open(folder)


@pytest.mark.parametrize(
    "changes",
    [
        {"input": {"path": "../../../etc/passwd"}},
        {"input": {"path": "//server/share/mesh.ply"}},
        {"input": {"path": "\\\\server\\share\\mesh.ply"}},
        {"input": {"path": "/tmp/\0"}},
        {"input": {"path": "/tmp/\ud800.ply"}},
        {"input": {"path": "/" + "a" * 100_000}},
        {"input": {"path": 5}},
        {"input": "/etc/passwd"},
        {"threads": 10**9},
        {"threads": "all"},
        {"input_faces": 10**12},
        {"input_faces": -5},
        {"device": {"a": 1}},
        {"device": "cpu\n\x1b[2J"},
        {"files": ["input.ply"]},
        {"reason": "\n" * 10**5},
    ],
)
def test_what_is_odd_in_a_description_is_not_believed(changes: dict[str, Any], folder: Path) -> None:
    change_description(folder, **changes)
    run = Run.open(folder)
    assert run.input_path is None
    assert run.recorded_threads in (None, 1)
    assert run.problem().n_input_faces is None
    assert "\n" not in f"{run.device}{run.reason}"
    # That somebody else has written it is told.
    assert any("not as this program wrote it" in warning for warning in run.warnings)
    use_everything(folder)


def test_a_name_is_shown_without_anything_invisible(folder: Path) -> None:
    change_description(folder, name="scan\u202egpj.ply\n\x1b[31m\ud800" + "x" * 10_000)
    name = Run.open(folder).name
    assert name.startswith("scangpj.ply[31mxxx")
    assert len(name) == 200


@pytest.mark.parametrize("step", [10**12, -1, 3, "2", None, [2], 2.0, True, {"a": 1}])
def test_a_kept_step_that_is_none_counts_as_none(step: object, folder: Path) -> None:
    (folder / "kept.json").write_text(json.dumps({"step": step}))
    assert Run.open(folder).kept_step is None


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", []),
        (b"\0" * 100_000, []),
        (b"," * 1_000_000 + b"\n" + b"1," * 1_000_000 + b"\n", []),
        (b"step,seconds\n" + b"9" * 100_000 + b",1\n", []),
        (b"step,seconds\n1e300,1\ninf,1\nnan,1\n-1,1\n2,inf\n3,nan\n4,1e300\n", []),
        (b"step,seconds\n5,1.5\n", [{"step": 5, "seconds": 1.5}]),
        (b"step,password\n5,1.5\n", [{"step": 5}]),
        (b"seconds,step\n1.5,5\n1.25,4\n", [{"step": 4, "seconds": 1.25}, {"step": 5, "seconds": 1.5}]),
        ("step,seconds\n٥,1\n".encode(), []),
    ],
)
def test_curves_hold_numbers_or_nothing(content: bytes, expected: list[dict[str, float]]) -> None:
    assert parse_curve(content) == expected


def test_a_curve_larger_than_any_is_not_read(folder: Path) -> None:
    with (folder / "curve.csv").open("r+b") as file:
        file.truncate(10**10)
    begin = time.monotonic()
    with pytest.raises(RunError, match="more than this program ever writes"):
        Run.open(folder).curve()
    assert time.monotonic() - begin < 1
