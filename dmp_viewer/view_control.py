"""Answers what the user does about the window itself: from where the meshes are seen, and where its parts are."""

from __future__ import annotations

from dmp_viewer.control_part import ControlPart


class ViewControl(ControlPart):
    """The part of the controller for sides and layout."""

    def _do_view_front(self) -> None:
        self._window.panes.look_from("front")

    def _do_view_side(self) -> None:
        self._window.panes.look_from("side")

    def _do_view_top(self) -> None:
        self._window.panes.look_from("top")

    def _do_view_oblique(self) -> None:
        self._window.panes.reset_view()

    def _do_reset_layout(self) -> None:
        window, actions = self._window, self._window.named_actions
        window.reset_layout()
        for name in ("show_panel", "show_curve", "show_thumbnails"):
            actions[name].setChecked(True)
        window.timeline.set_strip_wanted(True)
        self._controller.preferences.show_thumbnails = True
