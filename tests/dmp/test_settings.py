from __future__ import annotations

from dataclasses import asdict

import pytest

from dmp.errors import SettingsError
from dmp.settings import SETTING_FIELDS, choices, from_mapping, preset_value, presets_for, settings_for


def test_preset_paper_keeps_the_published_behaviour() -> None:
    paper = settings_for("denoise", "paper")
    assert (paper.scaling, paper.width_divisor, paper.hold_out, paper.average) == ("box", 1, 0.0, 0.0)
    assert (paper.laplacian_weight, paper.learning_rate, paper.smoothing_steps) == (1.4, 0.01, 30)


def test_preset_of_2021_keeps_the_behaviour_of_the_first_published_code() -> None:
    first = settings_for("denoise", "paper-2021-04")
    assert (first.architecture, first.laplacian_form, first.laplacian_epsilon) == ("2021-04", "sum", 1e-6)
    assert (first.laplacian_weight, first.learning_rate, first.steps) == (0.2, 0.01, 4000)
    assert (first.scaling, first.width_divisor, first.hold_out, first.average) == ("box", 1, 0.0, 0.0)


def test_preset_of_2021_cannot_fill_holes_and_says_so() -> None:
    assert presets_for("denoise") == choices("preset")
    assert presets_for("complete") == ("compact", "paper", "best")
    with pytest.raises(SettingsError, match=r"--preset paper-2021-04 is for denoising alone.*compact, paper, best"):
        settings_for("complete", "paper-2021-04")


def test_a_switch_is_true_or_false_and_nothing_else() -> None:
    assert settings_for(skip=True).skip is True
    assert settings_for().skip is False
    assert choices("skip") == ()
    for value in ("true", 1, 0.0, "False"):
        with pytest.raises(SettingsError, match="--skip must be true or false"):
            settings_for(skip=value)
    with pytest.raises(SettingsError, match="--steps must be a whole number"):
        settings_for(steps=True)


def test_preset_values_are_those_of_the_settings() -> None:
    for task in choices("task"):
        for preset in presets_for(task):
            settings = settings_for(task, preset)
            for name in SETTING_FIELDS:
                if name not in ("task", "preset"):
                    assert preset_value(name, task, preset) == getattr(settings, name)


def test_none_means_as_the_preset_says() -> None:
    assert settings_for("denoise", "compact", steps=None, seed=7) == settings_for("denoise", "compact", seed=7)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("steps", 0, "at least 1|between 1"),
        ("steps", 2.5, "whole number"),
        ("hold_out", 0.9, "between 0 and 0.5"),
        ("learning_rate", float("nan"), "finite"),
        ("laplacian_form", "median", "one of"),
        ("device", "gpu", "auto, cpu"),
        ("average", "much", "a number"),
    ],
)
def test_values_out_of_range_are_named(name: str, value: object, words: str) -> None:
    with pytest.raises(SettingsError, match=words) as caught:
        settings_for("denoise", **{name: value})
    assert f"--{name.replace('_', '-')}" in str(caught.value)


def test_unknown_names_and_presets_are_refused() -> None:
    with pytest.raises(SettingsError, match="no setting 'speed'"):
        settings_for("denoise", speed=3)
    with pytest.raises(SettingsError, match="--preset"):
        settings_for("denoise", "fastest")


def test_settings_survive_a_file_and_ignore_names_of_the_future() -> None:
    settings = settings_for("denoise", steps=17, seed=3)
    assert from_mapping({**asdict(settings), "from_the_future": 1}) == settings


def test_every_setting_explains_itself() -> None:
    for name, item in SETTING_FIELDS.items():
        assert item.metadata["help"].endswith("."), name
    assert choices("preset") == ("compact", "paper", "paper-2021-04", "best")
    assert choices("steps") == ()
