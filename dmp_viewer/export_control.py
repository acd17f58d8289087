"""Exports from the window: asks what and where to, has it made in another thread, and tells how it went."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from qtpy.QtCore import QTimer, QUrl
from qtpy.QtGui import QDesktopServices

from dmp.errors import DmpError
from dmp.exports.animations import planned
from dmp.exports.curves import write_curve
from dmp.exports.drawing import write_drawing
from dmp.exports.encoding import NO_FFMPEG, find_ffmpeg
from dmp.exports.meshes import annotated
from dmp.exports.watching import CancelledError, Watch
from dmp.mesh import FloatArray
from dmp.runs import Run
from dmp_viewer.background import Background
from dmp_viewer.control_part import ControlPart
from dmp_viewer.export_requests import (
    AnimationRequest,
    CurveRequest,
    MeshRequest,
    Offer,
    PictureRequest,
    ReportRequest,
    Request,
)
from dmp_viewer.export_scenes import Scenery
from dmp_viewer.views import export_dialog
from dmp_viewer.views.banner import Message
from dmp_viewer.views.export_dialog import ExportDialog

if TYPE_CHECKING:
    from dmp_viewer.controller import Controller

# What does the work, in another thread; returns sentences on what was left out.
Work = Callable[[Path, Watch], Sequence[str] | None]
_POLL_MS = 60
_NAMES = {
    MeshRequest: "mesh", PictureRequest: "picture", AnimationRequest: "animation", CurveRequest: "curve",
    ReportRequest: "report",
}  # fmt: skip


class ExportControl(ControlPart):
    """The part of the controller that is about what leaves the window.

    Args:
        controller: whose window and workspace it works on.
    """

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self.background = Background(self)
        self.dialog: ExportDialog | None = None
        self._watch: Watch | None = None
        self._told: tuple[str, int, int] = ("", 0, 0)
        self._timer = QTimer(self)
        self._timer.setInterval(_POLL_MS)
        self._timer.timeout.connect(self._show_progress)
        workspace = self._workspace
        for signal in (
            workspace.problem_changed, workspace.run_changed, workspace.snapshots_changed, workspace.shown_step_changed,
            workspace.kept_step_changed, workspace.colors.changed, workspace.comparison.changed,
        ):  # fmt: skip
            signal.connect(self._on_workspace_changed, check_nargs=False)
        self._renew = QTimer(self)
        self._renew.setSingleShot(True)
        self._renew.timeout.connect(self._set_offer)
        self._window.named_actions["export"].setEnabled(False)

    def _do_export(self) -> None:
        self.open_dialog()

    @property
    def is_busy(self) -> bool:
        """Whether something is being exported."""
        return self._watch is not None

    def open_dialog(self) -> None:
        """Show the dialog."""
        if self._workspace.problem is None:
            return
        if self.dialog is None:
            self.dialog = ExportDialog(self._window)
            self.dialog.exportRequested.connect(self._on_export_requested)
            self.dialog.cancelRequested.connect(self.cancel)
        self._set_offer()
        self.dialog.show()
        self.dialog.raise_()
        self.dialog.activateWindow()

    def cancel(self) -> None:
        """Give up what is being exported."""
        if self._watch is not None:
            self._watch.cancel()

    def close(self) -> None:
        """Give up what is being exported and end the thread."""
        self.cancel()
        self._timer.stop()
        self._renew.stop()
        self.background.close()

    # -- what is there ------------------------------------------------------------------------------------------------

    def _on_workspace_changed(self) -> None:
        self._window.named_actions["export"].setEnabled(self._workspace.problem is not None)
        if self.dialog is not None and self.dialog.isVisible():
            # Once, after the window itself has been drawn.
            self._renew.start(50)

    def _set_offer(self) -> None:
        if self.dialog is not None and self._workspace.problem is not None:
            self.dialog.set_offer(self.offer())

    def offer(self) -> Offer:
        """Return what is there to be exported."""
        workspace, panes = self._workspace, self._window.panes
        source = workspace.source
        ratio = panes.devicePixelRatioF()
        # The step is named elsewhere, and an animation shows others.
        first, middle, last = (title.texts[0].partition(" @ ")[0] for title in panes.titles)
        return Offer(
            stem=source.name if source is not None else "mesh",
            steps=tuple(workspace.snapshot_steps),
            shown_step=workspace.shown_step,
            kept_step=workspace.kept_step,
            pane_names=(first, middle, last),
            color_name=workspace.colors.spec.label if workspace.colors.spec.kind != "none" else "",
            screen_size=(max(64, round(panes.width() * ratio)), max(64, round(panes.height() * ratio))),
            has_curve=len(workspace.curve) > 0,
            no_mp4="" if find_ffmpeg() is not None else NO_FFMPEG,
        )

    # -- exporting ----------------------------------------------------------------------------------------------------

    def _on_export_requested(self, request: Request) -> None:
        if self.is_busy or self._workspace.problem is None:
            return
        proposal = self._folder() / f"{self._stem(request)}{request.suffix}"
        path = export_dialog.ask_target(self.dialog or self._window, f"Export the {_NAMES[type(request)]}", proposal,
                                        (request.suffix,))  # fmt: skip
        if path is not None:
            self.export(request, path)

    def export(self, request: Request, path: Path) -> None:
        """Export into a file, in another thread."""
        try:
            work = self._work(request)
        except DmpError as error:
            self._controller.tell_error(error)
            return
        watch = self._watch = Watch(self._note)
        self._note("Preparing…", 0, 0)
        self._show_progress()
        self._timer.start()
        self.background.submit(
            "", lambda: work(path, watch), lambda notes: self._on_done(request, path, notes), self._on_failed
        )

    def _work(self, request: Request) -> Work:
        """Return what exports; everything that it needs of the window is taken now."""
        workspace = self._workspace
        run, problem = workspace.run, workspace.problem
        assert problem is not None
        match request:
            case PictureRequest():
                sheet, frame = Scenery(self._window, workspace, request.wish).picture()
                sheet = replace(sheet, kind="png" if request.suffix == ".png" else "jpg")
                return lambda path, watch: write_drawing(path, sheet, [frame], 1, watch)
            case AnimationRequest():
                return self._animation(request)
            case CurveRequest():
                rows = [dict(row) for row in workspace.curve.rows]
                settings = run.settings if run is not None else None
                drawn, marks, log = self._window.curve.drawn_names(), self._marks(), self._window.curve.is_log
                name = run.name if run is not None else ""
                return lambda path, _watch: write_curve(path, rows, settings, measures=drawn, marks=marks, title=name, log=log)
            case MeshRequest():
                assert run is not None
                quantity = workspace.colors.quantity if request.has_colors else None

                def write(path: Path, _watch: Watch) -> Sequence[str]:
                    from dmp.meshio import write_mesh

                    mesh = annotated(run.mesh_at(request.step), problem, quantity if quantity != "step" else "magnitude")
                    if not request.has_attributes:
                        names = {"displacement", "displacement_length", "error", "inserted"}
                        kept = {name: values for name, values in mesh.vertex_attributes.items() if name not in names}
                        mesh = replace(mesh, vertex_attributes=kept)
                    return write_mesh(path, mesh)

                return write
            case ReportRequest():
                return self._report(request)

    def _report(self, request: ReportRequest) -> Work:
        from dmp.exports.report import Look, write_report

        run, workspace = self._workspace.run, self._workspace
        if not isinstance(run, Run):
            raise DmpError("A report needs a run with a folder.")
        viewpoint = self._window.panes.viewpoints()[0]
        x, y, z = (place - focus for place, focus in zip(viewpoint.position, viewpoint.focal_point, strict=True))
        quantity = workspace.colors.quantity
        look = Look("magnitude" if quantity == "step" else quantity, workspace.look.policy.up, (x, y, z))
        return lambda path, watch: write_report(path, run, request.step, look, watch)

    def _animation(self, request: AnimationRequest) -> Work:
        run, workspace = self._workspace.run, self._workspace
        scenery = Scenery(self._window, workspace, request.wish)
        plan = request.plan
        if plan.is_turntable and workspace.shown_step is None:
            steps = [0] * len(planned(plan, [0]).steps)
        else:
            steps = planned(plan, workspace.snapshot_steps).steps
        frames = planned(plan, workspace.snapshot_steps or [0])
        known = {step: workspace.snapshot_in_memory(step) for step in set(steps)}
        word = "Completion" if workspace.is_completion else "Predicted"
        has_prediction = workspace.shown_step is not None

        def read(step: int) -> FloatArray:
            snapshot = known.get(step)
            if snapshot is None:
                assert run is not None
                snapshot = run.snapshot(step)
            return snapshot.vertices

        def write(path: Path, watch: Watch) -> None:
            sheet, drawn = scenery.animation(
                steps, read, lambda step: f"{word} @ step {step:,}", turn=plan.turn, has_prediction=has_prediction
            )
            sheet = replace(
                sheet, kind=request.suffix[1:], frames_per_second=frames.frames_per_second, hold_seconds=frames.hold_seconds
            )
            write_drawing(path, sheet, drawn, len(steps), watch)

        return write

    def _marks(self) -> dict[str, int]:
        workspace = self._workspace
        marks = {"kept": workspace.kept_step, "best": workspace.best_step}
        if workspace.suggestion is not None and {"held_out_error", "held_out_risk"} & set(workspace.curve.names()):
            marks["suggested"] = workspace.suggestion.step
        return {name: step for name, step in marks.items() if step is not None}

    # -- how it goes --------------------------------------------------------------------------------------------------

    def _note(self, text: str, done: int, total: int) -> None:
        """Take in how far it is; called in the thread that works."""
        self._told = (text, done, total)

    def _show_progress(self) -> None:
        if self.dialog is not None and self._watch is not None:
            text, done, total = self._told
            self.dialog.set_progress("Cancelling…" if self._watch.is_cancelled else text, done, total)

    def _end(self) -> None:
        self._watch = None
        self._timer.stop()
        if self.dialog is not None:
            self.dialog.set_idle()

    def _on_done(self, request: Request, path: Path, notes: Sequence[str] | None) -> None:
        self._end()
        text = " ".join((f"The {_NAMES[type(request)]} was saved as {path}.", *(notes or ())))
        show = ("Show in folder", lambda: _open_folder(path))
        self._controller.say(Message("success", text, action=show))

    def _on_failed(self, error: Exception) -> None:
        self._end()
        if isinstance(error, CancelledError):
            self._controller.say(Message("info", str(error)))
        else:
            self._controller.tell_error(error, "Exporting")

    # -- names --------------------------------------------------------------------------------------------------------

    def _folder(self) -> Path:
        source = self._workspace.source
        if source is not None and source.folder is not None:
            return source.folder
        fallback = self._controller.preferences.folder
        return Path(fallback) if fallback and Path(fallback).is_dir() else Path.home()

    def _stem(self, request: Request) -> str:
        source, step = self._workspace.source, self._workspace.shown_step
        name = source.name if source is not None else "mesh"
        match request:
            case CurveRequest():
                return f"{name}_curve"
            case AnimationRequest():
                return f"{name}_turn" if request.plan.is_turntable else f"{name}_steps"
            case ReportRequest():
                return f"{name}_report"
            case MeshRequest():
                return f"{name}_step{request.step}"
        return name if step is None else f"{name}_step{step}"


def _open_folder(path: Path) -> None:
    QDesktopServices.openUrl(QUrl.fromLocalFile(str(path.absolute().parent)))
