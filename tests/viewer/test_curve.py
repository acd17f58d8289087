"""The curve as data: rows, series, nearest and best steps, and smoothing that never looks ahead."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dmp.run_files import CURVE_COLUMNS
from dmp_viewer.curve import MEASURE_BY_NAME, MEASURES, Curve, RunningAverage
from dmp_viewer.theme import DARK, LIGHT
from dmp_viewer.views.log_axis import log_ticks

ROWS = [{"step": step, "seconds": step / 2, "data_loss": 10.0 - step, "mad": (step - 3.0) ** 2} for step in range(0, 7)]


def test_every_column_of_a_run_has_a_name_a_help_and_a_colour() -> None:
    measured = set(CURVE_COLUMNS) - {"step", "seconds"}
    assert measured == set(MEASURE_BY_NAME)
    for theme in (LIGHT, DARK):
        assert measured <= set(theme.curves)


def test_a_series_has_the_steps_at_which_it_was_measured() -> None:
    curve = Curve([*ROWS, {"step": 7, "seconds": 4.0, "mad": 1.0}])
    steps, values = curve.series("data_loss")
    assert steps.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert values.tolist() == [10, 9, 8, 7, 6, 5, 4]
    assert curve.series("mad")[0].tolist() == [0, 1, 2, 3, 4, 5, 6, 7]
    assert curve.names() == ["data_loss", "mad"]
    assert curve.lowest("data_loss") == 4
    assert curve.lowest("vertex_error") == math.inf


def test_a_continued_run_takes_the_place_of_what_it_trains_again() -> None:
    curve = Curve(ROWS)
    curve.extend([{"step": 4, "seconds": 9.0, "data_loss": 1.0}])
    assert [row["step"] for row in curve.rows] == [0, 1, 2, 3, 4]
    assert curve.series("data_loss")[1].tolist() == [10, 9, 8, 7, 1]
    assert curve.generation == 1


@pytest.mark.parametrize(("step", "nearest"), [(-5, 0), (2.4, 2), (2.6, 3), (100, 6)])
def test_the_nearest_row(step: float, nearest: int) -> None:
    row = Curve(ROWS).nearest(step)
    assert row is not None
    assert row["step"] == nearest


def test_an_empty_curve_has_no_nearest_row_and_no_best_step() -> None:
    assert Curve().nearest(3) is None
    assert Curve().best("mad", [1, 2]) is None


def test_the_best_step_is_one_that_can_be_shown() -> None:
    assert Curve(ROWS).best("mad", [0, 2, 4, 6]) == 2
    assert Curve(ROWS).best("mad", [5]) == 5
    assert Curve(ROWS).best("vertex_error", [5]) is None


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=40), st.floats(0, 0.99), st.integers(0, 39))
def test_smoothing_never_looks_ahead(values: list[float], strength: float, cut: int) -> None:
    whole = RunningAverage(strength).follow(np.array(values))
    growing = RunningAverage(strength)
    growing.follow(np.array(values[:cut]))
    assert np.array_equal(growing.follow(np.array(values)), whole)
    assert np.array_equal(RunningAverage(strength).follow(np.array(values[: cut + 1])), whole[: cut + 1])
    assert whole[0] == pytest.approx(values[0])
    assert (whole >= min(values) - 1e-6).all()
    assert (whole <= max(values) + 1e-6).all()


def test_smoothing_is_the_weighted_mean_of_the_past() -> None:
    averaged = RunningAverage(0.5).follow(np.array([1.0, 2.0, 4.0]))
    assert averaged.tolist() == pytest.approx([1, (1 + 2 * 2) / 3, (1 + 2 * 2 + 4 * 4) / 7])


def test_a_constant_stays_whatever_the_strength() -> None:
    assert RunningAverage(5.0).follow(np.full(50, 3.0)).tolist() == pytest.approx([3.0] * 50)


@given(st.floats(-9, 6), st.floats(0.001, 9), st.integers(2, 12))
def test_log_axes_have_few_rising_labels_within_the_range(low: float, span: float, most: int) -> None:
    labelled = [tick for spacing, ticks in log_ticks(low, low + span, most) if spacing is not None for tick in ticks]
    assert len(labelled) <= most
    assert labelled == sorted(labelled)
    assert all(low - 1e-6 <= tick <= low + span + 1e-6 for tick in labelled)


def test_log_axes_label_round_numbers() -> None:
    (_, labelled), *_ = log_ticks(-2.0, 0.0, 8)
    assert [10**tick for tick in labelled] == pytest.approx([0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1])


def test_measures_are_listed_once() -> None:
    assert len({measure.name for measure in MEASURES}) == len({measure.label for measure in MEASURES}) == len(MEASURES)
