"""Damages run folders at random and uses them as the window and the command line do.

Whatever was done to a folder: it is used, or refused in a sentence, within seconds, without running code from it, without
touching anything outside of it, and without taking damaged arrays for whole ones.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import pickle
import shutil
import signal
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dmp.errors import DmpError
from dmp.problem import denoising
from dmp.runs import Run, record
from dmp.settings import settings_for
from tests.meshes import sphere_mesh
from tests.soak import Result

FULL_SIZE = 2000
_SECONDS = 10
_MEMORY = 3 * 2**30
_BATCH = 50
_CANARY = "DMP_SOAK_CANARY"
_FILES = ("run.json", "input.ply", "ground_truth.ply", "base.npy", "curve.csv", "checkpoint.pt", "kept.json", "run.lock",
          "snapshots/000000.npy", "snapshots/000002.npy", "snapshots/000004.npy")  # fmt: skip

Random = np.random.Generator


def run(size: int, seed: int) -> Result:
    """Damage ``size`` copies of a run, each in one to three ways."""
    if not hasattr(os, "fork"):
        return Result("damaged run folders", 0, 0, ("this system cannot fork",))
    failures: list[str] = []
    with tempfile.TemporaryDirectory(prefix="dmp-folders-") as name:
        place = Path(name)
        truths = _make_honest(place / "honest")
        for first in range(0, size, _BATCH):
            failures += _batch(place, truths, seed, range(first, min(size, first + _BATCH)))
    return Result("damaged run folders", size - len({text.split(":")[0] for text in failures}), size, tuple(failures))


def _make_honest(folder: Path) -> dict[int, np.ndarray]:
    """Make a run of four of its eight steps; return the vertices of its snapshots."""
    ball = sphere_mesh(1)
    noisy = ball.with_vertices(ball.vertices + 0.05 * np.random.default_rng(0).standard_normal(ball.vertices.shape))
    settings = settings_for("denoise", steps=8, snapshot_every=2, log_every=1, threads=1, width_divisor=32)
    run = Run.create(denoising(noisy, settings, ball), settings, folder=folder)
    records = record(run.resume(), run)
    for item in records:
        if item.step == 4:
            break
    records.close()  # type: ignore[attr-defined]
    run.keep(2)
    return {step: run.snapshot(step).vertices for step in Run.open(folder).snapshot_steps()}


def _batch(place: Path, truths: dict[int, np.ndarray], seed: int, numbers: range) -> list[str]:
    """Do some in a process of its own, whose death is a failure of the one it was at."""
    said = place / "said.txt"
    said.write_text("")
    child = os.fork()
    if child == 0:
        _be_the_user(place, truths, seed, numbers, said)
    _, status = os.waitpid(child, 0)
    lines = [json.loads(line) for line in said.read_text().splitlines()]
    failures = [line["failure"] for line in lines if line.get("failure")]
    done = [line["done"] for line in lines if "done" in line]
    if status != 0 or len(done) != len(numbers):
        dead = numbers[min(len(done), len(numbers) - 1)]
        failures.append(f"{dead}: the process ended with {os.waitstatus_to_exitcode(status)}")
    return failures


def _be_the_user(place: Path, truths: dict[int, np.ndarray], seed: int, numbers: range, said: Path) -> None:
    code = 1
    try:
        import resource

        # Whoever forked this process may have claimed more than the limit by itself.
        statm = Path("/proc/self/statm")
        claimed = int(statm.read_text().split()[0]) * resource.getpagesize() if statm.exists() else 0
        resource.setrlimit(resource.RLIMIT_AS, (claimed + _MEMORY, claimed + _MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.signal(signal.SIGALRM, _too_long)
        with said.open("a") as log:
            for number in numbers:
                failure = _one(place, truths, np.random.default_rng([seed, number]))
                if failure:
                    log.write(json.dumps({"failure": f"{number}: {failure}"}) + "\n")
                log.write(json.dumps({"done": number}) + "\n")
                log.flush()
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


class _TooLongError(BaseException):
    """Not an Exception, so that nothing between here and there can take it for one of its own."""


def _too_long(*_: object) -> None:
    raise _TooLongError


def _one(place: Path, truths: dict[int, np.ndarray], random: Random) -> str:
    folder, victim, canary = place / "damaged", place / "victim", place / "canary"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(place / "honest", folder)
    victim.write_bytes((folder / "curve.csv").read_bytes())
    before = victim.stat().st_mtime_ns, victim.read_bytes()
    os.environ[_CANARY] = str(canary)
    damages = list(random.choice(len(_DAMAGES), size=int(random.integers(1, 4)), replace=True))
    for index in damages:
        _DAMAGES[index](folder, victim, random)
    names = "+".join(_DAMAGES[index].__name__.strip("_") for index in damages)
    signal.alarm(_SECONDS)
    try:
        wrong = _use(folder, truths)
    except _TooLongError:
        return f"{names}: took longer than {_SECONDS} s"
    except BaseException as error:
        return f"{names}: {type(error).__name__}: {error} at {traceback.extract_tb(error.__traceback__)[-1].line}"
    finally:
        signal.alarm(0)
    if canary.exists():
        canary.unlink()
        return f"{names}: code from the folder was run"
    if (victim.stat().st_mtime_ns, victim.read_bytes()) != before:
        return f"{names}: a file outside was written"
    return f"{names}: {wrong}" if wrong else ""


def _use(folder: Path, truths: dict[int, np.ndarray]) -> str:
    """Open, look at everything, export, keep, go on for a few steps. Each part may be refused in a sentence."""
    try:
        run = Run.open(folder)
    except DmpError as error:
        return _told(error)
    wrong = []

    def attempt(work: Callable[[], Any]) -> Any:
        try:
            return work()
        except DmpError as error:
            wrong.append(_told(error))
            return None

    for text in (run.name, run.state, run.reason, run.created, str(run.device), str(run.input_path), *run.warnings):
        text.encode()
    changed = any("not as this program wrote it" in warning for warning in run.warnings)
    attempt(run.problem)
    attempt(run.curve)
    attempt(run.suggestion)
    for step in run.snapshot_steps()[:20]:
        mesh = attempt(lambda step=step: run.mesh_at(step))
        same = step in truths and mesh is not None and np.array_equal(mesh.vertices, truths[step])
        if mesh is not None and not same and not changed:
            wrong.append(f"snapshot {step} is taken for whole and is not")
    attempt(lambda: run.keep(2))
    # A description that was changed may ask for a million steps of another width; that is its right.
    training = attempt(run.resume) if not changed else None
    if training is not None:
        attempt(lambda: _few(record(training, run)))
    return "; ".join(text for text in wrong if text)


def _few(records: Any) -> None:
    for count, _ in enumerate(records):
        if count == 3:
            break
    records.close()


def _told(error: DmpError) -> str:
    """Return what is wrong with the way in which something was refused; nothing when it is a sentence."""
    text = str(error)
    return "" if text and "\n" not in text and len(text) < 2000 else f"refused with {text[:100]!r}"


# -- damages ----------------------------------------------------------------------------------------------------------


def _some_file(folder: Path, random: Random) -> Path:
    return folder / _FILES[int(random.integers(len(_FILES)))]


def _rewrite(path: Path, change: Callable[[bytearray], bytes | bytearray]) -> None:
    if not path.is_file() or path.is_symlink():
        return
    status = path.stat()
    # Neither through a second name of a file outside, nor what an earlier damage has blown up.
    if status.st_nlink == 1 and status.st_size < 10**7:
        path.write_bytes(change(bytearray(path.read_bytes())))


def _flip_bits(folder: Path, _: Path, random: Random) -> None:
    def flip(content: bytearray) -> bytearray:
        for _ in range(int(random.integers(1, 6)) if content else 0):
            content[int(random.integers(len(content)))] ^= 1 << int(random.integers(8))
        return content

    _rewrite(_some_file(folder, random), flip)


def _cut(folder: Path, _: Path, random: Random) -> None:
    _rewrite(_some_file(folder, random), lambda content: content[: int(random.integers(len(content) + 1))])


def _zero_tail(folder: Path, _: Path, random: Random) -> None:
    def zero(content: bytearray) -> bytes:
        start = int(random.integers(len(content) + 1))
        return bytes(content[:start]) + b"\0" * (len(content) - start)

    _rewrite(_some_file(folder, random), zero)


def _insert(folder: Path, _: Path, random: Random) -> None:
    def insert(content: bytearray) -> bytes:
        place = int(random.integers(len(content) + 1))
        return bytes(content[:place]) + random.bytes(int(random.integers(1, 200))) + bytes(content[place:])

    _rewrite(_some_file(folder, random), insert)


def _delete(folder: Path, _: Path, random: Random) -> None:
    path = _some_file(folder, random)
    if path.is_file() or path.is_symlink():
        path.unlink()


def _swap(folder: Path, _: Path, random: Random) -> None:
    one, other = _some_file(folder, random), _some_file(folder, random)
    if one.is_file() and other.is_file() and not one.is_symlink() and not other.is_symlink():
        between = one.with_name("between")
        one.replace(between)
        other.replace(one) if other != one else None
        between.replace(other)


def _link_outside(folder: Path, victim: Path, random: Random) -> None:
    path = _some_file(folder, random)
    if path.parent.is_dir() and not path.is_dir():
        path.unlink(missing_ok=True)
        path.symlink_to(victim)


def _hard_link_outside(folder: Path, victim: Path, random: Random) -> None:
    path = folder / "curve.csv"
    if not path.is_dir():
        path.unlink(missing_ok=True)
        os.link(victim, path)


def _pipe(folder: Path, _: Path, random: Random) -> None:
    path = _some_file(folder, random)
    if path.parent.is_dir() and not path.is_dir():
        path.unlink(missing_ok=True)
        os.mkfifo(path)


def _folder_for_file(folder: Path, _: Path, random: Random) -> None:
    path = _some_file(folder, random)
    if path.parent.is_dir() and not path.is_dir():
        path.unlink(missing_ok=True)
        path.mkdir()


def _link_snapshots(folder: Path, victim: Path, _: Random) -> None:
    snapshots = folder / "snapshots"
    if snapshots.is_dir() and not snapshots.is_symlink():
        shutil.rmtree(snapshots)
        outside = victim.with_name("outside")
        outside.mkdir(exist_ok=True)
        snapshots.symlink_to(outside)


def _grow(folder: Path, _: Path, random: Random) -> None:
    path = _some_file(folder, random)
    if path.is_file() and not path.is_symlink() and path.stat().st_nlink == 1:
        with path.open("r+b") as file:
            file.truncate(int(10 ** random.uniform(6, 13)))


_ODD_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 2**63, 10**400, 1e308, float("nan"), float("inf"), "", "../../../etc/passwd", "/dev/zero", "\ud800",
    "\0", "x" * 10_000, [], {}, [[[[]]]], {"a": {"b": {}}}, "C:\\", "//server/share", "running", "failed",
)  # fmt: skip


def _odd_value(folder: Path, _: Path, random: Random) -> None:
    path = folder / ("run.json" if random.random() < 0.9 else "kept.json")
    try:
        values = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return
    inside = values
    for _ in range(3):
        if not isinstance(inside, dict) or not inside:
            return
        key = list(inside)[int(random.integers(len(inside)))]
        if isinstance(inside[key], dict) and random.random() < 0.7:
            inside = inside[key]
            continue
        inside[key] = _ODD_VALUES[int(random.integers(len(_ODD_VALUES)))]
        break
    path.write_text(json.dumps(values))


def _deep_text(folder: Path, _: Path, random: Random) -> None:
    depth = int(10 ** random.uniform(2, 5.7))
    _rewrite(folder / ("run.json" if random.random() < 0.5 else "kept.json"), lambda _: b'{"a":' * depth)


class _Malice:
    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return exec, (f"import os, pathlib; pathlib.Path(os.environ['{_CANARY}']).touch()",)


def _pickle_for_array(folder: Path, _: Path, random: Random) -> None:
    buffer = io.BytesIO()
    np.save(buffer, np.array([[_Malice()] * 3], dtype=object), allow_pickle=True)
    _rewrite(folder / ("base.npy" if random.random() < 0.5 else "snapshots/000002.npy"), lambda _: buffer.getvalue())


def _pickle_for_checkpoint(folder: Path, _: Path, random: Random) -> None:
    body = pickle.dumps({"version": 1, "network": _Malice()}, protocol=int(random.integers(0, 6)))
    head = b"dmp-checkpoint 1 sha256 " + hashlib.sha256(body).hexdigest().encode() + b"\n"
    _rewrite(folder / "checkpoint.pt", lambda _: head + body)


def _lying_header(folder: Path, _: Path, random: Random) -> None:
    rows = int(10 ** random.uniform(0, 18))
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({rows}, 3), }}\n".encode()

    def lie(content: bytearray) -> bytes:
        return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(content[128:])

    _rewrite(folder / ("base.npy" if random.random() < 0.5 else "snapshots/000004.npy"), lie)


def _strange_curve(folder: Path, _: Path, random: Random) -> None:
    lines = [b"step,seconds", b"," * int(10 ** random.uniform(1, 6)), b"1e400,1", b"-5,2", b"3," + b"9" * 5000, "٣,1".encode(),
             b"nan,inf", b"\0" * 1000, b"7,1\r", b"\xff\xfe"]  # fmt: skip
    chosen = [lines[int(index)] for index in random.integers(0, len(lines), 8)]
    _rewrite(folder / "curve.csv", lambda content: bytes(content) + b"\n".join(chosen))


def _many_names(folder: Path, _: Path, random: Random) -> None:
    snapshots = folder / "snapshots"
    if snapshots.is_dir():
        for _ in range(30):
            number = int(10 ** random.uniform(0, 14))
            path = snapshots / f"{number:06d}.npy"
            if not path.exists() and not path.is_symlink():
                path.write_bytes(random.bytes(20))
        (snapshots / "٠٠٠٠٠٢.npy").write_bytes(b"")


_DAMAGES: tuple[Callable[[Path, Path, Random], None], ...] = (
    _flip_bits, _flip_bits, _cut, _zero_tail, _insert, _delete, _swap, _link_outside, _hard_link_outside, _pipe,
    _folder_for_file, _link_snapshots, _grow, _odd_value, _odd_value, _odd_value, _deep_text, _pickle_for_array,
    _pickle_for_checkpoint, _lying_header, _strange_curve, _many_names,
)  # fmt: skip
