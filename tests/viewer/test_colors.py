"""What a colour means: values, ranges shared by all panes, colour maps and ticks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dmp_viewer.colors import Limits, color_table, histogram, limits_for, nice_ticks, unit_of
from dmp_viewer.views.gradient import tick_text


def test_limits_start_at_zero_or_lie_around_it() -> None:
    magnitude, signed = limits_for("magnitude", [0.5, 2.0]), limits_for("signed", [0.5, 2.0])
    assert (magnitude.low, magnitude.high) == (0, 2)
    assert (signed.low, signed.high) == (-2, 2)


@pytest.mark.parametrize(
    ("kind", "unit", "factor", "name"),
    [
        ("length", "edges", 2.0, "edge lengths"),
        ("length", "file", 1.0, "file units"),
        ("length", "diagonal", 10.0, "% of diagonal"),
        ("curvature", "edges", 0.5, "per edge length"),
        ("curvature", "file", 1.0, "per file unit"),
        ("angle", "edges", 1.0, "degrees"),
    ],
)
def test_units(kind: str, unit: str, factor: float, name: str) -> None:
    assert unit_of(kind, unit, 0.5, 10.0) == (pytest.approx(factor), name)  # type: ignore[arg-type]


def test_the_histogram_counts_what_lies_in_the_range() -> None:
    values = np.array([0.1, 0.1, 0.9, 5.0, np.nan], dtype=np.float32)
    counted = histogram(values, np.array([0.6], dtype=np.float32), Limits(0.0, 1.0), bins=2)
    assert counted.counts.tolist() == [2, 1]
    assert counted.share_outside == pytest.approx(0.25)
    assert counted.others is not None
    assert counted.others.tolist() == [0, 1]
    assert histogram(np.full(3, np.nan, dtype=np.float32), None, Limits(0.0, 1.0)).share_outside == 0


@pytest.mark.parametrize("sizes", [[], [0.0], [float("nan")], [float("inf"), 0.0]])
def test_limits_never_collapse(sizes: list[float]) -> None:
    limits = limits_for("magnitude", sizes)
    assert limits.low < limits.high < np.inf


def _lightness(table: np.ndarray) -> np.ndarray:
    linear = (table[:, :3] / 255.0) ** 2.2
    return linear @ [0.2126, 0.7152, 0.0722]


def test_magnitudes_grow_lighter_steadily() -> None:
    table = color_table("magnitude")
    assert table.shape == (256, 4)
    assert (np.diff(_lightness(table)) > -2e-3).all()


def test_signed_values_are_light_at_zero_and_of_two_hues() -> None:
    table = color_table("signed").astype(int)
    assert 120 <= np.argmax(_lightness(table)) <= 135
    assert table[0, 2] > table[0, 0]
    assert table[-1, 0] > table[-1, 2]


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.integers(2, 10))
def test_ticks_are_few_and_within_the_range(low: float, span: float, most: int) -> None:
    ticks = nice_ticks(low, low + span, most)
    assert 1 <= len(ticks) <= most
    slack = 1e-6 * (abs(low) + span)
    assert all(low - slack <= tick <= low + span + slack for tick in ticks)


@pytest.mark.parametrize(
    ("value", "step", "text"),
    [
        (0.0, 0.1, "0"),
        (0.30000000000000004, 0.1, "0.3"),
        (-2.0, 1.0, "−2"),
        (2.5, 2.5, "2.5"),
        (0.25, 0.25, "0.25"),
        (120.0, 20.0, "120"),
    ],
)
def test_tick_texts_have_the_digits_that_their_step_needs(value: float, step: float, text: str) -> None:
    assert tick_text(value, step) == text
