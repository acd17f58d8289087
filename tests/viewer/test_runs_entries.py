"""What the list of runs says about each, without a window."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from dmp.mesh import TriangleMesh
from dmp.problem import denoising
from dmp.runs import Run, record
from dmp.settings import settings_for
from dmp_viewer.runs_entries import RunRow, day_text, differing, in_short, matches, row_of, rows_of

_SETTINGS = settings_for(steps=4, snapshot_every=2, threads=1, width_divisor=16)


@pytest.fixture
def run(tmp_path: Path, noisy_sphere: TriangleMesh) -> Run:
    """A run of four steps that has not begun."""
    return Run.create(
        denoising(noisy_sphere, _SETTINGS), _SETTINGS, folder=tmp_path / "runs" / "a", input_path=tmp_path / "scan.ply"
    )


def _train(run: Run, until: int | None = None) -> None:
    records = record(run.resume(), run)
    for item in records:
        if item.step == until:
            break
    records.close()  # type: ignore[attr-defined]


def test_a_run_is_told_from_its_first_day_to_its_last(run: Run) -> None:
    row = row_of(run)
    assert (row.title, row.mesh, row.state, row.size) == ("scan", "scan.ply", "waiting", (258, 512))
    assert row.state_text == "Not begun, 4 steps"
    assert row.can_be_continued
    assert row.pictured_step is None
    _train(run, until=2)
    row = row_of(Run.open(run.folder))
    assert row.state_text == "Stopped at 2 of 4"
    assert row.pictured_step == 2
    _train(Run.open(run.folder))
    done = Run.open(run.folder)
    done.keep(2)
    done.rename("My best")
    row = row_of(done)
    assert row.state_text == "Finished, 4 steps  ·  kept 2"
    assert not row.can_be_continued
    assert row.pictured_step == 2
    assert row.about_text == "scan.ply  ·  Compact  ·  Width divisor 16"


def test_a_run_that_is_being_trained_is_neither_continued_nor_drawn_at_each_step(run: Run) -> None:
    records = record(run.resume(), run)
    assert [next(records).step for _ in range(3)] == [0, 1, 2]
    row = row_of(Run.open(run.folder))
    assert row.state == "running"
    assert not row.can_be_continued
    assert row.pictured_step is None
    records.close()  # type: ignore[attr-defined]


def test_what_cannot_be_read_is_listed_last_with_its_reason(run: Run) -> None:
    broken = run.folder.parent / "0_broken"
    broken.mkdir()
    (broken / "run.json").write_text(json.dumps({"format": 99}))
    good, bad = rows_of(run.folder.parent)
    assert (good.folder, bad.folder) == (run.folder, broken)
    assert (bad.state_text, bad.can_be_opened, bad.can_be_continued) == ("Cannot be read", False, False)
    assert "format 99" in bad.about_text


def test_settings_are_told_by_what_differs() -> None:
    assert in_short(_SETTINGS) == "Remove noise  ·  Compact  ·  4 steps  ·  Width divisor 16"
    assert differing(settings_for("denoise", "paper")) == "Paper"
    assert differing(settings_for("complete")).startswith("Fill holes  ·  ")
    many = replace(settings_for(), seed=1, skip=True, learning_rate=0.5, average=0.5, hold_out=0.0, width_divisor=2)
    assert differing(many) == "Compact  ·  Seed 1  ·  Skip connections on  ·  Width divisor 2  ·  3 more changed"


@pytest.mark.parametrize(
    ("search", "found"),
    [("", True), ("SCAN", True), ("noise scan", True), ("not begun", True), ("scan paper", False), ("width 16", True)],
)
def test_all_words_of_a_search_must_occur(run: Run, search: str, found: bool) -> None:
    assert matches(row_of(run), search) is found


@pytest.mark.parametrize(
    ("created", "told"),
    [
        ("2026-11-22T09:05:00+00:00", "09:05"),
        ("2026-11-02T23:00:00+00:00", "2 Nov"),
        ("2025-11-22T09:05:00+00:00", "2025-11-22"),
        ("no date", ""),
        ("0001-01-01T00:00:00+14:00", ""),
    ],
)
def test_a_date_is_as_short_as_it_can_be(created: str, told: str) -> None:
    assert day_text(created, datetime(2026, 11, 22, 12, 0, tzinfo=UTC)) == told


def test_a_row_says_everything_about_its_run() -> None:
    row = RunRow(Path("/r"), "id", "name", "m.ply", "short", "", "failed", 3, 9, None, "2026-01-02T03:04:05", (5, 6))
    assert replace(row, reason="It broke.").details.splitlines() == [
        "name", "m.ply", "short", "Failed at 3 of 9", "5 vertices, 6 faces", "Made 2026-01-02 03:04", "It broke.", "/r",
    ]  # fmt: skip
