from __future__ import annotations

import numpy as np

from dmp.stopping import suggest


def _curve(error: np.ndarray) -> list[dict[str, float]]:
    return [{"step": 5 * (index + 1), "held_out_error": float(value)} for index, value in enumerate(error)]


def test_the_minimum_of_a_noisy_valley_is_found() -> None:
    steps = np.arange(5, 1005, 5)
    valley = 1 + ((steps - 400) / 400) ** 2 + 0.01 * np.random.default_rng(0).standard_normal(200)
    suggestion = suggest(_curve(valley), range(0, 1001, 25))
    assert suggestion is not None
    assert abs(suggestion.step - 400) <= 50
    assert "lowest" in suggestion.reason


def test_it_is_said_between_which_steps_nothing_gets_better() -> None:
    steps = np.arange(5, 1005, 5)
    # Flat at the bottom from 300 to 600, with steep walls.
    distance = np.clip(np.abs(steps - 450) - 150, 0, None)
    suggestion = suggest(_curve(1 + distance / 100), range(0, 1001, 25))
    assert suggestion is not None
    assert suggestion.between is not None
    first, last = suggestion.between
    assert abs(first - 300) <= 30
    assert abs(last - 600) <= 30
    assert f"between {first} and {last} nothing gets better" in suggestion.reason
    assert first <= suggestion.step <= last
    # A sharp minimum has no such stretch worth telling of, a noisy one a wider one.
    sharp = suggest(_curve(1 + np.abs(steps - 450) / 10), range(0, 1001, 25))
    noise = 0.1 * np.random.default_rng(1).standard_normal(200)
    noisy = suggest(_curve(1 + np.abs(steps - 450) / 1000 + noise), range(0, 1001, 25))
    assert sharp is not None and sharp.between is not None
    assert noisy is not None and noisy.between is not None
    assert np.ptp(sharp.between) < 50 < np.ptp(noisy.between)


def test_a_falling_curve_suggests_the_end_and_says_so() -> None:
    suggestion = suggest(_curve(np.linspace(2, 1, 100)), range(0, 501, 25))
    assert suggestion is not None
    assert suggestion.step == 500
    assert "still falling" in suggestion.reason


def test_without_held_out_vertices_the_last_step_is_suggested() -> None:
    suggestion = suggest([{"step": 5, "data_loss": 1.0}], [0, 25, 50])
    assert suggestion is not None
    assert suggestion.step == 50
    assert suggest([], []) is None


def test_reasons_fit_the_method_and_the_length_of_the_run() -> None:
    short = suggest([{"step": 1, "held_out_error": 0.5}], [0, 1])
    assert short is not None
    assert "so few steps" in short.reason
    other = suggest([{"step": 10, "position_loss": 0.5}], [0, 10])
    assert other is not None
    assert "does not overfit" in other.reason


def _risks(*rows: tuple[int, float, float, int]) -> list[dict[str, float]]:
    names = ("step", "held_out_risk", "held_out_excess", "held_out_lowest_step")
    return [{**dict(zip(names, row, strict=True)), "position_loss": 0.5} for row in rows]


def test_the_last_step_stands_unless_the_risk_has_clearly_risen() -> None:
    still = suggest(_risks((10, 1.0, 0.0, 10), (20, 0.9, 0.0, 20), (30, 0.91, 1.2, 20)), [0, 10, 20, 30])
    assert still is not None
    assert still.step == 30
    assert "has not risen" in still.reason
    risen = suggest(_risks((10, 1.0, 0.0, 10), (20, 0.9, 0.0, 20), (30, 1.1, 3.2, 20)), [0, 10, 20, 30])
    assert risen is not None
    assert risen.step == 20
    assert "clearly lower at step 20" in risen.reason
