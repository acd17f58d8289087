"""Two results side by side in the real window: another run with its curve and timeline, and a classical filter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot

from dmp.meshio import read_mesh
from dmp.runs import Run, record
from dmp.settings import settings_for
from dmp_viewer.controller import Controller
from dmp_viewer.views import filter_choice, run_choice
from dmp_viewer.views.filter_choice import FilterChoice, FilterWish
from dmp_viewer.views.mesh_panes import MIDDLE, PREDICTED
from dmp_viewer.views.run_choice import RunChoice
from tests.viewer.conftest import FakeRun, pane_pixels, quick_settings
from tests.viewer.driving import open_files, show_fake, trigger


def train(mesh: Path, folder: Path, **settings: object) -> Run:
    """Train a little without a window."""
    from dmp.methods import training_for
    from dmp.problem import denoising

    wanted = quick_settings(**settings)
    problem = denoising(read_mesh(mesh), wanted)
    run = Run.create(problem, wanted, folder=folder, input_path=mesh)
    training = training_for(problem, wanted)
    training.run_id = run.run_id
    list(record(training, run))
    return run


@pytest.fixture
def two_runs(viewer: Controller, mesh_files: tuple[Path, Path], tmp_path: Path) -> tuple[Controller, Run, Run]:
    """A window with a run, and a second run of the same mesh with more steps."""
    first = train(mesh_files[0], tmp_path / "runs" / "first", steps=10)
    second = train(mesh_files[0], tmp_path / "runs" / "second", steps=20, seed=7)
    open_files(viewer, first.folder)
    return viewer, first, second


def compare(viewer: Controller, monkeypatch: pytest.MonkeyPatch) -> list[list[run_choice.RunEntry]]:
    """Choose the first run that is offered; returns what was offered."""
    offered: list[list[run_choice.RunEntry]] = []

    def answer(_parent: object, runs: list[run_choice.RunEntry], _folder: Path) -> Path:
        offered.append(runs)
        return runs[0].folder

    monkeypatch.setattr(run_choice, "ask_run_to_compare", answer)
    trigger(viewer, "compare_run")
    assert viewer.background.wait(20)
    viewer.presenter.flush()
    return offered


def test_another_run_is_laid_beside_the_one_on_show(
    two_runs: tuple[Controller, Run, Run], monkeypatch: pytest.MonkeyPatch, qtbot: QtBot
) -> None:
    viewer, _, second = two_runs
    window = viewer.window
    smoothed = pane_pixels(viewer, MIDDLE)
    heights = window.panes.interactor.height()
    offered = compare(viewer, monkeypatch)
    assert [entry.folder for entry in offered[0]] == [second.folder]
    assert "20 steps" in offered[0][0].details
    assert window.panes.titles[MIDDLE].texts[0] == "Run “compact” @ step 20"
    assert second.name in window.panes.titles[MIDDLE].texts[1]
    assert window.other_timeline.isVisible()
    assert window.other_timeline.label == "Step 20 of 20"
    assert window.panes.interactor.height() == heights
    last = pane_pixels(viewer, MIDDLE)
    assert (last != smoothed).any(axis=2).mean() > 0.05
    trigger(viewer, "other_previous")
    assert window.other_timeline.label == "Step 15 of 20"
    assert (pane_pixels(viewer, MIDDLE) != last).any()
    window.other_timeline.slider.setValue(0)
    viewer.presenter.flush()
    assert window.panes.titles[MIDDLE].texts[0] == "Run “compact” @ step 0"
    assert viewer.workspace.shown_step == 10

    plot = window.curve.plot
    assert plot._other["data_loss"][0].isVisible()
    assert plot._other["data_loss"][0].getData()[0].max() == 20
    window.curve.set_shown_step(10)
    expected = next(row for row in second.curve() if row["step"] == 10)["data_loss"]
    assert float(window.curve.legend.other_value_shown("data_loss")) == pytest.approx(expected, rel=1e-3)
    trigger(viewer, "forget_other")
    assert not window.other_timeline.isVisible()
    assert window.panes.titles[MIDDLE].texts[0] == "Smoothed"
    assert plot._other == {}


def test_both_runs_can_be_swiped(two_runs: tuple[Controller, Run, Run], monkeypatch: pytest.MonkeyPatch) -> None:
    viewer, _, _ = two_runs
    compare(viewer, monkeypatch)
    trigger(viewer, "against_middle")
    trigger(viewer, "swipe")
    assert viewer.window.panes.titles[PREDICTED].texts[0] == "Run “compact” @ step 20  |  Predicted @ step 10"
    state = viewer.workspace.comparison.compared_state()
    assert state is not None
    assert state.key == ("run", 20)


def test_losses_of_another_method_are_hidden_at_first(viewer: Controller, trained_run: FakeRun) -> None:
    from dmp_viewer.other_run import OtherRun

    other = FakeRun(trained_run.problem, settings_for(preset="best", steps=40, snapshot_every=10))
    list(other.records())
    other.rows = [
        {"step": row["step"], "seconds": 1.0, "normal_loss": -1.0, "position_loss": 0.1, "mad": row["mad"]}
        for row in other.rows
    ]
    show_fake(viewer, trained_run)
    viewer.presenter._draw_curve()
    viewer.workspace.comparison.set_other(OtherRun(other))
    viewer.presenter.flush()
    curve = viewer.window.curve
    assert "normal_loss" not in curve.drawn_names()
    assert "mad" in curve.drawn_names()
    assert curve._log_box.isEnabled()
    # A value below zero makes the axis linear when it is asked for, and logarithmic again when it goes.
    for enabled in (False, True):
        curve.legend.button("normal_loss").click()
        assert curve._log_box.isEnabled() is enabled


def test_a_run_can_be_chosen_from_the_list_or_from_elsewhere(
    viewer: Controller, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dmp_viewer.views import dialogs

    entries = [run_choice.RunEntry(tmp_path / name, name, "10 steps") for name in ("a", "b")]
    dialog = RunChoice(viewer.window, entries, tmp_path)
    dialog.list.setCurrentRow(1)
    dialog.compare.click()
    assert dialog.chosen == tmp_path / "b"
    empty = RunChoice(viewer.window, [], tmp_path)
    assert not empty.compare.isEnabled()
    monkeypatch.setattr(dialogs, "ask_run", lambda *_: tmp_path / "c")
    empty.elsewhere.click()
    assert empty.chosen == tmp_path / "c"


def test_what_is_no_run_of_this_mesh_is_told(viewer: Controller, trained_run: FakeRun, tmp_path: Path) -> None:
    show_fake(viewer, trained_run)
    viewer.comparing.compare_with(trained_run.problem, tmp_path)
    assert viewer.background.wait(20)
    assert str(tmp_path) in viewer.window.banners.texts()[-1]
    assert viewer.workspace.comparison.other is None


# -- filters ----------------------------------------------------------------------------------------------------------


def test_a_filter_is_shown_in_the_middle_pane_with_its_mad(
    viewer: Controller, trained_run: FakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    show_fake(viewer, trained_run)
    smoothed = pane_pixels(viewer, MIDDLE)
    asked = []

    def answer(_parent: object, *, has_truth: bool, before: FilterWish | None) -> FilterWish:
        asked.append((has_truth, before))
        return FilterWish("taubin", {"passes": 4})

    monkeypatch.setattr(filter_choice, "ask_filter", answer)
    trigger(viewer, "compare_filter")
    assert viewer.comparing.wait(30)
    viewer.presenter.flush()
    title, facts = viewer.window.panes.titles[MIDDLE].texts
    assert title == "Taubin"
    assert facts.startswith("MAD ")
    assert "passes 4" in facts
    assert (pane_pixels(viewer, MIDDLE) != smoothed).any(axis=2).mean() > 0.05
    trigger(viewer, "compare_filter")
    assert viewer.comparing.wait(30)
    assert asked == [(True, None), (True, FilterWish("taubin", {"passes": 4}))]


def test_a_filter_that_fails_is_told(viewer: Controller, trained_run: FakeRun) -> None:
    show_fake(viewer, trained_run)
    viewer.comparing.filter_with(trained_run.problem, FilterWish("taubin", {"passes": -1}))
    assert viewer.comparing.wait(30)
    assert "passes of the filter taubin must be" in viewer.window.banners.texts()[-1]


def test_the_filter_dialog_gives_what_it_shows(viewer: Controller) -> None:
    from dmp.filters import FILTERS

    for name, chosen in FILTERS.items():
        dialog = FilterChoice(viewer.window, has_truth=True, before=FilterWish(name))
        assert dialog.wish == FilterWish(name, {item.name: item.default for item in chosen.parameters})
        assert chosen.checked(dialog.wish.parameters)
    dialog = FilterChoice(viewer.window, has_truth=True, before=FilterWish("taubin", {"passes": 3, "shrink": 0.25}))
    assert dialog.wish.parameters["passes"] == 3
    assert dialog.wish.parameters["shrink"] == pytest.approx(0.25)
    dialog.tune.setChecked(True)
    assert dialog.wish == FilterWish("taubin", is_tuned=True)
    assert not FilterChoice(viewer.window, has_truth=False, before=FilterWish("taubin", is_tuned=True)).wish.is_tuned


def test_a_filter_of_a_mesh_that_is_gone_is_not_shown(viewer: Controller, trained_run: FakeRun) -> None:
    from dmp.problem import denoising
    from dmp_viewer.model import Source
    from tests.meshes import sphere_mesh

    show_fake(viewer, trained_run)
    viewer.comparing.filter_with(trained_run.problem, FilterWish("laplacian", {"steps": 2}))
    other = denoising(sphere_mesh(2), settings_for())
    viewer.workspace.open_problem(other, Source("other", other.mesh))
    assert viewer.comparing.wait(30)
    assert viewer.workspace.comparison.filtered is None
    assert np.isfinite(pane_pixels(viewer, MIDDLE)).all()
