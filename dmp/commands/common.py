"""What all commands share: the texts on stderr, reading with notes, outputs that are refused before the work, exit codes."""

from __future__ import annotations

import os
from pathlib import Path

from rich.console import Console

from dmp.errors import MeshFileError
from dmp.mesh import TriangleMesh

EXIT_DONE, EXIT_FAULT, EXIT_USAGE, EXIT_INTERRUPTED = 0, 1, 2, 130


def say(text: str, quiet: bool = False) -> None:
    """Write a line to stderr, where it is not mixed with what a command prints, unless ``quiet``."""
    if not quiet:
        Console(stderr=True, highlight=False, soft_wrap=True).print(text, markup=False)


def load(path: Path, quiet: bool = False) -> TriangleMesh:
    """Read a mesh and say what was changed in reading (raises :class:`dmp.errors.MeshFileError`)."""
    from dmp.meshio import read_mesh_with_notes

    mesh, notes = read_mesh_with_notes(path)
    for note in notes:
        say(f"{path}: {note}", quiet)
    return mesh


def check_output(path: Path) -> None:
    """Refuse an output that could not be written after the work is done (raises :class:`MeshFileError`)."""
    from dmp.meshio import WRITABLE_SUFFIXES

    if path.suffix.lower() not in WRITABLE_SUFFIXES:
        raise MeshFileError(path, "the name says no format that can be written", f"End it in {', '.join(WRITABLE_SUFFIXES)}.")
    if path.is_dir() or not path.absolute().parent.is_dir():
        cause = "this is a folder" if path.is_dir() else f"the folder {path.parent} does not exist"
        raise MeshFileError(path, cause, "Name a file in a folder that exists.")
    if not os.access(path.absolute().parent, os.W_OK):
        raise MeshFileError(path, f"the folder {path.parent} cannot be written to", "Choose another folder.")


def refuse_as_output(output: Path, *sources: Path | None) -> None:
    """Refuse an output that is one of the files that are read (raises :class:`MeshFileError`)."""
    for source in sources:
        if source is not None and output.exists() and source.exists() and output.samefile(source):
            raise MeshFileError(output, "this is the file that is read", "Name another one, so that it stays as it is.")


def run_folder(named: Path) -> Path:
    """Return the folder itself, or the one of that name among the runs in the user's data folder."""
    from dmp.runs import default_runs_folder, is_run_folder

    among_runs = default_runs_folder() / named
    return among_runs if not named.exists() and is_run_folder(among_runs) else named
