"""The arithmetic of the tables, against records written by hand."""

from __future__ import annotations

import csv
import io
import math

import pytest

from dmp.experiments.development import summary
from dmp.experiments.laplacian import close_share
from dmp.experiments.store import Chosen, JobRecord
from dmp.experiments.suggested_step import regret
from dmp.experiments.tables import Cell, Row, Table, measure


def record(with_truth: float, without_truth: float, last: float) -> JobRecord:
    values = {"with_truth": with_truth, "without_truth": without_truth, "last": last}
    return JobRecord({name: Chosen("step 1", {"mad": value, "flipped_faces": 0.25}, step=1) for name, value in values.items()})


def test_a_cell_is_the_mean_over_seeds_with_the_sample_deviation() -> None:
    cell = measure([record(2.0, 0, 0), record(3.0, 0, 0), record(7.0, 0, 0)], "with_truth", "mad")
    assert cell.mean == pytest.approx(4.0)
    assert cell.deviation == pytest.approx(math.sqrt((4 + 1 + 9) / 2))
    assert cell.text == "4.00 ± 2.65"


def test_one_seed_has_no_deviation_and_a_factor_changes_the_unit() -> None:
    cell = measure([record(2.0, 0, 0)], "with_truth", "flipped_faces", 1, 100.0)
    assert (cell.mean, cell.deviation, cell.text) == (25.0, None, "25.0")


def test_what_was_not_measured_is_a_dash_with_its_reason() -> None:
    empty = [
        measure([JobRecord(failure="The mesh has a handle.")], "with_truth", "mad"),
        measure([None], "with_truth", "mad"),
        measure([record(1, 2, 3)], "with_truth", "no such measure"),
    ]
    assert [cell.text for cell in empty] == ["–"] * 3
    table = Table("T", ("mesh",), ("a", "b", "c"), (Row(("sheep",), tuple(empty)),))
    assert "Empty cells: sheep: The mesh has a handle. sheep: not done yet." in table.markdown


def test_a_seed_that_failed_leaves_the_mean_of_the_others() -> None:
    cell = measure([record(2.0, 0, 0), JobRecord(failure="no"), record(4.0, 0, 0)], "with_truth", "mad")
    assert cell.values == (2.0, 4.0)
    assert cell.reason == ""


def test_markdown_prints_the_lowest_of_each_column_in_bold() -> None:
    rows = (
        Row(("a",), (Cell((1.0,)), Cell((5.0,)))),
        Row(("b",), (Cell((2.0,)), Cell())),
        Row(("c",), (Cell((1.5,)), Cell((4.0,)))),
    )
    lines = Table("T", ("m",), ("x", "y"), rows, bold=True).markdown.splitlines()
    assert lines[2:] == [
        "| m | x | y |",
        "| --- | ---: | ---: |",
        "| a | **1.00** | 5.00 |",
        "| b | 2.00 | – |",
        "| c | 1.50 | **4.00** |",
    ]


def test_csv_has_each_number_in_full_and_reads_back() -> None:
    table = Table("T", ("mesh",), ("MAD, degrees", "other"), (Row(('a "b"',), (Cell((1 / 3, 2 / 3)), Cell(reason="why, so"))),))
    first, second = csv.DictReader(io.StringIO(table.csv))
    assert (first["mesh"], first["measure"], first["n"]) == ('a "b"', "MAD, degrees", "2")
    assert float(first["mean"]) == 0.5
    assert [float(text) for text in first["values"].split()] == [1 / 3, 2 / 3]
    assert (second["mean"], second["n"], second["reason"]) == ("", "0", "why, so")


def test_wins_and_ratios_against_tuned_filters() -> None:
    table = summary({"mad": [(1.0, 2.0), (3.0, 2.0), (2.0, 2.0), (1.0, 4.0)], "vertex_error": []})
    meshes, wins, ratio = (cell.mean for cell in table.rows[0].cells)
    # A tie is no win; the ratios are 0.5, 1.5, 1 and 0.25.
    assert (meshes, wins, ratio) == (4, 50, 0.75)
    assert [cell.mean for cell in table.rows[1].cells] == [0, None, None]


def test_regret_is_what_a_choice_loses_against_the_best_step() -> None:
    assert regret(record(5.0, 5.5, 7.0)) == pytest.approx(0.5)
    assert regret(record(5.0, 5.5, 7.0), "last") == pytest.approx(2.0)


def test_the_breadth_of_a_minimum_is_the_share_of_steps_near_it() -> None:
    curve: dict[str, list[float | None]] = {"step": [0, 1, 2, 3, 4], "mad": [9.0, 5.4, 5.0, 5.5, 5.6]}
    assert close_share(JobRecord(curve=curve)) == pytest.approx(3 / 5)
