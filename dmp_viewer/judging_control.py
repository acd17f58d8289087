"""Answers what the user does to judge a prediction: colours, shading, comparing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dmp.errors import DmpError
from dmp.vertex_measures import extent
from dmp_viewer.colors import QUANTITIES, Limits
from dmp_viewer.comparison import Middle, Mode
from dmp_viewer.control_part import ControlPart
from dmp_viewer.views import questions
from dmp_viewer.views.buttons import with_key
from dmp_viewer.views.held_key import HeldKey
from dmp_viewer.views.mesh_panes import MIDDLE

if TYPE_CHECKING:
    from dmp_viewer.controller import Controller


class JudgingControl(ControlPart):
    """The part of the controller that is about looking closely.

    Args:
        controller: whose window and workspace it works on.
    """

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        bar, colors = self._window.color_bar, self._workspace.colors
        bar.quantityChosen.connect(lambda value: colors.set(quantity=value))
        bar.rangeChosen.connect(lambda value: colors.set(range=value))
        bar.unitChosen.connect(lambda value: colors.set(unit=value))
        self._window.panes.titles[MIDDLE].set_menu(
            self._window.menu("compare/&Middle pane"),
            "What the middle pane shows",
            with_key("Show something else here", self._window.named_actions["next_middle"]),
        )
        self.flip_key = HeldKey(self._window.named_actions["flip"], lambda: self._workspace.comparison.set_flipped(False))
        picking = self._workspace.picking
        self._window.panes.vertexClicked.connect(picking.pick)
        self._window.picked.stepClicked.connect(self._workspace.show_step)
        bar.limitsWanted.connect(self._do_set_range)
        for signal in (picking.changed, colors.changed, self._workspace.run_changed):
            signal.connect(self._measure_history, check_nargs=False)
        self._workspace.snapshots_changed.connect(self._go_on_with_history, check_nargs=False)
        for signal in (colors.changed, self._workspace.snapshots_changed, self._workspace.problem_changed):
            signal.connect(self._measure_range, check_nargs=False)

    def do(self, name: str) -> bool:
        """Do what an action of this part says; tells whether it is one."""
        if name in QUANTITIES:
            self._workspace.colors.set(quantity=name)
            return True
        if name.startswith("middle_"):
            self._show_in_middle(name.removeprefix("middle_"))  # type: ignore[arg-type]
            return True
        return super().do(name)

    # -- colours and shading ------------------------------------------------------------------------------------------

    def _measure_range(self) -> None:
        """Measure what the range of the whole run still lacks."""
        colors = self._workspace.colors
        steps = colors.steps_to_measure()
        if steps:
            ruler, percentile = colors.ruler(), colors.policy.percentile
            self._controller.scanner.scan(
                "range",
                steps,
                lambda positions: extent(ruler.values(positions), percentile),
                lambda step, size: colors.set_extent(ruler, percentile, step, size),
            )

    def _do_range_step(self) -> None:
        self._workspace.colors.set(range="step")

    def _do_range_run(self) -> None:
        self._workspace.colors.set(range="run")

    def _do_lock_range(self) -> None:
        colors = self._workspace.colors
        colors.set(range="step" if colors.policy.range == "locked" else "locked")

    def _do_outliers(self) -> None:
        self._workspace.colors.set(outliers=not self._workspace.colors.policy.outliers)

    def _do_smooth(self) -> None:
        look = self._workspace.look
        look.set(shading="flat" if look.policy.shading == "smooth" else "smooth")

    def _do_edges(self) -> None:
        self._workspace.look.set(edges=not self._workspace.look.policy.edges)

    def _do_link(self) -> None:
        self._workspace.look.set(linked=not self._workspace.look.policy.linked)

    def _do_z_up(self) -> None:
        look = self._workspace.look
        look.set(up="y" if look.policy.up == "z" else "z")
        self._controller.preferences.up = look.policy.up

    def _do_orthographic(self) -> None:
        self._workspace.look.set(orthographic=not self._workspace.look.policy.orthographic)

    def _do_set_range(self) -> None:
        colors = self._workspace.colors
        if self._workspace.problem is None or not colors.has_values:
            return
        limits, (factor, unit) = colors.limits(), colors.unit
        ends = questions.ask_range(self._window, limits.low * factor, limits.high * factor, unit)
        if ends is not None:
            colors.lock(Limits(ends[0] / factor, ends[1] / factor))

    # -- one vertex ---------------------------------------------------------------------------------------------------

    def _do_pick_vertex(self) -> None:
        mesh, picking = self._workspace.mesh, self._workspace.picking
        if mesh is not None:
            vertex = questions.ask_vertex(self._window, mesh.n_vertices, picking.vertex or 0)
            if vertex is not None:
                picking.pick(vertex)

    def _do_forget_vertex(self) -> None:
        self._workspace.picking.pick(None)

    def _measure_history(self) -> None:
        self._workspace.picking.forget_history()
        self._go_on_with_history()

    def _go_on_with_history(self) -> None:
        picking = self._workspace.picking
        steps, vertex = picking.missing_steps(), picking.vertex
        if not steps or vertex is None:
            return
        ruler = self._workspace.colors.counting_ruler()
        self._controller.scanner.scan(
            "history",
            steps,
            lambda positions: float(ruler.values(positions)[vertex]),
            lambda step, value: picking.set_value(vertex, step, value),
        )

    # -- comparing ----------------------------------------------------------------------------------------------------

    def _show_in_middle(self, middle: Middle) -> None:
        self._workspace.comparison.show(middle)

    def _do_next_middle(self) -> None:
        self._workspace.comparison.show_next()

    def _do_flip(self) -> None:
        comparison = self._workspace.comparison
        comparison.set_flipped(not comparison.flipped)

    def _do_swipe(self) -> None:
        self._switch("swipe")

    def _do_lens(self) -> None:
        self._switch("lens")

    def _do_against_middle(self) -> None:
        comparison = self._workspace.comparison
        comparison.set_against_middle(not comparison.against_middle)

    def _do_set_reference(self) -> None:
        try:
            self._workspace.comparison.set_reference(self._workspace.shown_step)
        except DmpError as error:
            self._controller.tell_error(error)
            return
        actions = self._window.named_actions
        colors, middle = with_key("by colours", actions["step"]), with_key("in the middle pane", actions["next_middle"])
        text = f"Other steps can be compared with this one now: {colors}, {middle}."
        self._window.statusBar().showMessage(text, 8000)

    def _switch(self, mode: Mode) -> None:
        comparison = self._workspace.comparison
        comparison.set_mode("off" if comparison.mode == mode else mode)
