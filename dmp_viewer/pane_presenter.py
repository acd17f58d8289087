"""Draws the panes: meshes, their colours and shading, what the prediction is compared with, and the titles."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from dmp.errors import DmpError
from dmp.problem import Problem
from dmp_viewer import curve_notes as notes
from dmp_viewer.colors import QUANTITIES, color_table
from dmp_viewer.hole_presenter import HolePresenter
from dmp_viewer.model import Workspace
from dmp_viewer.ruler import MeshState, direction_colors
from dmp_viewer.states import RunnerState
from dmp_viewer.views.main_window import MainWindow
from dmp_viewer.views.mesh_panes import COMPARED, INPUT, MIDDLE, PANE_NAMES, PREDICTED
from dmp_viewer.views.picked_bar import PickedValue

SEPARATOR = "  ·  "
BEST_TEXTS = {"mad": "best MAD", "hole_distance": "closest to truth"}
_SMOOTHED_TIP = "The input after Laplacian smoothing. The network learns displacements from here."


class PanePresenter:
    """The part of the presenter that knows the meshes; changes nothing in the workspace.

    Args:
        window: the views.
        workspace: what they show.
        holes: draws what belongs to holes.
        tell: is told an error in reading a snapshot.
    """

    def __init__(
        self, window: MainWindow, workspace: Workspace, holes: HolePresenter, tell: Callable[[DmpError], None]
    ) -> None:
        self._window = window
        self._workspace = workspace
        self._holes = holes
        self._tell = tell
        self._drawn: Problem | None = None

    # -- meshes and colours -------------------------------------------------------------------------------------------

    def draw_look(self) -> None:
        """Colour map, edges and cameras."""
        workspace, panes = self._workspace, self._window.panes
        look = workspace.look.policy
        panes.set_color_table(color_table(workspace.colors.quantity))
        panes.set_linked(look.linked)
        panes.set_edges(look.edges)
        panes.set_up(look.up)
        panes.set_orthographic(look.orthographic)

    def draw_switches(self) -> None:
        """What is switched on in menus and the colour bar."""
        workspace, window = self._workspace, self._window
        look, colors, comparison = workspace.look.policy, workspace.colors, workspace.comparison
        actions = window.named_actions
        ranges = {"step": "range_step", "run": "range_run", "locked": "lock_range"}
        for name, on in (
            ("edges", look.edges),
            ("link", look.linked),
            ("z_up", look.up == "z"),
            ("orthographic", look.orthographic),
            ("smooth", look.shading == "smooth"),
            (colors.quantity, True),
            (ranges[colors.policy.range], True),
            ("outliers", colors.policy.outliers),
            ("swipe", comparison.mode == "swipe"),
            ("lens", comparison.mode == "lens"),
            ("flip", comparison.flipped),
            (f"middle_{comparison.shown}", True),
            ("against_middle", comparison.against_middle),
        ):
            actions[name].setChecked(on)
        actions["flip"].setText("Fl&ip to the middle pane" if comparison.against_middle else "Fl&ip to the input")
        window.color_bar.set_policy(colors.quantity, colors.policy.range, colors.policy.unit)
        window.color_bar.set_possible({name for name in window.color_bar.quantities if colors.can_show(name)})

    def draw_mesh(self, problem: Problem) -> bool:
        """Make the panes for another mesh; tells whether it is another one than before."""
        panes, source, known = self._window.panes, self._workspace.source, self._drawn
        self._drawn = problem
        if (
            known is not None
            and (known.mesh is problem.mesh or known.mesh.same_connectivity(problem.mesh))
            and np.array_equal(known.target, problem.target)
        ):
            return False
        input_faces = source.mesh.faces if source is not None and problem.task == "complete" else None
        panes.set_mesh(problem.target, problem.mesh.faces, input_faces)
        self._holes.draw_seam(problem)
        panes.set_positions(INPUT, problem.target)
        panes.reset_view()
        return True

    def draw_input(self) -> None:
        """The input pane."""
        self._draw_state(INPUT, self._workspace.input_state())

    def draw_middle(self) -> None:
        """The middle pane."""
        self._draw_state(MIDDLE, self._read(self._workspace.comparison.state, tell=True))

    def draw_prediction(self) -> None:
        """The predicted pane."""
        self._draw_state(PREDICTED, self._read(self._workspace.predicted_state, tell=True))

    def draw_compared(self) -> None:
        """What the prediction is compared with in its own pane."""
        comparison, panes = self._workspace.comparison, self._window.panes
        if comparison.flipped or comparison.mode != "off":
            state = comparison.compared_state()
            panes.set_compared_faces(as_input=state is not None and state.kind == "input")
            self._draw_state(COMPARED, state)
        panes.set_cut(comparison.mode, flipped=comparison.flipped)

    def draw_scale(self) -> None:
        """The colour bar and the range that all panes share."""
        colors, bar, panes = self._workspace.colors, self._window.color_bar, self._window.panes
        limits = colors.limits()
        panes.set_limits(limits)
        factor, unit = colors.unit
        bar.gradient.set_scale(color_table(colors.quantity), limits, factor, unit, colors.policy.percentile)
        states = [self._workspace.input_state(), self._read(self._workspace.predicted_state)]
        bar.gradient.set_histogram(colors.histogram([state for state in states if state is not None]))

    def _read(self, state: Callable[[], MeshState | None], *, tell: bool = False) -> MeshState | None:
        """Return a state, or None when it cannot be read, which is told once: where it is drawn."""
        try:
            return state()
        except DmpError as error:
            if tell:
                self._tell(error)
            return None

    def _draw_state(self, index: int, state: MeshState | None) -> None:
        workspace, panes = self._workspace, self._window.panes
        panes.set_positions(index, None if state is None else state.positions)
        if state is None or workspace.surface is None:
            return
        is_smooth, quantity = workspace.look.policy.shading == "smooth", workspace.colors.quantity
        normals = None
        if is_smooth or quantity == "normals":
            normals = workspace.surface.fans.normals(state.positions)
        panes.set_normals(index, normals if is_smooth else None)
        if normals is not None and quantity == "normals":
            panes.set_colors(index, direction_colors(normals))
        else:
            panes.set_values(index, workspace.colors.values(state))

    # -- the picked vertex --------------------------------------------------------------------------------------------

    def draw_picked(self) -> None:
        """The mark on the meshes, and the row about the picked vertex."""
        workspace, bar = self._workspace, self._window.picked
        picking, colors = workspace.picking, workspace.colors
        if picking.vertex is None or workspace.problem is None:
            self._window.panes.set_marked_vertex(None)
            bar.set_vertex(None, "", "", [])
            return
        is_inserted = not workspace.problem.known[picking.vertex]
        self._window.panes.set_marked_vertex(picking.vertex, in_input=not is_inserted)
        spec = QUANTITIES[colors.counting_ruler().quantity]
        factor, unit = colors.unit
        shown = []
        for name, read in (
            ("Input", workspace.input_state),
            (self._window.panes.titles[MIDDLE].texts[0], workspace.comparison.state),
            (self._prediction_texts(workspace.shown_step)[0], workspace.predicted_state),
        ):
            state = self._read(read)
            if name == "Input" and is_inserted:
                shown.append(PickedValue(name, "–", "This vertex was inserted by hole filling."))
                continue
            value = None if state is None else picking.value_in(state)
            text = "–" if value is None or not np.isfinite(value) else f"{value * factor:.4g}"
            place = "" if state is None else "at " + ", ".join(f"{number:.6g}" for number in state.positions[picking.vertex])
            shown.append(PickedValue(name, text, place))
        bar.set_vertex(picking.vertex, spec.label, unit, shown)
        state = workspace.input_state()
        level = None if state is None else picking.value_in(state)
        history = {step: value * factor for step, value in picking.history.items()}
        compared = "hole filling alone" if is_inserted else "the input"
        bar.history.set_history(history, None if level is None else level * factor, compared, spec.label, unit)
        bar.history.set_shown_step(workspace.shown_step)

    # -- titles -------------------------------------------------------------------------------------------------------

    def draw_titles(self) -> None:
        """What stands above the panes, the title of the window, and the facts in the status bar."""
        workspace, panes = self._workspace, self._window.panes
        problem, source = workspace.problem, workspace.source
        if problem is None or source is None:
            return
        # The mesh as it was opened: what hole filling inserted is no part of the input.
        mesh = source.mesh if problem.task == "complete" else problem.mesh
        name = source.path.name if source.path is not None else source.name
        facts = [shortened(name), *self._mad(workspace.input_state())]
        facts += [f"{mesh.n_vertices:,} vertices", f"{mesh.n_faces:,} faces"]
        whole = f"{source.path or name}\n{mesh.n_vertices:,} vertices, {mesh.n_faces:,} faces"
        panes.set_title(INPUT, PANE_NAMES[INPUT], facts, whole)
        self._draw_middle_title(source.ground_truth_path)
        self._draw_prediction_title()
        self._window.setWindowTitle(f"{source.name} – dmp-viewer")
        status = [f"{mesh.n_vertices:,} vertices", f"{mesh.n_faces:,} faces", f"mean edge length {problem.edge_length:.4g}"]
        if problem.ground_truth is not None:
            path = source.ground_truth_path
            status.append(f"ground truth: {shortened(path.name)}" if path is not None else "with ground truth")
        self._window.set_facts(SEPARATOR.join(status))

    def _mad(self, state: MeshState | None) -> list[str]:
        mad = None if state is None else self._workspace.mad_of(state)
        return [] if mad is None else [f"MAD {mad:.2f}°"]

    def _draw_middle_title(self, truth_path: Path | None) -> None:
        comparison, panes = self._workspace.comparison, self._window.panes
        state = self._read(comparison.state)
        mad = self._mad(state)
        if state is None:
            panes.set_title(MIDDLE, "Nothing", ["It cannot be shown"])
            return
        match state.kind:
            case "truth":
                facts = [shortened(truth_path.name)] if truth_path is not None else []
                panes.set_title(MIDDLE, "Ground truth", facts, "The clean mesh that everything is measured by.")
            case "step":
                panes.set_title(MIDDLE, f"Reference: step {state.number:,}", mad)
            case "run":
                other = comparison.other
                name = "" if other is None else other.name
                kept = [] if other is None or state.number != other.kept_step else ["kept"]
                panes.set_title(MIDDLE, f"{self._other_name()} @ step {state.number:,}", [*mad, *kept, name], name)
            case "filter" if comparison.filtered is not None:
                filtered = comparison.filtered
                panes.set_title(MIDDLE, filtered.name, [*mad, filtered.details], f"{filtered.name}: {filtered.details}")
            case _:
                panes.set_title(MIDDLE, PANE_NAMES[MIDDLE], [*mad, "base of the displacements"], _SMOOTHED_TIP)

    def _other_name(self) -> str:
        other = self._workspace.comparison.other
        return "" if other is None else f"Run “{other.settings.preset}”"

    def compared_name(self) -> str:
        """Return what the prediction is compared with, in a word or two."""
        comparison = self._workspace.comparison
        if not comparison.against_middle:
            return PANE_NAMES[INPUT]
        return self._window.panes.titles[MIDDLE].texts[0]

    def _draw_prediction_title(self) -> None:
        workspace, panes = self._workspace, self._window.panes
        step, comparison = workspace.shown_step, workspace.comparison
        if comparison.flipped:
            panes.set_title(PREDICTED, self.compared_name(), ["in place of the prediction"])
            return
        name, facts = self._prediction_texts(step)
        if comparison.mode == "swipe":
            name = f"{self.compared_name()}  |  {name}"
        elif comparison.mode == "lens":
            facts.insert(0, f"in the lens: {self.compared_name()}")
        panes.set_title(PREDICTED, name, facts)

    def _prediction_texts(self, step: int | None) -> tuple[str, list[str]]:
        workspace = self._workspace
        if workspace.is_completion and workspace.filling_only:
            return "Hole filling alone", [*self._holes.facts(), "nothing is learnt"]
        if step is None:
            waiting = workspace.state in (RunnerState.PREPARING, RunnerState.RUNNING)
            hint = "The first prediction comes in a moment" if waiting else "Press Start to train the network on this mesh"
            return PANE_NAMES[PREDICTED], [hint]
        facts = self._mad(self._read(workspace.predicted_state))
        facts += self._holes.facts()
        if step == 0:
            facts.append("the untrained network")
        if step == workspace.kept_step:
            facts.append("kept")
        suggestion = None if notes.is_judged_by_rest(workspace) else workspace.suggestion
        if suggestion is not None and step == suggestion.step and step != 0:
            facts.append("suggested")
        if step == workspace.best_step:
            best = BEST_TEXTS[workspace.quality]
            facts.append(f"{best} so far" if workspace.state.is_active else best)
        if not facts and step == workspace.latest_step:
            facts.append("latest")
        name = "Completion" if workspace.is_completion else PANE_NAMES[PREDICTED]
        return f"{name} @ step {step:,}", facts


def shortened(name: str, most: int = 26) -> str:
    """Return a file name with its middle left out when it is long; beginning and suffix tell most."""
    return name if len(name) <= most else f"{name[: most - 11]}…{name[-10:]}"
