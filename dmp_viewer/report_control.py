"""Answers what the user does with the mesh report: look at findings, repair, go back, save what was repaired."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QPoint

from dmp.errors import DmpError
from dmp.geometry import normalised, vertex_normals
from dmp.mesh import TriangleMesh
from dmp.mesh_report import Finding, mesh_report
from dmp.repair import RepairOptions
from dmp_viewer import tasks
from dmp_viewer.control_part import ControlPart
from dmp_viewer.model import Source
from dmp_viewer.repairing import RepairedSource, repair_source
from dmp_viewer.views import dialogs
from dmp_viewer.views.banner import Message
from dmp_viewer.views.finding_marks import FindingMarks
from dmp_viewer.views.mesh_report import NOTHING_ODD, MeshReportDialog, RepairChoice, ReportRow

if TYPE_CHECKING:
    from dmp_viewer.controller import Controller

_LOG = logging.getLogger(__name__)
# What repair does on request, by the finding that makes it worth offering.
_CHOICES = {
    "non-manifold edges": RepairChoice("split", "Take the surface apart where it branches"),
    "non-manifold vertices": RepairChoice("split", "Take the surface apart where it branches"),
    "close vertices": RepairChoice("weld", "Join vertices nearer than a hundredth of an edge length"),
    "separate pieces": RepairChoice("largest", "Keep only the piece with the most faces"),
}
_OPTIONS: dict[str, dict[str, Any]] = {"split": {"split": True}, "weld": {"weld": 0.01}, "largest": {"keep_pieces": 1}}
_REMEDIES = {
    "split": "Repair can take it apart there.",
    "weld": "Repair can join them.",
    "largest": "Repair can keep only the one with the most faces.",
}
# Places within so small a part of the mesh are looked at from near.
_NEAR = 0.3


class ReportControl(ControlPart):
    """The part of the controller that is about what is odd with the open mesh.

    Args:
        controller: whose window and workspace it works on.
    """

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self.dialog: MeshReportDialog | None = None
        self.marks = FindingMarks(self._window.panes)
        self.findings: tuple[Finding, ...] = ()
        # Why there are no findings yet; empty when there are, or when there is nothing to find.
        self._unknown = ""
        self._described: TriangleMesh | None = None
        # Repaired meshes, each with what it was made from, for the way back; the last one is on show.
        self._originals: list[tuple[Source, Source]] = []
        self._window.named_actions["mesh_report"].setEnabled(False)
        self._workspace.problem_changed.connect(self._on_problem_changed)
        self._window.themeChanged.connect(self._on_theme_changed)

    def _do_mesh_report(self) -> None:
        self.open_report()

    def open_report(self) -> None:
        """Show the report of the open mesh."""
        if self._workspace.source is None:
            return
        if self.dialog is None:
            self.dialog = MeshReportDialog(self._window)
            self.dialog.set_theme(self._window.theme)
            self.dialog.shownChanged.connect(self._on_shown_changed)
            self.dialog.repairRequested.connect(self._on_repair_requested)
            self.dialog.backRequested.connect(self.go_back)
            self.dialog.saveRequested.connect(self._on_save_requested)
        self._fill_dialog()
        if not self.dialog.isVisible():
            self._put_beside_the_input()
        self.dialog.show()
        self.dialog.raise_()
        self.dialog.activateWindow()

    def _put_beside_the_input(self) -> None:
        """Let the input pane be seen, where findings are marked."""
        assert self.dialog is not None
        window, dialog = self._window, self.dialog
        dialog.resize(dialog.size().boundedTo(window.size()))
        right = window.mapToGlobal(QPoint(max(0, window.width() - dialog.width() - 24), min(110, window.height() // 8)))
        dialog.move(right)

    # -- finding ------------------------------------------------------------------------------------------------------

    def _on_problem_changed(self) -> None:
        source = self._workspace.source
        self._window.named_actions["mesh_report"].setEnabled(source is not None)
        if source is None or source.mesh is self._described:
            return
        self._described, self.findings, self._unknown = source.mesh, (), "The mesh is being looked over…"
        if not any(source.mesh is known.mesh for pair in self._originals for known in pair):
            self._originals.clear()
        self.marks.clear()
        mesh = source.mesh
        self._controller.background.submit(
            "",
            lambda: mesh_report(mesh),
            lambda findings: self._on_findings(source, findings),
            lambda error: self._on_not_looked_over(source, error),
        )
        if self.dialog is not None:
            self._fill_dialog()

    def _on_findings(self, source: Source, findings: tuple[Finding, ...]) -> None:
        if source.mesh is not self._described:
            return  # another one was opened meanwhile
        self.findings, self._unknown = findings, ""
        if self.dialog is not None:
            self._fill_dialog()
        warnings = [finding for finding in findings if finding.severity == "warning"]
        is_looked_at = self.dialog is not None and self.dialog.isVisible()
        if warnings and self._workspace.run is None and not is_looked_at:
            more = f" {len(warnings) - 1} more in the report." if len(warnings) > 1 else ""
            text = f"{warnings[0].text} {warnings[0].meaning}{more}"
            self._controller.say(Message("warning", text, action=("Mesh report…", self.open_report)))

    def _on_not_looked_over(self, source: Source, error: Exception) -> None:
        _LOG.warning("The mesh cannot be looked over: %s", error)
        if source.mesh is self._described:
            self._unknown = "This mesh could not be looked over."
            self._fill_dialog()

    def _fill_dialog(self) -> None:
        source, dialog = self._workspace.source, self.dialog
        if source is None or dialog is None:
            return
        self.marks.clear()
        choices = {choice.name: choice for finding in self.findings if (choice := _CHOICES.get(finding.kind)) is not None}
        rows = [
            ReportRow(
                finding.severity == "warning",
                finding.text,
                finding.meaning,
                _remedy(finding),
                finding.remedy == "repair",
                bool(len(finding.vertices)),
            )
            for finding in self.findings
        ]
        size = f"{source.mesh.n_vertices:,} vertices, {source.mesh.n_faces:,} faces"
        name = source.path.name if source.path is not None else source.name
        can_go_back = self._original_of(source) is not None
        dialog.set_empty(self._unknown or NOTHING_ODD)
        dialog.set_report(
            f"{name}  ·  {size}", rows, list(choices.values()), can_go_back=can_go_back, can_save=source.path is None
        )

    def _on_shown_changed(self, index: int) -> None:
        source, problem = self._workspace.source, self._workspace.problem
        if source is None or problem is None or not 0 <= index < len(self.findings):
            self.marks.clear()
            return
        finding, vertices = self.findings[index], source.mesh.vertices
        # Where edges are the matter, dots at their ends would only hide them.
        dots = vertices[finding.vertices] if not len(finding.edges) else np.zeros((0, 3))
        self.marks.show(problem.target, dots, vertices[finding.edges])
        self._look_at(source.mesh, finding, problem.edge_length)

    def _look_at(self, mesh: TriangleMesh, finding: Finding, edge_length: float) -> None:
        places = mesh.vertices[finding.vertices]
        size = float(np.linalg.norm(np.ptp(places, axis=0)))
        if size > _NEAR * float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))):
            return
        direction = normalised(vertex_normals(mesh.vertices, mesh.faces)[finding.vertices].sum(axis=0, keepdims=True))[0]
        self._window.panes.look_at(places.mean(axis=0), direction if direction.any() else None, max(size, 6 * edge_length))

    def _on_theme_changed(self) -> None:
        self.marks.set_theme(self._window.theme)
        if self.dialog is not None:
            self.dialog.set_theme(self._window.theme)

    # -- repairing ----------------------------------------------------------------------------------------------------

    def _on_repair_requested(self, chosen: tuple[str, ...]) -> None:
        source = self._workspace.source
        if source is None or self.dialog is None or not self._controller.may_leave_training("repair the mesh"):
            return
        options: dict[str, Any] = {}
        for name in chosen:
            options.update(_OPTIONS[name])
        settings = self._controller.opener.settings_for_opening()
        self.dialog.set_busy(True)
        self._controller.background.submit(
            "Repairing…",
            lambda: repair_source(source, RepairOptions(**options), settings),
            lambda result: self._on_repaired(source, result),
            self._on_repair_failed,
        )

    def _on_repaired(self, source: Source, result: RepairedSource) -> None:
        if self.dialog is not None:
            self.dialog.set_busy(False)
        if source is not self._workspace.source:
            return  # another one was opened meanwhile
        if result.opened is None:
            self._controller.say(Message("info", "Nothing had to be repaired."))
            return
        self._originals.append((result.opened.source, source))
        self._window.banners.clear()
        self._controller.opener.show_opened(result.opened)
        text = " ".join(change.text for change in result.changes)
        if result.lost_truth:
            text += " The ground truth was left out, because it belongs to the mesh as it was."
        self._controller.say(Message("success", text, action=("Back to the original", self.go_back)))
        self._fill_dialog()

    def _on_repair_failed(self, error: Exception) -> None:
        if self.dialog is not None:
            self.dialog.set_busy(False)
        self._controller.tell_error(error, "Repairing")

    def _original_of(self, source: Source | None) -> Source | None:
        """Return what the mesh on show was made from, or None when it was not repaired."""
        # By the mesh: a source is made anew when it gets a ground truth.
        if source is None or not self._originals or self._originals[-1][0].mesh is not source.mesh:
            return None
        return self._originals[-1][1]

    def go_back(self) -> None:
        """Show the mesh as it was before its repair."""
        original = self._original_of(self._workspace.source)
        if original is None or not self._controller.may_leave_training("go back to the original"):
            return
        settings, loops = self._controller.opener.settings_for_opening(), None
        self._controller.background.submit(
            "Setting up…",
            lambda: tasks.set_up(original, settings, loops),
            self._on_original_set_up,
            lambda error: self._controller.tell_error(error, "Going back"),
        )

    def _on_original_set_up(self, opened: tasks.OpenedMesh) -> None:
        if self._original_of(self._workspace.source) is not opened.source:
            return  # another one was opened meanwhile
        self._originals.pop()
        self._window.banners.clear()
        self._controller.opener.show_opened(opened)
        self._fill_dialog()

    # -- saving -------------------------------------------------------------------------------------------------------

    def _on_save_requested(self) -> None:
        from dmp.meshio import WRITABLE_SUFFIXES, write_mesh

        source = self._workspace.source
        if source is None:
            return
        original = self._original_of(source)
        folder = original.folder if original is not None and original.folder is not None else None
        place = folder or Path(self._controller.preferences.folder or Path.home())
        suffixes = tuple(sorted(WRITABLE_SUFFIXES, key=lambda suffix: suffix != ".ply"))
        path = dialogs.ask_save_mesh(self._window, "Save the repaired mesh", place / f"{source.name}.ply", suffixes)
        if path is None:
            return
        if original is not None and original.path is not None and path.exists() and path.samefile(original.path):
            text = f"{path} is the file that was opened. Choose another name, so that it stays as it is."
            self._controller.say(Message("error", text))
            return
        try:
            notes = write_mesh(path, source.mesh)
        except DmpError as error:
            self._controller.tell_error(error)
        else:
            self._controller.say(Message("success", " ".join((f"The mesh was saved as {path}.", *notes))))


def _remedy(finding: Finding) -> str:
    if finding.remedy == "repair":
        return "Repair mends it."
    choice = _CHOICES.get(finding.kind) if finding.remedy == "on request" else None
    return _REMEDIES[choice.name] if choice is not None else ""
