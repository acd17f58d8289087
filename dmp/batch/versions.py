"""Who answers at the other end, and whether the two of us can work together: asked before anything starts."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dmp.batch.cluster import ClusterError

if TYPE_CHECKING:
    from distributed import Client

# With another version of these the other end may not even understand the job.
_MUST_AGREE = ("dmp-viewer", "distributed")
# With another version of these the last digits of the results may be others.
_SHOULD_AGREE = ("torch", "numpy", "scipy")
_NAMES = {"dmp-viewer": "dmp-viewer", "distributed": "dask.distributed"}


@dataclass(frozen=True)
class Comparison:
    """What differs between this computer and the workers.

    Attributes:
        obstacles: sentences on what forbids to begin; empty when nothing does.
        remarks: sentences on what may change the last digits.
    """

    obstacles: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def versions_here() -> dict[str, str]:
    """Return the versions of this program and of what it computes with."""
    found = {"python": platform.python_version()}
    for name in (*_MUST_AGREE, *_SHOULD_AGREE):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = ""
    return found


def versions_there(client: Client) -> dict[str, dict[str, str]]:
    """Return the same of each worker, by its address; an empty text for what is not installed there.

    Only functions of Python itself are called, so that a worker without this program can answer as well.
    """
    answers: dict[str, dict[str, str]] = {}
    for name in (*_MUST_AGREE, *_SHOULD_AGREE):
        for address, answer in client.run(importlib.metadata.version, name, on_error="return").items():
            answers.setdefault(address, {})[name] = answer if isinstance(answer, str) else ""
    for address, answer in client.run(platform.python_version, on_error="return").items():
        answers.setdefault(address, {})["python"] = answer if isinstance(answer, str) else ""
    return answers


def compare(here: Mapping[str, str], there: Mapping[str, Mapping[str, str]]) -> Comparison:
    """Compare the versions of this computer with those of the workers, see :func:`versions_there`."""
    obstacles: list[str] = []
    remarks: list[str] = []
    for address, versions in sorted(there.items()):
        for name in _MUST_AGREE:
            shown = _NAMES[name]
            if not versions.get(name):
                obstacles.append(f"{shown} is not installed on the worker {address}.")
            elif versions[name] != here[name]:
                obstacles.append(f"The worker {address} has {shown} {versions[name]}, this computer {here[name]}.")
        if _minor(versions.get("python", "")) != _minor(here["python"]):
            obstacles.append(f"The worker {address} runs Python {versions.get('python')}, this computer {here['python']}.")
        remarks += [
            f"The worker {address} has {name} {versions.get(name) or 'not at all'}, this computer {here[name]}."
            for name in _SHOULD_AGREE
            if versions.get(name, "") != here[name]
        ]
    return Comparison(tuple(obstacles), tuple(remarks))


def check_versions(client: Client) -> tuple[str, ...]:
    """Compare this computer with the workers; return sentences on what may change the last digits.

    Raises:
        ClusterError: when a worker has another version of this program, of dask or of Python, or none.
    """
    compared = compare(versions_here(), versions_there(client))
    if compared.obstacles:
        more = f" So have {len(compared.obstacles) - 1} more." if len(compared.obstacles) > 1 else ""
        raise ClusterError(f"{compared.obstacles[0]}{more} Install the same version on both ends.")
    if compared.remarks:
        return (f"{compared.remarks[0]} Results may differ in their last digits.",)
    return ()


def _minor(version: str) -> str:
    return ".".join(version.split(".")[:2])
