"""What the system refuses to any command: a folder that is gone, too little memory, names that are too long."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

from dmp.errors import DmpError
from dmp.files import in_words

_NO_MEMORY = ("failed to map segment", "cannot allocate memory", "can't allocate memory", "not enough memory")


class WorkingFolderError(DmpError):
    """A command that was started in a folder that is gone."""


def check_working_folder() -> None:
    """Refuse to work in a folder that was deleted: relative names mean nothing there, and torch ends the process.

    Raises:
        WorkingFolderError: when there is no such folder any more.
    """
    try:
        os.getcwd()  # noqa: PTH109, the question is whether it works
    except OSError as error:
        raise WorkingFolderError(
            "The folder you are in was deleted or cannot be entered. Change to another one and run the command again."
        ) from error


def of_the_system(error: Exception) -> str:
    """Return why the system refused, as one or two sentences; nothing for an error that is a fault of this program."""
    text = str(error)
    if isinstance(error, MemoryError) or (
        isinstance(error, ImportError | RuntimeError) and any(words in text.lower() for words in _NO_MEMORY)
    ):
        return "There is not enough memory. Close other programs, raise the limit (ulimit -v), or simplify the mesh first."
    if isinstance(error, OSError):
        file = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else ""
        return f"{file}: {in_words(error)}. Choose another name or place." if file else f"{in_words(error).capitalize()}."
    return ""


def say_plainly(text: str) -> None:
    """Write a line to stderr without anything that would need more memory."""
    with suppress(OSError, ValueError, AttributeError, MemoryError):
        sys.stderr.write(f"{text}\n")
