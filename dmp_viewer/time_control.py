"""Answers what the user does to go through time: playing, bookmarks, small pictures, and the steps of a compared run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from qtpy.QtGui import QImage

from dmp.errors import DmpError
from dmp.mesh import FloatArray
from dmp_viewer.control_part import ControlPart
from dmp_viewer.thumbnails import thumbnail
from dmp_viewer.views.thumbnail_strip import PICTURE

if TYPE_CHECKING:
    from dmp_viewer.controller import Controller

_SURFACE = (0.66, 0.74, 0.85)


class TimeControl(ControlPart):
    """The part of the controller that is about steps.

    Args:
        controller: whose window and workspace it works on.
    """

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        workspace, timeline = self._workspace, self._window.timeline
        timeline.stepChosen.connect(workspace.show_step)
        timeline.playToggled.connect(self._window.named_actions["play"].setChecked)
        timeline.speedChosen.connect(self._on_speed_chosen)
        timeline.strip.picturesWanted.connect(self._on_pictures_wanted)
        self._window.other_timeline.stepChosen.connect(workspace.comparison.show_other_step)
        for signal in (workspace.run_changed, workspace.problem_changed):
            signal.connect(self._on_run_changed, check_nargs=False)
        workspace.look.changed.connect(self._on_look_changed, check_nargs=False)
        self._up = workspace.look.policy.up

    # -- moving -------------------------------------------------------------------------------------------------------

    def _do_first_step(self) -> None:
        self._window.timeline.go_to_end(last=False)

    def _do_previous_step(self) -> None:
        self._window.timeline.go(-1)

    def _do_next_step(self) -> None:
        self._window.timeline.go(1)

    def _do_last_step(self) -> None:
        self._window.timeline.go_to_end(last=True)

    def _do_play(self) -> None:
        self._window.timeline.set_playing(not self._window.timeline.is_playing)

    def _do_faster(self) -> None:
        self._window.timeline.change_speed(1)

    def _do_slower(self) -> None:
        self._window.timeline.change_speed(-1)

    def _on_speed_chosen(self, speed: int) -> None:
        self._controller.preferences.play_speed = speed
        self._window.timeline.set_speed(speed)

    def _do_follow(self) -> None:
        self._workspace.set_follow_latest(not self._workspace.follow_latest)

    def _do_show_suggested(self) -> None:
        if self._workspace.suggestion is not None:
            self._workspace.show_step(self._workspace.suggestion.step)

    def _do_show_best(self) -> None:
        if self._workspace.best_step is not None:
            self._workspace.show_step(self._workspace.best_step)

    # -- bookmarks ----------------------------------------------------------------------------------------------------

    def _do_bookmark(self) -> None:
        step = self._workspace.shown_step
        if step is not None:
            try:
                self._workspace.bookmarks.switch(step)
            except DmpError as error:
                self._controller.tell_error(error)

    def _do_next_bookmark(self) -> None:
        self._go_to(self._workspace.bookmarks.after)

    def _do_previous_bookmark(self) -> None:
        self._go_to(self._workspace.bookmarks.before)

    def _go_to(self, find: object) -> None:
        shown = self._workspace.shown_step
        step = find(shown) if shown is not None and callable(find) else None
        if step is not None:
            self._workspace.show_step(step)

    # -- the compared run ---------------------------------------------------------------------------------------------

    def _do_other_previous(self) -> None:
        self._workspace.comparison.show_other_beside(-1)

    def _do_other_next(self) -> None:
        self._workspace.comparison.show_other_beside(1)

    # -- small pictures -----------------------------------------------------------------------------------------------

    def _do_show_thumbnails(self) -> None:
        shown = self._window.named_actions["show_thumbnails"].isChecked()
        self._controller.preferences.show_thumbnails = shown
        self._window.timeline.set_strip_wanted(shown)

    def _on_run_changed(self) -> None:
        self._window.timeline.strip.forget_pictures()

    def _on_look_changed(self) -> None:
        if self._workspace.look.policy.up != self._up:
            self._up = self._workspace.look.policy.up
            self._window.timeline.strip.forget_pictures()

    def _on_pictures_wanted(self, steps: list[int]) -> None:
        mesh, up = self._workspace.mesh, self._up
        if mesh is None:
            return
        ratio = max(1, round(self._window.devicePixelRatioF()))
        width, height = PICTURE.width() * ratio, PICTURE.height() * ratio

        def draw(positions: FloatArray) -> NDArray[np.uint8]:
            return thumbnail(mesh.with_vertices(positions), width, height, _SURFACE, up)

        self._controller.scanner.scan("pictures", steps, draw, self._on_picture_drawn)

    def _on_picture_drawn(self, step: int, pixels: NDArray[np.uint8]) -> None:
        height, width, _ = pixels.shape
        picture = QImage(pixels.tobytes(), width, height, 4 * width, QImage.Format.Format_RGBA8888).copy()
        self._window.timeline.strip.set_picture(step, picture)
