"""Errors that are told to the user, in the user's words.

Every error that a person can cause derives from :class:`DmpError`; its text is one or two full sentences that say
what is wrong with which file or value, and what to do. Anything else that escapes is a fault of this program.
"""

from __future__ import annotations

from pathlib import Path


class DmpError(Exception):
    """Base of all errors whose text is meant for the user."""


class MeshError(DmpError):
    """A mesh that cannot be used for what was asked."""


class NoHolesError(MeshError):
    """A mesh without any hole that can be filled: nothing is wrong, and there is nothing to do."""


class NoSphereError(MeshError):
    """A mesh that cannot be spread over a sphere: all else can be done with it."""


class MeshFileError(MeshError):
    """A mesh file that cannot be read or written.

    The text reads ``FILE: CAUSE. REMEDY`` with FILE as the user named it.
    """

    def __init__(self, path: Path | str, cause: str, remedy: str = "") -> None:
        self.path = Path(path)
        self.cause = cause.rstrip(".")
        self.remedy = remedy
        super().__init__(f"{self.path}: {self.cause}. {remedy}".rstrip())


class SettingsError(DmpError):
    """A setting outside its allowed range, or settings that contradict each other."""


class RunError(DmpError):
    """A run folder that cannot be read, written or continued."""


class TrainingError(DmpError):
    """A training that cannot go on, such as one whose numbers are no longer finite."""
