"""Who answers at the other end, and whether the two of us can work together: asked before anything starts."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dmp.batch.asking import Workers
from dmp.batch.cluster import ClusterError

if TYPE_CHECKING:
    from distributed import Client

# With another version of these the other end may not even understand the job.
_MUST_AGREE = ("dmp-viewer", "distributed")
# With another version of these the last digits of the results may be others.
_SHOULD_AGREE = ("torch", "numpy", "scipy")
# Under this name stands a digest of the program's own sources, because a version number stays the same while they change.
_SOURCES = "sources"
_SHOWN_DIGITS = 8
# Of a program that was packed without its sources; its version number has to do.
_PACKED = "packed"
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
    found = {"python": platform.python_version(), _SOURCES: sources_digest()}
    for name in (*_MUST_AGREE, *_SHOULD_AGREE):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = ""
    return found


@functools.cache
def sources_digest() -> str:
    """Return a digest of all source files of the package ``dmp``, which computes: not of the window, and of no document.

    Line ends do not count, because some systems change them when they unpack.
    """
    folder = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    paths = sorted(folder.rglob("*.py"), key=lambda path: path.relative_to(folder).as_posix())
    if not paths:
        return _PACKED
    for path in paths:
        content = hashlib.sha256(path.read_bytes().replace(b"\r\n", b"\n")).hexdigest()
        digest.update(f"{path.relative_to(folder).as_posix()} {content}\n".encode())
    return digest.hexdigest()


def versions_there(client: Client, workers: Workers | None = None) -> dict[str, dict[str, str]]:
    """Return the same of each worker that answers, by its address; an empty text for what is not installed there.

    Apart from the last question only functions of Python itself are called, so that a worker without this program can
    answer as well.

    Args:
        client: of the workers.
        workers: takes note of those that do not answer.

    Raises:
        ClusterError: when the scheduler does not answer.
    """
    questions: list[tuple[str, Callable[..., str], tuple[str, ...]]] = [("python", platform.python_version, ())]
    questions += [(name, importlib.metadata.version, (name,)) for name in (*_MUST_AGREE, *_SHOULD_AGREE)]
    questions += [(_SOURCES, sources_digest, ())]
    found: dict[str, dict[str, str]] = {}
    workers = workers or Workers()
    try:
        for name, function, arguments in questions:
            # Who did not answer the first question is not waited for again.
            answers = workers.ask(client, function, *arguments, workers=found or None)
            found = {address: found.get(address, {}) for address in answers}
            for address, answer in answers.items():
                found[address][name] = answer if isinstance(answer, str) else ""
            if not found:
                break
    except TimeoutError as error:
        raise ClusterError("The scheduler does not answer any more.") from error
    return found


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
            elif name == "dmp-viewer" and _differ(versions.get(_SOURCES, ""), here[_SOURCES]):
                obstacles.append(
                    f"The worker {address} has other program files of {shown} {here[name]} ({_state(versions)}) than this "
                    f"computer ({_state(here)}), although the version is the same."
                )
        if _minor(versions.get("python", "")) != _minor(here["python"]):
            obstacles.append(f"The worker {address} runs Python {versions.get('python')}, this computer {here['python']}.")
        remarks += [
            f"The worker {address} has {name} {versions.get(name) or 'not at all'}, this computer {here[name]}."
            for name in _SHOULD_AGREE
            if versions.get(name, "") != here[name]
        ]
    return Comparison(tuple(obstacles), tuple(remarks))


def check_versions(client: Client, workers: Workers | None = None) -> tuple[str, ...]:
    """Compare this computer with the workers that answer; return sentences on what may change the last digits.

    Args:
        client: of the workers.
        workers: takes note of those that do not answer.

    Raises:
        ClusterError: when a worker has another version of this program, of dask or of Python, or none; when none answers.
    """
    there = versions_there(client, workers)
    if not there:
        raise ClusterError("None of the workers answers. Start them anew over there: dmp serve.")
    compared = compare(versions_here(), there)
    if compared.obstacles:
        more = f" So have {len(compared.obstacles) - 1} more." if len(compared.obstacles) > 1 else ""
        raise ClusterError(f"{compared.obstacles[0]}{more} Install the same version on both ends.")
    if compared.remarks:
        return (f"{compared.remarks[0]} Results may differ in their last digits.",)
    return ()


def _differ(there: str, here: str) -> bool:
    return there != here and _PACKED not in (there, here)


def _state(versions: Mapping[str, str]) -> str:
    """Return a name for a state of the sources that two people can read to each other."""
    digest = versions.get(_SOURCES, "")
    return f"state {digest[:_SHOWN_DIGITS]}" if digest else "an earlier state"


def _minor(version: str) -> str:
    return ".".join(version.split(".")[:2])
