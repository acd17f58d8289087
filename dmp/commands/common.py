"""What all commands share: the texts on stderr, reading with notes, outputs that are refused before the work, exit codes."""

from __future__ import annotations

import os
from pathlib import Path

from rich.console import Console

from dmp.errors import MeshFileError, SettingsError
from dmp.files import in_words
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
    check_place(path)


def check_place(path: Path) -> None:
    """Refuse a file whose name or folder makes that it cannot be written (raises :class:`MeshFileError`)."""
    folder = path.absolute().parent
    try:
        status = path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        status = None
    except OSError as error:
        raise MeshFileError(path, in_words(error), "Choose another name or folder.") from error
    if path.is_dir() or not folder.is_dir():
        cause = "this is a folder" if path.is_dir() else f"the folder {path.parent} does not exist"
        raise MeshFileError(path, cause, "Name a file in a folder that exists.")
    if status is not None and not path.is_symlink() and not path.is_file():
        raise MeshFileError(path, "this is a pipe, a device or a socket, not a file", "Name a file.")
    if not os.access(folder, os.W_OK):
        raise MeshFileError(path, f"the folder {path.parent} cannot be written to", "Choose another folder.")


def refuse_as_output(output: Path, *sources: Path | None) -> None:
    """Refuse an output that is one of the files that are read (raises :class:`MeshFileError`)."""
    for source in sources:
        if source is not None and _is_same_file(output, source):
            raise MeshFileError(output, "this is the file that is read", "Name another one, so that it stays as it is.")


def refuse_within_run(output: Path, run: Path) -> None:
    """Refuse an output that would take the place of a part of a run folder (raises :class:`MeshFileError`)."""
    from dmp.run_upkeep import is_part_of_run

    if is_part_of_run(output, run):
        raise MeshFileError(output, f"this is a part of the run in {run}", "Name a file outside of it.")


def check_report(report: Path | None, output: Path | None, *sources: Path | None) -> None:
    """Refuse a report that could not be written, or would take the place of another file that matters.

    Raises:
        SettingsError: also when it is the output, or one of the files that are read.
    """
    if report is None:
        return
    try:
        check_place(report)
        refuse_as_output(report, *sources)
    except MeshFileError as error:
        raise SettingsError(f"--report {error}") from error
    if output is not None and (_is_same_file(report, output) or report.absolute() == output.absolute()):
        raise SettingsError(f"--report {report}: this is where the mesh is written. Choose another name for the report.")


def _is_same_file(one: Path, other: Path) -> bool:
    """Tell whether two names lead to one file; not when one of them leads to none."""
    try:
        return one.samefile(other)
    except (OSError, ValueError):
        return False


def run_folder(named: Path) -> Path:
    """Return the folder itself, or the one of that name among the runs in the user's data folder."""
    from dmp.runs import default_runs_folder, is_run_folder

    among_runs = default_runs_folder() / named
    try:
        return among_runs if not named.exists() and is_run_folder(among_runs) else named
    except OSError as error:
        raise MeshFileError(named, in_words(error), "Name a run folder, or a run that 'dmp runs' lists.") from error
