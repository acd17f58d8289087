"""Answers what the user does to compare with another run or with a classical filter."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dmp.filters import FILTERS
from dmp.metrics import GroundTruth
from dmp.problem import Problem
from dmp.runs import default_runs_folder
from dmp_viewer.background import Background
from dmp_viewer.comparing import FilteredMesh, RunEntry, comparable_runs, open_other, run_filter, run_tuned_filter
from dmp_viewer.control_part import ControlPart
from dmp_viewer.other_run import OtherRun
from dmp_viewer.views import filter_choice, run_choice
from dmp_viewer.views.banner import Message
from dmp_viewer.views.filter_choice import FilterWish

if TYPE_CHECKING:
    from dmp_viewer.controller import Controller


class ComparingControl(ControlPart):
    """The part of the controller that lays other results beside the run on show.

    Args:
        controller: whose window and workspace it works on.
    """

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self._wish: FilterWish | None = None
        # Of its own: a filter can take minutes, and files are to be opened meanwhile.
        self._filtering = Background(self)
        self._filtering.busyChanged.connect(controller.window.statusBar().showMessage)

    @property
    def is_filtering(self) -> bool:
        """Whether a filter is at work."""
        return self._filtering.is_busy

    def wait(self, seconds: float) -> bool:
        """Pump events until no filter is at work; tells whether that was reached in time."""
        return self._filtering.wait(seconds)

    def close(self) -> None:
        """Wait for no filter any more; one that is at work ends with the program."""
        self._filtering.close(0.1)

    def _do_compare_run(self) -> None:
        problem, run = self._workspace.problem, self._workspace.run
        if problem is None:
            return
        folder, shown = self._controller.runs_folder, run.run_id if run is not None else None
        self._controller.background.submit(
            "Looking for runs of this mesh…",
            lambda: comparable_runs(folder, problem, shown),
            lambda runs: self._choose(problem, runs),
            lambda error: self._controller.tell_error(error, "Looking for runs"),
        )

    def _choose(self, problem: Problem, runs: list[RunEntry]) -> None:
        folder = self._controller.runs_folder or default_runs_folder()
        path = run_choice.ask_run_to_compare(self._controller.window, runs, folder)
        if path is not None:
            self.compare_with(problem, path)

    def compare_with(self, problem: Problem, folder: Path) -> None:
        """Lay the run in a folder beside the one on show."""

        def show(other: OtherRun) -> None:
            if self._workspace.problem is problem:
                self._workspace.comparison.set_other(other)

        self._controller.background.submit(
            f"Opening the run {folder.name}…",
            lambda: open_other(folder, problem),
            show,
            lambda error: self._controller.tell_error(error, f"Opening {folder.name}"),
        )

    def _do_compare_filter(self) -> None:
        problem = self._workspace.problem
        if problem is None:
            return
        if self.is_filtering:
            self._controller.say(Message("info", "A filter is at work already. Its result comes in the middle pane."))
            return
        has_truth = isinstance(problem.ground_truth, GroundTruth)
        wish = filter_choice.ask_filter(self._controller.window, has_truth=has_truth, before=self._wish)
        if wish is not None:
            self._wish = wish
            self.filter_with(problem, wish)

    def filter_with(self, problem: Problem, wish: FilterWish) -> None:
        """Show what a filter makes of the input in the middle pane."""

        def show(result: FilteredMesh) -> None:
            if self._workspace.problem is not None and self._workspace.problem.mesh.same_connectivity(problem.mesh):
                self._workspace.comparison.set_filtered(result.title, result.details, result.positions)

        title = FILTERS[wish.name].title
        self._filtering.submit(
            f"{title}: looking for its best parameters…" if wish.is_tuned else f"{title} is at work…",
            lambda: run_tuned_filter(problem, wish.name) if wish.is_tuned else run_filter(problem, wish.name, wish.parameters),
            show,
            lambda error: self._controller.tell_error(error, title),
        )

    def _do_forget_other(self) -> None:
        self._workspace.comparison.set_other(None)
