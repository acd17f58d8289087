"""Run folders and checkpoints from others: nothing in them is run, followed, or allocated on its word."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import pickle
import resource
import shutil
import sys
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dmp.errors import DmpError, RunError, TrainingError
from dmp.mesh import TriangleMesh
from dmp.problem import denoising
from dmp.run_files import checkpoint_bytes, parse_checkpoint, parse_curve
from dmp.run_folder import RunFolder
from dmp.runs import Run, list_runs, record
from dmp.settings import settings_for
from dmp.training_state import tensor_bytes


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 4 of its 8 steps, with a kept step; not to be changed."""
    from tests.meshes import sphere_mesh

    sphere = sphere_mesh(2)
    noisy = sphere.with_vertices(sphere.vertices + 0.03 * np.random.default_rng(0).standard_normal(sphere.vertices.shape))
    settings = settings_for("denoise", steps=8, snapshot_every=2, log_every=1, threads=1, width_divisor=16)
    folder = tmp_path_factory.mktemp("honest") / "run"
    run = Run.create(denoising(noisy, settings, sphere), settings, folder=folder)
    records = record(run.resume(), run)
    for item in records:
        if item.step == 4:
            break
    records.close()  # type: ignore[attr-defined]
    run.keep(2)
    return folder


@pytest.fixture
def folder(honest: Path, tmp_path: Path) -> Path:
    """A copy of it to damage."""
    shutil.copytree(honest, tmp_path / "run")
    return tmp_path / "run"


def use_everything(folder: Path) -> None:
    """Open a run and look at all of it, as the window does; raises RunError and the like, nothing else."""
    run = Run.open(folder)
    problem = run.problem()
    assert isinstance(problem.mesh, TriangleMesh)
    run.curve()
    for step in run.snapshot_steps():
        run.mesh_at(step)
    assert run.kept_step in (None, *run.snapshot_steps())
    run.suggestion()
    for text in (run.name, run.state, run.reason, run.created, str(run.device), str(run.input_path)):
        text.encode()
    run.resume()


def test_an_honest_run_is_usable(folder: Path) -> None:
    use_everything(folder)
    assert Run.open(folder).warnings == []


# -- checkpoints ------------------------------------------------------------------------------------------------------


class _Malice:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (exec, ("import os, pathlib; pathlib.Path(os.environ['MALICE']).touch()",))


def _signed(body: bytes) -> bytes:
    return b"dmp-checkpoint 1 sha256 " + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


def _zipped(pickled: bytes, compression: int = zipfile.ZIP_STORED) -> bytes:
    """Return an archive as torch writes it, around a pickle of one's own."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        archive.writestr("archive/data.pkl", pickled)
        archive.writestr("archive/byteorder", b"little")
        archive.writestr("archive/version", b"3\n")
    return buffer.getvalue()


def _state(folder: Path) -> dict[str, Any]:
    return parse_checkpoint((folder / "checkpoint.pt").read_bytes(), "")


def test_a_checkpoint_comes_back_as_it_was(folder: Path) -> None:
    state = _state(folder)
    assert state["step"] == 4
    assert state["run_id"] == Run.open(folder).run_id
    assert Run.open(folder).resume().step == 4


def test_damage_of_a_checkpoint_is_found(folder: Path) -> None:
    content = bytearray((folder / "checkpoint.pt").read_bytes())
    for position in np.random.default_rng(0).integers(0, len(content), 60):
        flipped = bytearray(content)
        flipped[position] ^= 1
        with pytest.raises(RunError):
            parse_checkpoint(bytes(flipped), "")
    for length in (0, 10, len(content) // 2, len(content) - 1):
        with pytest.raises(RunError):
            parse_checkpoint(bytes(content[:length]), "")


@pytest.mark.parametrize("wrap", [lambda body: body, _zipped])
@pytest.mark.parametrize("protocol", [0, 2, 5])
def test_code_in_a_checkpoint_is_not_run(
    wrap: Callable[[bytes], bytes], protocol: int, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MALICE", str(tmp_path / "harm"))
    body = pickle.dumps({"version": 1, "network": _Malice()}, protocol=protocol)
    (folder / "checkpoint.pt").write_bytes(_signed(wrap(body)))
    with pytest.raises(RunError):
        Run.open(folder).resume()
    assert not (tmp_path / "harm").exists()


def test_a_compressed_checkpoint_is_not_unpacked() -> None:
    bomb = _zipped(b"\0" * 200_000_000, zipfile.ZIP_DEFLATED)
    assert len(bomb) < 1_000_000
    begin = time.monotonic()
    with pytest.raises(RunError, match="cannot be used"):
        parse_checkpoint(_signed(bomb), "")
    assert time.monotonic() - begin < 2


def test_a_checkpoint_that_claims_more_than_it_holds_is_refused(folder: Path) -> None:
    state = _state(folder)
    state["average"] = torch.zeros(1).expand(10**12)
    with pytest.raises(RunError, match="cannot be used"):
        parse_checkpoint(checkpoint_bytes(state), "")
    laughs: Any = torch.zeros(4)
    for _ in range(7):
        laughs = [laughs] * 100
    with pytest.raises(ValueError, match="too many"):
        tensor_bytes({"average": laughs})
    deep: Any = 0
    for _ in range(100):
        deep = [deep]
    with pytest.raises(ValueError, match="deeply"):
        tensor_bytes({"average": deep})


def test_a_checkpoint_larger_than_any_is_not_read(folder: Path) -> None:
    with (folder / "checkpoint.pt").open("r+b") as file:
        file.truncate(10**10)
    begin = time.monotonic()
    with pytest.raises(RunError, match="more than this program ever writes"):
        Run.open(folder).resume()
    assert time.monotonic() - begin < 2


def _spoilt(change: str, state: dict[str, Any]) -> Any:
    first = next(iter(state["network"]))
    moments = state["optimiser"]["state"]
    match change:
        case "list":
            return None
        case "version":
            state["version"] = 2
        case "weights that are no numbers":
            state["network"][first] = state["network"][first] * float("nan")
        case "average that is none":
            state["average"] = torch.full_like(state["average"], float("inf"))
        case "shape":
            state["network"][first] = state["network"][first][:-1]
        case "name":
            state["network"]["further"] = torch.zeros(3)
        case "text":
            state["network"] = "none"
        case "step":
            state["step"] = 10**30
        case "negative step":
            state["step"] = -1
        case "step as a text":
            state["step"] = "4"
        case "seconds":
            state["seconds"] = float("nan")
        case "shape of a moment":
            moments[0]["exp_avg"] = torch.zeros(1)
        case "fewer moments":
            del moments[0]
        case "negative moment":
            moments[0]["exp_avg_sq"] = -torch.ones_like(moments[0]["exp_avg_sq"])
        case "moment of whole numbers":
            moments[0]["exp_avg"] = moments[0]["exp_avg"].to(torch.int64)
        case "another mesh":
            state["average"] = state["average"][:-1]
        case "missing":
            del state["optimiser"]
        case "rest":
            state["rest"] = {"before": (1, torch.zeros(5, 3, dtype=torch.float64)), "resting_since": None}
        case "another run":
            state["run_id"] = "0" * 32
        case _:
            raise AssertionError(change)
    return state


@pytest.mark.parametrize(
    "change",
    ["list", "version", "weights that are no numbers", "average that is none", "shape", "name", "text", "step", "negative step",
     "step as a text", "seconds", "shape of a moment", "fewer moments", "negative moment", "moment of whole numbers",
     "another mesh", "missing", "rest", "another run"],
)  # fmt: skip
def test_a_state_that_does_not_fit_is_refused(change: str, folder: Path) -> None:
    spoilt = _spoilt(change, _state(folder))
    content = _signed_list() if spoilt is None else checkpoint_bytes(spoilt)
    (folder / "checkpoint.pt").write_bytes(content)
    with pytest.raises((RunError, TrainingError)) as caught:
        Run.open(folder).resume()
    assert "\n" not in str(caught.value)


def _signed_list() -> bytes:
    buffer = io.BytesIO()
    torch.save([1, 2, 3], buffer)
    return _signed(buffer.getvalue())


def test_the_settings_of_the_optimiser_are_those_of_the_run(folder: Path) -> None:
    state = _state(folder)
    for group in state["optimiser"]["param_groups"]:
        group.update(lr=float("nan"), betas="none", fused=None, params=[10**6])
    (folder / "checkpoint.pt").write_bytes(checkpoint_bytes(state))
    run = Run.open(folder)
    *_, last = record(run.resume(), run)
    assert last.step == 8
    assert np.isfinite(list(last.metrics.values())).all()


# -- arrays -----------------------------------------------------------------------------------------------------------


def _npy(array: np.ndarray, **changes: object) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, **changes)  # type: ignore[arg-type]
    return buffer.getvalue()


def _with_header(header: bytes, body: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    return b"\x93NUMPY" + version + len(header).to_bytes(2, "little") + header + body


def _array_damages() -> Iterator[tuple[str, bytes]]:
    good = np.zeros((66, 3), dtype=np.float32)
    yield "empty", b""
    yield "cut header", b"\x93NUMPY\x01\x00"
    yield "cut", _npy(good)[:-5]
    yield "zeros", b"\0" * 1000
    yield "more", _npy(good) + b"x"
    yield "another shape", _npy(good[:3])
    yield "flat", _npy(good.ravel())
    yield "whole numbers", _npy(good.astype(np.int32))
    yield "big-endian", _npy(good.astype(">f4"))
    yield "half precision", _npy(good.astype(np.float16))
    yield "not a number", _npy(np.full((66, 3), np.nan, dtype=np.float32))
    yield "other order", _npy(np.asfortranarray(good.astype(np.float64)))
    yield "objects", _npy(np.array([[_Malice()] * 3] * 66, dtype=object), allow_pickle=True)
    yield (
        "a thousand times a thousand rows",
        _with_header(b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 3), }\n", good.tobytes()),
    )
    yield "negative", _with_header(b"{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 3), }\n", good.tobytes())
    yield "deep header", _with_header(b"(" * 400 + b")" * 400 + b"\n", good.tobytes())
    yield "code", _with_header(b"__import__('os').system('touch ' + __import__('os').environ['MALICE'])\n", good.tobytes())
    yield "version 2", b"\x93NUMPY\x02\x00" + (10**9).to_bytes(4, "little") + b"{}"
    yield "archive", zipped if (zipped := _zipped(b"x")) else b""


@pytest.mark.parametrize(("name", "content"), list(_array_damages()), ids=lambda value: value if isinstance(value, str) else "")
def test_arrays_that_are_none_are_refused(
    name: str, content: bytes, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MALICE", str(tmp_path / "harm"))
    (folder / "snapshots" / "000002.npy").write_bytes(content)
    with pytest.raises(RunError):
        Run.open(folder).snapshot(2)
    # Neither the base, whose digest stands in the description, nor where there is no digest.
    (folder / "base.npy").write_bytes(content)
    with pytest.raises(RunError, match="not what was written"):
        Run.open(folder).problem()
    _change(folder, files={})
    with pytest.raises(RunError, match=r"base\.npy"):
        Run.open(folder).problem()
    assert not (tmp_path / "harm").exists()


def test_a_flipped_bit_of_a_snapshot_is_found(folder: Path) -> None:
    path = folder / "snapshots" / "000002.npy"
    content = path.read_bytes()
    for position in np.random.default_rng(1).integers(0, len(content), 60):
        flipped = bytearray(content)
        flipped[position] ^= 1 << int(position % 8)
        path.write_bytes(flipped)
        with pytest.raises(RunError):
            Run.open(folder).snapshot(2)


def test_other_programs_read_the_snapshots_too(folder: Path) -> None:
    displacement = np.load(folder / "snapshots" / "000002.npy")
    run = Run.open(folder)
    assert np.array_equal(run.problem().base + displacement, run.snapshot(2).vertices)
    # And such as have no digest are read here.
    np.save(folder / "snapshots" / "000002.npy", displacement)
    assert np.array_equal(run.snapshot(2).vertices, run.problem().base + displacement)


# -- texts ------------------------------------------------------------------------------------------------------------


def _change(folder: Path, **changes: Any) -> None:
    manifest = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps({**manifest, **changes}))


@pytest.mark.parametrize(
    "content",
    [b"", b"[]", b"{}", b"\0", b"\xff\xfe{", b'{"format": 9}', b'{"format": 1, "settings": {"steps": -1}}', b"[" * 100_000,
     b'{"a":' * 100_000, b"9" * 100_000, b"null", b'"run"', b" " * 2_000_000],
)  # fmt: skip
def test_a_description_that_is_none_is_one_sentence(content: bytes, folder: Path) -> None:
    (folder / "run.json").write_bytes(content)
    with pytest.raises(RunError) as caught:
        Run.open(folder)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 600
    (folder / "kept.json").write_bytes(content)
    shutil.copytree(folder, folder.parent / "among" / "run")
    assert list_runs(folder.parent / "among") == []


@pytest.mark.parametrize(
    "changes",
    [
        {"format": [1]},
        {"run_id": "../../etc"},
        {"run_id": 5},
        {"name": ["a"]},
        {"created": {}},
        {"state": "exploded"},
        {"last_step": 10**300},
        {"last_step": 1.5},
        {"last_step": True},
        {"vertices": -1},
        {"settings": []},
        {"settings": {"steps": 10**400}},
        {"settings": {"learning_rate": 10**400}},
        {"settings": {"learning_rate": float("nan")}},
        {"settings": {"device": "/dev/sda"}},
        {"settings": {"task": "destroy"}},
    ],
)
def test_a_description_with_something_impossible_is_refused(changes: dict[str, Any], folder: Path) -> None:
    _change(folder, **changes)
    with pytest.raises(RunError):
        Run.open(folder)


@pytest.mark.parametrize(
    "changes",
    [
        {"input": {"path": "../../../etc/passwd"}},
        {"input": {"path": "//server/share/mesh.ply"}},
        {"input": {"path": "\\\\server\\share\\mesh.ply"}},
        {"input": {"path": "/tmp/\0"}},
        {"input": {"path": "/tmp/\ud800.ply"}},
        {"input": {"path": "/" + "a" * 100_000}},
        {"input": {"path": 5}},
        {"input": "/etc/passwd"},
        {"threads": 10**9},
        {"threads": "all"},
        {"input_faces": 10**12},
        {"input_faces": -5},
        {"device": {"a": 1}},
        {"device": "cpu\n\x1b[2J"},
        {"files": ["input.ply"]},
        {"reason": "\n" * 10**5},
    ],
)
def test_what_is_odd_in_a_description_is_not_believed(changes: dict[str, Any], folder: Path) -> None:
    _change(folder, **changes)
    run = Run.open(folder)
    assert run.input_path is None
    assert run.recorded_threads in (None, 1)
    assert run.problem().n_input_faces is None
    assert "\n" not in f"{run.device}{run.reason}"
    # That somebody else has written it is told.
    assert any("not as this program wrote it" in warning for warning in run.warnings)
    use_everything(folder)


def test_a_name_is_shown_without_anything_invisible(folder: Path) -> None:
    _change(folder, name="scan\u202egpj.ply\n\x1b[31m\ud800" + "x" * 10_000)
    name = Run.open(folder).name
    assert name.startswith("scangpj.ply[31mxxx")
    assert len(name) == 200


@pytest.mark.parametrize("step", [10**12, -1, 3, "2", None, [2], 2.0, True, {"a": 1}])
def test_a_kept_step_that_is_none_counts_as_none(step: object, folder: Path) -> None:
    (folder / "kept.json").write_text(json.dumps({"step": step}))
    assert Run.open(folder).kept_step is None


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", []),
        (b"\0" * 100_000, []),
        (b"," * 1_000_000 + b"\n" + b"1," * 1_000_000 + b"\n", []),
        (b"step,seconds\n" + b"9" * 100_000 + b",1\n", []),
        (b"step,seconds\n1e300,1\ninf,1\nnan,1\n-1,1\n2,inf\n3,nan\n4,1e300\n", []),
        (b"step,seconds\n5,1.5\n", [{"step": 5, "seconds": 1.5}]),
        (b"step,password\n5,1.5\n", [{"step": 5}]),
        (b"seconds,step\n1.5,5\n1.25,4\n", [{"step": 4, "seconds": 1.25}, {"step": 5, "seconds": 1.5}]),
        ("step,seconds\n٥,1\n".encode(), []),
    ],
)
def test_curves_hold_numbers_or_nothing(content: bytes, expected: list[dict[str, float]]) -> None:
    assert parse_curve(content) == expected


def test_a_curve_larger_than_any_is_not_read(folder: Path) -> None:
    with (folder / "curve.csv").open("r+b") as file:
        file.truncate(10**10)
    begin = time.monotonic()
    with pytest.raises(RunError, match="more than this program ever writes"):
        Run.open(folder).curve()
    assert time.monotonic() - begin < 1


# -- links, pipes and devices -----------------------------------------------------------------------------------------

PARTS = ["run.json", "input.ply", "ground_truth.ply", "base.npy", "curve.csv", "checkpoint.pt", "kept.json",
         "snapshots/000002.npy"]  # fmt: skip


@pytest.fixture
def within_seconds() -> Iterator[None]:
    """Fail, rather than wait for ever, when something opens a pipe."""
    begin = time.monotonic()
    yield
    assert time.monotonic() - begin < 10


@pytest.mark.usefixtures("within_seconds")
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("kind", ["link", "pipe", "device", "folder"])
def test_nothing_but_files_is_opened(part: str, kind: str, folder: Path, tmp_path: Path) -> None:
    path, outside = folder / part, tmp_path / "outside"
    path.replace(outside)
    if kind == "link":
        path.symlink_to(outside)
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    _unchanged_while(lambda: _use(folder), outside)
    if part == "kept.json":
        assert Run.open(folder).kept_step is None
    else:
        with pytest.raises(RunError):
            use_everything(folder)


def _use(folder: Path) -> None:
    try:
        use_everything(folder)
    except DmpError:
        return


def _unchanged_while(work: Callable[[], None], *paths: Path) -> None:
    before = [(path.read_bytes(), path.stat().st_mtime_ns) for path in paths]
    work()
    assert [(path.read_bytes(), path.stat().st_mtime_ns) for path in paths] == before


@pytest.mark.usefixtures("within_seconds")
@pytest.mark.parametrize("part", ["curve.csv", "checkpoint.pt", "kept.json", "snapshots/000006.npy", "run.lock"])
def test_training_writes_through_no_link(part: str, folder: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    original = folder / part
    victim.write_bytes(original.read_bytes() if original.exists() else b"precious")
    original.unlink(missing_ok=True)
    run = Run.open(folder)
    training = run.resume() if part != "checkpoint.pt" else None
    original.symlink_to(victim)

    def work() -> None:
        if training is not None:
            with suppress(RunError):
                for item in record(training, run):
                    if item.step == 6:
                        run.keep(6)

    _unchanged_while(work, victim)


def test_a_linked_folder_of_snapshots_is_neither_read_nor_written(folder: Path, tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    (folder / "snapshots").replace(outside)
    (folder / "snapshots").symlink_to(outside)
    run = Run.open(folder)
    assert run.snapshot_steps() == []
    with pytest.raises(RunError, match="a link"):
        run.snapshot(2)
    names = sorted(path.name for path in outside.iterdir())
    list(record(run.resume(), run))
    assert sorted(path.name for path in outside.iterdir()) == names
    # Nothing is lost: what could not be written is in memory.
    assert run.snapshot_steps() == [6, 8]
    assert any("is a link, which is not followed" in warning for warning in run.warnings)


def test_a_curve_with_a_second_name_is_replaced_and_not_written_into(folder: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    os.link(folder / "curve.csv", victim)
    run = Run.open(folder)
    _unchanged_while(lambda: list(record(run.resume(), run)).clear(), victim)
    assert len(run.curve()) == 9
    os.link(folder / "curve.csv", tmp_path / "again")
    with pytest.raises(OSError, match="not a file of this run alone") as caught:
        RunFolder(folder).append("curve.csv", b"x")
    assert caught.value.errno == errno.EINVAL


@pytest.mark.usefixtures("within_seconds")
def test_a_lock_that_is_a_pipe_is_not_waited_for(folder: Path) -> None:
    (folder / "run.lock").unlink()
    os.mkfifo(folder / "run.lock")
    run = Run.open(folder)
    assert run.state == "stopped"
    assert len(list(record(run.resume(), run))) == 4
    assert any("no regular file" in warning for warning in run.warnings)


# -- nothing outside --------------------------------------------------------------------------------------------------

_watched: list[str] | None = None


def _watch(event: str, arguments: tuple[Any, ...]) -> None:
    # Other threads have nothing to do with it.
    if _watched is not None and event == "open" and threading.current_thread() is threading.main_thread():
        _watched.append(os.fsdecode(arguments[0]) if isinstance(arguments[0], (str, bytes, os.PathLike)) else "")


def test_no_path_outside_the_folder_is_opened(folder: Path, tmp_path: Path) -> None:
    global _watched  # noqa: PLW0603
    outside = tmp_path / "elsewhere.ply"
    outside.write_bytes(b"ply\n")
    _change(folder, input={"path": str(outside)}, ground_truth={"path": str(outside)})
    _use(folder)  # so that all modules are loaded
    sys.addaudithook(_watch)
    _watched = []
    try:
        from dmp_viewer.tasks import open_run

        opened = open_run(folder)
        use_everything(folder)
        list(record(opened.run.resume(), opened.run))
    finally:
        seen, _watched = _watched, None
    assert any(name.endswith("input.ply") for name in seen)
    assert str(outside) not in seen
    foreign = [name for name in seen if str(tmp_path) in name and not name.startswith(str(folder))]
    assert foreign == []


def test_little_memory_is_enough_for_great_claims(folder: Path) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for content in (content for _, content in _array_damages()):
        (folder / "base.npy").write_bytes(content)
        (folder / "input.ply").write_bytes(
            b"ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\nproperty double x\nproperty double y\n"
            b"property double z\nelement face 2000000000\nproperty list uchar int vertex_indices\nend_header\n" + content
        )
        _use(folder)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB
