"""What leaves the window: the mesh of a step, and pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from qtpy.QtGui import QPixmap

from dmp.errors import DmpError
from dmp.exports.meshes import annotated
from dmp_viewer.model import Workspace
from dmp_viewer.saving import save_picture
from dmp_viewer.views import dialogs
from dmp_viewer.views.banner import Message
from dmp_viewer.views.main_window import MainWindow


class Exporter:
    """Asks where to, writes, and says what was written."""

    def __init__(self, window: MainWindow, workspace: Workspace, say: Callable[[Message], None]) -> None:
        self._window = window
        self._workspace = workspace
        self._say = say

    def save_mesh(self, step: int | None, fallback_folder: str) -> None:
        """Save the predicted mesh of a step where the user wants it, by default beside the input."""
        from dmp.meshio import WRITABLE_SUFFIXES

        source = self._workspace.source
        if step is None or source is None:
            return
        kept = step == self._workspace.kept_step
        title = f"Save the {'kept' if kept else 'shown'} step {step:,}"
        proposal = self._folder(fallback_folder) / f"{source.name}_step{step}.ply"
        suffixes = tuple(sorted(WRITABLE_SUFFIXES, key=lambda suffix: suffix != ".ply"))
        path = dialogs.ask_save_mesh(self._window, title, proposal, suffixes)
        if path is not None:
            self.write_mesh(step, path)

    def write_mesh(self, step: int, path: Path) -> None:
        """Write the predicted mesh of a step."""
        from dmp.meshio import write_mesh

        run, problem = self._workspace.run, self._workspace.problem
        if run is None or problem is None:
            return
        try:
            write_mesh(path, annotated(run.mesh_at(step), problem))
        except DmpError as error:
            self._say(Message("error", str(error)))
        else:
            self._say(Message("success", f"Step {step:,} was saved as {path}."))

    def save_picture(self, fallback_folder: str) -> None:
        """Save a picture of the whole window where the user wants it."""
        source = self._workspace.source
        stem = "dmp-viewer"
        if source is not None:
            step = self._workspace.shown_step
            stem = source.name if step is None else f"{source.name}_step{step}"
        picture = self.picture()  # taken first, so that no dialog is in it
        path = dialogs.ask_save_picture(self._window, self._folder(fallback_folder) / f"{stem}.png")
        if path is None:
            return
        try:
            save_picture(picture, path)
        except DmpError as error:
            self._say(Message("error", str(error)))
        else:
            self._say(Message("success", f"The picture was saved as {path}."))

    def picture(self) -> QPixmap:
        """Return a picture of the whole window, meshes included."""
        return self._window.grab()

    def _folder(self, fallback: str) -> Path:
        source = self._workspace.source
        if source is not None and source.folder is not None:
            return source.folder
        return Path(fallback) if fallback and Path(fallback).is_dir() else Path.home()
