"""What came of a batch: a table for programs (CSV), one for people (Markdown), and a page with pictures (HTML)."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

from dmp.batch.folder import BatchFolder, Outcome
from dmp.batch.jobs import BatchJob
from dmp.batch.page import write_page
from dmp.durations import duration
from dmp.errors import RunError
from dmp.files import atomic_write, in_words

CSV, MARKDOWN, PAGE = "summary.csv", "summary.md", "summary.html"
_COLUMNS = (
    "name", "state", "mesh", "task", "preset", "seed", "steps", "saved_step", "vertices", "faces",
    "input_mad", "result_mad", "input_vertex_error", "result_vertex_error", "input_hole_distance", "result_hole_distance",
    "training_seconds", "seconds", "device", "threads", "machine", "retries", "result", "run", "failure",
)  # fmt: skip
_MEASURES = {"mad": ("MAD", "{:.2f}°"), "vertex_error": ("vertex error", "{:.3f}"), "hole_distance": ("in holes", "{:.3f}")}


def write_summary(jobs: Sequence[BatchJob], folder: Path) -> Path:
    """Write the three summaries from what is done so far, one record at a time.

    Returns:
        The page.

    Raises:
        RunError: when a file cannot be written.
    """
    store = BatchFolder(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, lines in ((CSV, _csv(jobs, store)), (MARKDOWN, _markdown(jobs, store))):
            with atomic_write(folder / name) as file:
                for line in lines:
                    file.write(line.encode())
        with atomic_write(folder / PAGE) as file:
            write_page(file, jobs, store, _totals(jobs, store))
    except OSError as error:
        raise RunError(f"The summary in {folder} cannot be written: {in_words(error)}.") from error
    return folder / PAGE


def state_of(outcome: Outcome | None) -> str:
    """Return how a job stands, in a word."""
    return "waiting" if outcome is None else "failed" if outcome.failure else "done"


def measures(outcome: Outcome) -> str:
    """Return the measures before and after in words, such as ``MAD 12.31° → 4.02°``; empty without a ground truth."""
    return ", ".join(
        f"{label} {form.format(outcome.before[name])} → {form.format(outcome.after[name])}"
        for name, (label, form) in _MEASURES.items()
        if name in outcome.before and name in outcome.after
    )


def _csv(jobs: Sequence[BatchJob], store: BatchFolder) -> Iterator[str]:
    yield ",".join(_COLUMNS) + "\n"
    for job in jobs:
        outcome = store.read(job.name)
        told = outcome or Outcome(
            mesh=str(job.mesh), task=job.settings.task, preset=job.settings.preset, seed=job.settings.seed
        )
        pairs = [
            values.get(name, "") for name in ("mad", "vertex_error", "hole_distance") for values in (told.before, told.after)
        ]
        row = [
            job.name, state_of(outcome), told.mesh, told.task, told.preset, told.seed, told.steps, told.step, told.vertices,
            told.faces, *pairs, round(told.seconds, 3), round(told.wall_seconds, 3), told.device, told.threads, told.machine,
            len(told.retries), f"results/{told.result}" if told.result else "", f"runs/{told.run}" if told.run else "",
            told.failure,
        ]  # fmt: skip
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow([_plain(cell) for cell in row])
        yield text.getvalue()


def _plain(cell: object) -> object:
    # A spreadsheet takes a text that begins so for a formula, and a file name may come from anybody.
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(("=", "+", "-", "@", "\t")) else cell


def _totals(jobs: Sequence[BatchJob], store: BatchFolder) -> str:
    done = failed = retried = 0
    seconds = 0.0
    for _, outcome in store.outcomes(job.name for job in jobs):
        done += not outcome.failure
        failed += bool(outcome.failure)
        retried += len(outcome.retries)
        seconds += outcome.wall_seconds
    waiting = len(jobs) - done - failed
    parts = [f"{done} of {len(jobs)} done"]
    parts += [f"{failed} failed"] if failed else []
    parts += [f"{waiting} waiting"] if waiting else []
    parts += [f"{retried} retries"] if retried else []
    return f"{', '.join(parts)}; {duration(seconds)} of work."


def _markdown(jobs: Sequence[BatchJob], store: BatchFolder) -> Iterator[str]:
    yield f"# Batch\n\n{_totals(jobs, store)}\n\n"
    yield "| job | state | vertices | saved step | measures (input → result) | time | retries |\n"
    yield "|---|---|---|---|---|---|---|\n"
    for job in jobs:
        outcome = store.read(job.name)
        cells = [_cell(job.name), state_of(outcome)]
        if outcome is not None and not outcome.failure:
            cells += [f"{outcome.vertices:,}", f"{outcome.step} of {outcome.steps}", measures(outcome)]
            cells += [duration(outcome.wall_seconds), str(len(outcome.retries) or "")]
        else:
            cells += [""] * 4 + [str(len(outcome.retries) or "") if outcome else ""]
        yield f"| {' | '.join(cells)} |\n"
    for title, lines in (("Failures", _failures(jobs, store)), ("Retries", _retries(jobs, store))):
        first = True
        for line in lines:
            yield f"\n## {title}\n\n" if first else ""
            yield line
            first = False


def _failures(jobs: Sequence[BatchJob], store: BatchFolder) -> Iterator[str]:
    for name, outcome in store.outcomes(job.name for job in jobs):
        if outcome.failure:
            yield f"- **{_cell(name)}** ({_cell(outcome.mesh)}): {_cell(outcome.failure)}\n"


def _retries(jobs: Sequence[BatchJob], store: BatchFolder) -> Iterator[str]:
    for name, outcome in store.outcomes(job.name for job in jobs):
        for text in outcome.retries:
            yield f"- **{_cell(name)}**: {_cell(text)}.\n"


def _cell(text: str) -> str:
    """Return a text as a cell of a Markdown table, whatever is in it."""
    plain = " ".join(text.split())
    for letter in "\\|`*_<>[]":
        plain = plain.replace(letter, f"\\{letter}")
    return plain
