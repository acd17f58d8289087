"""Many small injuries to good files: each is read as what its bytes say or refused in a sentence, quickly.

``DMP_FUZZ`` sets the number of injured files of each kind (40 unless set), ``DMP_FUZZ_SEED`` another seed.
``python -m tests.soak.reading`` does the same at full size, in a process with limits.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.dmp.formats.samples import ALL_SAMPLES
from tests.soak.__main__ import main
from tests.soak.injuries import INJURIES, injure
from tests.soak.plain_readers import read_plainly
from tests.soak.reading import GOOD, Child, judge, read_injured, same_mesh
from tests.soak.reading_child import answer

N_FILES = int(os.environ.get("DMP_FUZZ", "40"))
SEED = int(os.environ.get("DMP_FUZZ_SEED", "20210401"))


def read_here(path: Path, content: bytes) -> tuple[dict[str, Any], tuple[np.ndarray, np.ndarray] | None]:
    path.write_bytes(content)
    told = answer(path)
    if told["outcome"] != "read":
        return told, None
    with np.load(path.parent / "mesh.npz") as arrays:
        return told, (arrays["vertices"], arrays["faces"])


@pytest.mark.parametrize("name", ALL_SAMPLES)
def test_injured_files_are_read_as_their_bytes_say_or_refused(tmp_path: Path, name: str) -> None:
    _, whole = read_here(tmp_path / name, ALL_SAMPLES[name])
    assert whole is not None
    for index in range(N_FILES):
        content, injuries = injure(name, ALL_SAMPLES[name], SEED, index)
        told, mesh = read_here(tmp_path / name, content)
        outcome = judge(told, mesh, whole, content, name, injuries)
        assert outcome in GOOD, (index, injuries, outcome, told["text"])
        assert told["seconds"] < 5
        assert all(note.endswith(".") for note in told["notes"])
        assert told["outcome"] == "read" or told["text"].endswith(".")


@pytest.mark.parametrize("name", ALL_SAMPLES)
def test_the_plain_readers_agree_about_the_good_files(tmp_path: Path, name: str) -> None:
    _, mesh = read_here(tmp_path / name, ALL_SAMPLES[name])
    assert mesh is not None
    points, polygons = read_plainly(ALL_SAMPLES[name])
    assert same_mesh(*mesh, np.array(points), polygons)
    # They would notice a corner that is another one, and a vertex that is elsewhere.
    vertices, faces = mesh
    other_faces = faces.copy()
    other_faces[1, 1] = (other_faces[1, 1] + 1) % len(vertices)
    assert not same_mesh(vertices, other_faces, np.array(points), polygons)
    moved = vertices.copy()
    moved[2] += 1e-6
    assert not same_mesh(moved, faces, np.array(points), polygons)
    assert not same_mesh(vertices, faces[:-1], np.array(points), polygons)
    assert not same_mesh(vertices, faces[:, ::-1], np.array(points), polygons)


def test_a_polygon_may_be_split_in_any_way_that_keeps_its_outline() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    for faces in ([[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]], [[2, 3, 1], [3, 0, 1]]):
        assert same_mesh(points, np.array(faces), points, [[0, 1, 2, 3]])
    for faces in ([[0, 1, 2], [0, 3, 2]], [[0, 1, 2], [1, 2, 3]], [[0, 1, 2]]):
        assert not same_mesh(points, np.array(faces), points, [[0, 1, 2, 3]])


def test_a_polygon_that_comes_back_to_its_corners_may_fold_up_to_nothing() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    # There and back again: the same corners in the other direction cancel out, and leave one triangle of a square.
    folded, square = [0, 1, 3, 1], [0, 1, 2, 3]
    assert same_mesh(points, np.array([[0, 1, 2], [0, 2, 3]]), points, [folded, square])
    # Where nothing else has the corner, it is in no face and left out.
    assert same_mesh(points[:3], np.array([[0, 1, 2]]), points, [folded, [0, 1, 2]])
    assert not same_mesh(points[:3], np.array([[0, 1, 2]]), points, [square, [0, 1, 2]])


def test_the_plain_reader_takes_base64_text_with_line_breaks_in_it() -> None:
    good = ALL_SAMPLES["inline.vtp"]
    array = good.index(b'format="binary"')
    start = good.index(b">", array) + 1
    while good[start : start + 1].isspace():
        start += 1
    broken_up = good[: start + 3] + b"\n" + good[start + 3 :]
    assert read_plainly(broken_up) == read_plainly(good)


def test_injuries_repeat_with_their_seed_and_differ_without() -> None:
    first, again, other = (injure("written.ply", ALL_SAMPLES["written.ply"], seed, 7) for seed in (1, 1, 2))
    assert first == again != other
    done = {kind for index in range(200) for kind in injure("written.obj", ALL_SAMPLES["written.obj"], 1, index)[1]}
    assert done == {kind.__name__ for kind in INJURIES}


def test_a_process_that_takes_too_long_or_too_much_is_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_bytes(ALL_SAMPLES["written.obj"] + b"v 1 2 3\n" * 300_000)
    for child, outcomes in (
        (Child(), {"read"}),
        (Child(seconds=1e-9), {"hang"}),
        (Child(memory=1 << 20), {"foreign", "crash"}),
    ):
        assert child.read(path)["outcome"] in outcomes
        child.close()


def test_the_series_is_a_part_of_the_endurance_checks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--only", "reading", "--share", "0.0005", "--seed", "3", "--report", str(tmp_path / "report.md")]) == 0
    n = len(ALL_SAMPLES)
    assert f"{n} of {n}" in capsys.readouterr().out
    rows = (tmp_path / "report.md").read_text(encoding="utf-8").splitlines()
    assert rows[-1].startswith(f"| injured files of {n} kinds are refused in words or read rightly | {n} of {n} | 3 | ")


def test_a_small_series_in_a_process_of_its_own() -> None:
    tallies = read_injured(5, SEED, ("written.obj", "rich.glb"))
    assert [(tally.passed, tally.total, tally.failures) for tally in tallies.values()] == [(5, 5, [])] * 2
