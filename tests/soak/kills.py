"""Kills a training with SIGKILL at random moments, also in the middle of a write, and goes on with it.

After each kill the folder opens, not more than one snapshot interval is lost, what is there is what an uninterrupted
training wrote, and in the end curve and vertices are those of the uninterrupted one, bit for bit.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmp.commands import outcome
from dmp.meshio import write_mesh
from dmp.methods import training_for
from dmp.problem import denoising
from dmp.runs import Run
from dmp.settings import settings_for
from dmp.shapes.alterations import with_holes
from tests.meshes import grid_mesh, sphere_mesh
from tests.soak import Result

FULL_SIZE = 100
_LONGEST = 120.0
_SAID = "said.txt"


@dataclass(frozen=True)
class Case:
    """One way to train, as the command line takes it."""

    command: str
    preset: str
    steps: int
    interval: int

    def arguments(self, mesh: Path, run: Path, output: Path) -> list[str]:
        """Return the arguments that start the training."""
        options = ["--preset", self.preset, "--steps", str(self.steps), "--snapshot-every", str(self.interval)]
        options += ["--log-every", "2", "--threads", "1", "--quiet", "--run", str(run), "-o", str(output)]
        if self.preset == "best" and self.command == "denoise":
            options += ["--bilateral-layers", "2"]
        return [self.command, str(mesh), *options]


# Both methods and both tasks; the short intervals make most of the time a time of writing.
CASES = (
    Case("denoise", "compact", 40, 3),
    Case("denoise", "best", 30, 4),
    Case("complete", "compact", 40, 3),
    Case("complete", "best", 40, 3),
)


def run(size: int, seed: int) -> Result:
    """Kill ``size`` times, the cases in turn, until every training that was begun has reached its end."""
    if not hasattr(os, "fork"):
        return Result("kills at random moments", 0, 0, ("this system cannot fork",))
    generator = np.random.default_rng(seed)
    failures: list[str] = []
    kills = 0
    with tempfile.TemporaryDirectory(prefix="dmp-kills-") as name:
        folder = Path(name)
        _write_inputs(folder)
        _load_everything()
        truths: dict[Case, tuple[Path, float]] = {}
        turn = 0
        while kills < size:
            case = CASES[turn % len(CASES)]
            if case not in truths:
                truths[case] = _uninterrupted(case, folder)
            kills += _kill_again_and_again(case, folder / f"run{turn}", truths[case], generator, size - kills, failures)
            turn += 1
    return Result("kills at random moments", kills - len(failures), kills, tuple(failures))


def _kill_again_and_again(
    case: Case, folder: Path, truth: tuple[Path, float], generator: np.random.Generator, most: int, failures: list[str]
) -> int:
    """Train one run with kills in between until it ends; return the number of kills."""
    mesh, output = folder.parent / f"{case.command}.ply", folder.with_suffix(".ply")
    before = mesh.read_bytes()
    whole = Run.open(truth[0])
    kills = 0
    while True:
        is_new = not (folder / "run.json").exists()
        if is_new and folder.exists():
            # Killed while the folder was made: nothing was learnt yet.
            for path in sorted(folder.rglob("*"), reverse=True):
                path.rmdir() if path.is_dir() else path.unlink()
        arguments = case.arguments(mesh, folder, output) if is_new else ["resume", str(folder), "--quiet", "-o", str(output)]
        delay = float(generator.uniform(0, truth[1])) if kills < most else None
        code, reached = _call(arguments, delay, folder.parent / _SAID)
        if code == 0:
            failures += _differences(f"{case.command} {case.preset}, finished", whole, Run.open(folder))
            if output.read_bytes() != truth[0].with_suffix(".ply").read_bytes():
                failures.append(f"{case.command} {case.preset}: the result that was saved differs")
            if mesh.read_bytes() != before:
                failures.append(f"{case.command} {case.preset}: the input was changed")
            return kills
        if code != -signal.SIGKILL:
            said = (folder.parent / _SAID).read_text(encoding="utf-8", errors="replace").strip()
            failures.append(f"{case.command} {case.preset}: '{arguments[0]}' ended with {code} after {kills} kills: {said}")
            return kills
        kills += 1
        if (folder / "run.json").exists():
            failures += _after_a_kill(case, whole, folder, reached)


def _after_a_kill(case: Case, whole: Run, folder: Path, reached: int) -> list[str]:
    what = f"{case.command} {case.preset}, killed at step {reached}"
    try:
        opened = Run.open(folder)
        wrong = (
            [f"{what}: the run counts as {opened.state}"] if opened.state not in ("interrupted", "stopped", "finished") else []
        )
        if reached - opened.last_step > case.interval:
            wrong.append(f"{what}: only step {opened.last_step} is left")
        if opened.state == "interrupted" and opened.last_step < case.steps:
            training = opened.resume()
            if reached - training.step > case.interval:
                wrong.append(f"{what}: it goes on from step {training.step}")
        return wrong + _differences(what, whole, opened, is_part=True)
    except Exception:
        return [f"{what}: {traceback.format_exc(limit=3)}"]


def _differences(what: str, whole: Run, other: Run, *, is_part: bool = False) -> list[str]:
    """Return where a run differs from the uninterrupted one, in everything but the time it took."""
    wrong = []
    curves = [
        {int(row["step"]): {k: v for k, v in row.items() if k != "seconds"} for row in run.curve()} for run in (whole, other)
    ]
    if any(curves[0].get(step) != row for step, row in curves[1].items()) or (not is_part and len(curves[0]) != len(curves[1])):
        wrong.append(f"{what}: the curve differs")
    steps = other.snapshot_steps()
    if not is_part and steps != whole.snapshot_steps():
        wrong.append(f"{what}: the snapshots are {steps}")
    differing = [step for step in steps if not np.array_equal(other.snapshot(step).vertices, whole.snapshot(step).vertices)]
    return wrong + [f"{what}: snapshot {step} differs" for step in differing]


def _uninterrupted(case: Case, folder: Path) -> tuple[Path, float]:
    """Train once without a kill; return the run and the seconds that it took."""
    run_folder = folder / f"whole-{case.command}-{case.preset}"
    started = time.monotonic()
    code, _ = _call(case.arguments(folder / f"{case.command}.ply", run_folder, run_folder.with_suffix(".ply")), None)
    if code != 0:
        raise RuntimeError(f"The uninterrupted training ended with {code}.")
    return run_folder, time.monotonic() - started


def _call(arguments: list[str], delay: float | None, said: Path = Path(os.devnull)) -> tuple[int, int]:
    """Run the command line in a process of its own and kill it after ``delay`` seconds; what it says goes to ``said``.

    Returns:
        the exit code, negative for a signal, and the last step that it handed out.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _be_the_command(arguments, said, lambda step: os.write(writing, step.to_bytes(4, "little")))
    os.close(writing)
    deadline = time.monotonic() + (_LONGEST if delay is None else delay)
    told = b""
    while (left := deadline - time.monotonic()) > 0:
        ready, _, _ = select.select([reading], [], [], left)
        if ready:
            part = os.read(reading, 4096)
            if not part:
                break
            told += part
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    while part := os.read(reading, 4096):
        told += part
    os.close(reading)
    steps = [int.from_bytes(told[start : start + 4], "little") for start in range(0, len(told) - 3, 4)]
    return os.waitstatus_to_exitcode(status), steps[-1] if steps else 0


def _be_the_command(arguments: list[str], said: Path, tell: Callable[[int], object]) -> None:
    """In the child: report each step, do what the command does, and end without returning to the test."""
    record = outcome.record

    def reporting(*given: object) -> object:
        records = record(*given)  # type: ignore[arg-type]
        try:
            for item in records:
                tell(item.step)
                yield item
        finally:
            records.close()  # type: ignore[attr-defined]

    code = 99
    try:
        outcome.record = reporting  # type: ignore[assignment]
        from dmp.cli import main

        with said.open("w", encoding="utf-8") as file:
            sys.stdout = sys.stderr = file
            main(arguments)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0
    finally:
        os._exit(code)


def _load_everything() -> None:
    """Do once what each child would otherwise do anew: import, and take the first step of a training."""
    import dmp.cli  # noqa: F401

    settings = settings_for("denoise", steps=1, threads=1, width_divisor=32)
    list(training_for(denoising(sphere_mesh(1), settings), settings).steps())


def _write_inputs(folder: Path) -> None:
    ball = sphere_mesh(2)
    noise = np.random.default_rng(0).standard_normal(ball.vertices.shape)
    write_mesh(folder / "denoise.ply", ball.with_vertices(ball.vertices + 0.03 * noise))
    write_mesh(folder / "complete.ply", with_holes(grid_mesh(16, height=0.05), [(7.0, 7.0, 0.0)], [9]))
