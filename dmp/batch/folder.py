"""The folder of a batch: a record, a run folder, a result and a picture for each job."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from dmp.errors import RunError
from dmp.files import atomic_write_bytes, in_words

_FORMAT = 1


@dataclass(frozen=True)
class Outcome:
    """How a job ended: with a result, or with the reason why there is none.

    Attributes:
        failure: the reason, in a sentence; empty when there is a result.
        mesh: the file that was restored.
        vertices, faces: of the result.
        task, preset, seed, steps: what was done; steps are those that were made.
        step: the step that was saved.
        why: why this one, in a sentence.
        before, after: measures of the input and of the result against the ground truth, by name; empty without one.
        seconds: time in training steps.
        wall_seconds: time from the beginning of the job to its end on its worker, of its last attempt.
        device, threads, machine: where it was computed.
        resumed_from: the step that its last attempt went on from, 0 for the beginning.
        notes: what was changed in reading or filling, in sentences.
        retries: one sentence for each attempt that came to nothing, such as one whose worker was killed.
        result: name of the result's file in ``results``, empty without one.
        run: name of its run folder in ``runs``, empty without one.
    """

    failure: str = ""
    mesh: str = ""
    vertices: int = 0
    faces: int = 0
    task: str = ""
    preset: str = ""
    seed: int = 0
    steps: int = 0
    step: int = 0
    why: str = ""
    before: Mapping[str, float] = field(default_factory=dict)
    after: Mapping[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    wall_seconds: float = 0.0
    device: str = ""
    threads: int = 0
    machine: str = ""
    resumed_from: int = 0
    notes: tuple[str, ...] = ()
    retries: tuple[str, ...] = ()
    result: str = ""
    run: str = ""


class BatchFolder:
    """Where a batch keeps what it made. A worker that does not see it has one of its own, and sends what is in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def run_folder(self, name: str) -> Path:
        """Where the training of a job is kept; ``dmp-viewer`` opens it."""
        return self.folder / "runs" / name

    def result(self, name: str, suffix: str) -> Path:
        """Where the restored mesh of a job goes."""
        return self.folder / "results" / f"{name}{suffix}"

    def picture(self, name: str) -> Path:
        """Where the picture of a job goes, PNG."""
        return self.folder / "pictures" / f"{name}.png"

    def record(self, name: str) -> Path:
        """Where it is kept how a job ended."""
        return self.folder / "records" / f"{name}.json"

    def read(self, name: str) -> Outcome | None:
        """Return how a job ended; None when it did not end yet, or what was written is not readable any more."""
        try:
            content = json.loads(self.record(name).read_bytes())
            if content["format"] != _FORMAT:
                return None
            known = {item.name for item in fields(Outcome)}
            values = {key: value for key, value in content["outcome"].items() if key in known}
            for key in ("notes", "retries"):
                values[key] = tuple(values.get(key, ()))
            return Outcome(**values)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None

    def is_done(self, name: str) -> bool:
        """Tell whether there is a result; what failed is tried again."""
        outcome = self.read(name)
        return (
            outcome is not None
            and not outcome.failure
            and (not outcome.result or (self.folder / "results" / outcome.result).is_file())
        )

    def write(self, name: str, outcome: Outcome) -> None:
        """Keep how a job ended (raises :class:`RunError` when it cannot be written)."""
        content = {"format": _FORMAT, "outcome": asdict(outcome)}
        self.write_file(self.record(name), json.dumps(content, indent=1, allow_nan=False).encode())

    def write_file(self, path: Path, content: bytes) -> None:
        """Write a file of the batch (raises :class:`RunError` when it cannot be written)."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            atomic_write_bytes(path, content)
        except OSError as error:
            raise RunError(f"{path} cannot be written: {in_words(error)}. Name another folder with --out.") from error

    def outcomes(self, names: Iterable[str]) -> Iterator[tuple[str, Outcome]]:
        """Yield how jobs ended, one after the other, so that a thousand of them need no memory."""
        for name in names:
            outcome = self.read(name)
            if outcome is not None:
                yield name, outcome


def with_retries(outcome: Outcome, retries: Iterable[str]) -> Outcome:
    """Return the outcome with one sentence for each attempt that came to nothing."""
    values: dict[str, Any] = {item.name: getattr(outcome, item.name) for item in fields(Outcome)}
    return Outcome(**{**values, "retries": tuple(retries)})
