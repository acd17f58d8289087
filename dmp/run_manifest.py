"""``run.json``: what a run folder says about itself, checked before any of it is believed."""

from __future__ import annotations

import hashlib
import json
import platform
import re
import sys
from collections.abc import Mapping
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any
from unicodedata import category

import numpy as np

from dmp.errors import DmpError, RunError
from dmp.problem import Problem
from dmp.run_files import finite
from dmp.run_folder import RunFolder, plain_text
from dmp.settings import Settings, from_mapping

RUN_FORMAT = 1
MANIFEST = "run.json"
STATES = ("running", "stopped", "finished", "failed")
_MOST_STEPS, _MOST_THREADS, _LONGEST_PATH = 10**9, 1024, 4096


def new_manifest(
    problem: Problem, settings: Settings, *, name: str, input_path: Path | None, ground_truth_path: Path | None, run_id: str
) -> dict[str, Any]:
    """Return the description of a run that is about to be made."""
    now = datetime.now().astimezone()
    return {
        "format": RUN_FORMAT,
        "run_id": run_id,
        "name": f"{plain_text(name)}, {now:%Y-%m-%d %H:%M}",
        "created": now.isoformat(timespec="seconds"),
        "settings": asdict(settings),
        "versions": _versions(),
        "input": _origin(input_path),
        "ground_truth": _origin(ground_truth_path) if problem.ground_truth else None,
        "vertices": problem.mesh.n_vertices,
        "faces": problem.mesh.n_faces,
        "input_faces": problem.n_input_faces,
        "state": "stopped",
        "last_step": 0,
    }


def write_manifest(folder: RunFolder, manifest: Mapping[str, Any]) -> None:
    """Write ``run.json`` with its own digest (raises OSError)."""
    content = {name: value for name, value in manifest.items() if name != "digest"}
    folder.write_json(MANIFEST, {**content, "digest": _digest(content)})


def read_manifest(folder: RunFolder) -> tuple[dict[str, Any], Settings, tuple[str, ...]]:
    """Read ``run.json``.

    Returns:
        What it says, with everything that is used checked; the settings; sentences for the user on what is odd about it.

    Raises:
        RunError: when there is none, or it does not describe a run.
    """
    path = folder / MANIFEST
    if not folder.path.is_dir() or folder.size(MANIFEST) is None:
        raise RunError(f"{folder.path} is not a run folder: there is no run.json in it.")
    manifest = folder.read_json(MANIFEST)
    try:
        if manifest["format"] != RUN_FORMAT:
            shown = plain_text(str(manifest["format"])[:20])
            raise RunError(f"{folder.path} was written in format {shown}; this version reads format {RUN_FORMAT}.")
        settings = from_mapping(manifest["settings"])
        for key in ("run_id", "name", "created"):
            if not plain_text(manifest[key]):
                raise ValueError(f"{key} is no text")
        for key, most in (("last_step", _MOST_STEPS), ("vertices", 2**31), ("faces", 2**31)):
            if type(manifest[key]) is not int or finite(manifest[key], most) is None:
                raise ValueError(f"{key} is no number of the kind")
        if not re.fullmatch(r"[0-9A-Za-z_-]{1,64}", manifest["run_id"]):
            raise ValueError("run_id is none")
        if manifest["state"] not in STATES:
            raise ValueError("its state is none")
    except RunError:
        raise
    # OverflowError: JSON has integers that are larger than any float.
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, DmpError) as error:
        cause = plain_text(" ".join(str(error).split()).rstrip("."))
        raise RunError(f"{path} does not describe a run ({cause or type(error).__name__}).") from error
    said = manifest.get("digest")
    changed = said is not None and said != _digest({name: value for name, value in manifest.items() if name != "digest"})
    notes = (f"{path} is not as this program wrote it. What it says of the run may be wrong.",) if changed else ()
    return manifest, settings, notes


class Described:
    """What a run says about itself in words and numbers, fit to be shown."""

    def __init__(self, manifest: dict[str, Any]) -> None:
        """Take in what :func:`new_manifest` or :func:`read_manifest` returned."""
        self._manifest = manifest

    @property
    def run_id(self) -> str:
        """Identifies this run in its snapshots."""
        return str(self._manifest["run_id"])

    @property
    def name(self) -> str:
        """The name shown to the user."""
        return plain_text(self._manifest["name"])

    @property
    def mesh_size(self) -> tuple[int, int]:
        """Number of vertices and of faces of the mesh that is trained on."""
        return int(self._manifest["vertices"]), int(self._manifest["faces"])

    @property
    def created(self) -> str:
        """When it was made, ISO 8601."""
        return plain_text(self._manifest["created"])

    @property
    def reason(self) -> str:
        """Why it failed, in a sentence; empty when it did not, or did not say."""
        return plain_text(self._manifest.get("reason"), 500) if self._manifest["state"] == "failed" else ""

    @property
    def has_ended(self) -> bool:
        """Whether its training came to its end by itself and said so; nothing but its result can be missing then."""
        return bool(self._manifest["state"] == "finished")

    @property
    def device(self) -> str | None:
        """Where it was trained last."""
        return plain_text(self._manifest.get("device")) or None

    @property
    def versions(self) -> dict[str, str]:
        """The versions of this program and of what it rests on, by name, when the run was made."""
        found = self._manifest.get("versions")
        if not isinstance(found, dict):
            return {}
        shown = {plain_text(name, 20): plain_text(version, 40) for name, version in list(found.items())[:12]}
        return {name: version for name, version in shown.items() if name and version}

    @property
    def recorded_threads(self) -> int | None:
        """The number of threads of the training so far, None when it is not known."""
        threads = self._manifest.get("threads")
        return threads if type(threads) is int and 1 <= threads <= _MOST_THREADS else None

    @property
    def input_path(self) -> Path | None:
        """The file that the input was read from, as the run says; nothing is looked up there, and it may have gone since."""
        origin = self._manifest.get("input")
        text = origin.get("path") if isinstance(origin, dict) else None
        if not isinstance(text, str) or not text or len(text) > _LONGEST_PATH:
            return None
        # Control characters, and halves of characters that no text can show.
        if any(category(letter) in ("Cc", "Cs") for letter in text):
            return None
        path = Path(text)
        # A name of a network share is looked up by asking a foreign machine.
        return path if path.is_absolute() and ".." not in path.parts and not text.startswith(("\\\\", "//")) else None

    def change_of_input(self) -> str | None:
        """Tell in a sentence that the input was deleted or replaced since the run was made; None when it was not.

        Only its size and time are looked at: a run folder of unknown origin must not make this program read other files.
        """
        path, origin = self.input_path, self._manifest.get("input")
        if path is None or not isinstance(origin, dict):
            return None
        size, modified = origin.get("bytes"), origin.get("modified")
        if type(size) is not int or type(modified) is not int:
            return None
        own_copy = "The run has a copy of its own and is not affected."
        try:
            status = path.stat()
        except (FileNotFoundError, NotADirectoryError):
            return f"{path} is no longer there. {own_copy}"
        except (OSError, ValueError):
            return None
        if (status.st_size, status.st_mtime_ns) != (size, modified):
            return f"{path} has changed since the run was started. {own_copy}"
        return None


def check_digests(folder: RunFolder, manifest: Mapping[str, Any], names: tuple[str, ...]) -> None:
    """Compare files with the sizes and digests that they had when they were written (raises :class:`RunError`)."""
    known = manifest.get("files")
    if not isinstance(known, dict):
        return
    for name in names:
        said, size = known.get(name), folder.size(name)
        if not isinstance(said, dict) or size is None:
            continue
        # The size first: a file that has grown without bound is not read to its end.
        if said.get("bytes") != size or said.get("sha256") != folder.digest(name):
            raise RunError(f"{folder / name} is damaged: it is not what was written.")


def take_digests(folder: RunFolder, manifest: dict[str, Any], names: tuple[str, ...]) -> None:
    """Note sizes and digests of files that were just written (raises :class:`RunError`)."""
    sizes = {name: folder.size(name) for name in names}
    manifest["files"] = {
        name: {"bytes": size, "sha256": folder.digest(name)} for name, size in sizes.items() if size is not None
    }


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _origin(path: Path | None) -> dict[str, Any] | None:
    if path is None:
        return None
    path = path.absolute()
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        status = path.stat()
    except OSError:
        return {"path": str(path)}
    return {"path": str(path), "sha256": digest, "bytes": status.st_size, "modified": status.st_mtime_ns}


def _versions() -> dict[str, str]:
    import scipy
    import torch

    import dmp

    return {
        "dmp": dmp.__version__,
        "torch": torch.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
        "platform": f"{sys.platform} {platform.machine()}",
    }
