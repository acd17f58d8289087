"""What is put into run folders to do harm, and what uses all of such a folder."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dmp.errors import DmpError
from dmp.mesh import TriangleMesh
from dmp.runs import Run


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


def use_or_refuse(folder: Path) -> None:
    """Do the same, where a refusal is as good."""
    try:
        use_everything(folder)
    except DmpError:
        return


def change_description(folder: Path, **changes: Any) -> None:
    """Write other values into the description of a run."""
    manifest = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps({**manifest, **changes}))


class Malice:
    """Touches the file that the environment variable MALICE names, when it is unpickled."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (exec, ("import os, pathlib; pathlib.Path(os.environ['MALICE']).touch()",))


def zipped(pickled: bytes, compression: int = zipfile.ZIP_STORED) -> bytes:
    """Return an archive as torch writes it, around a pickle of one's own."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        archive.writestr("archive/data.pkl", pickled)
        archive.writestr("archive/byteorder", b"little")
        archive.writestr("archive/version", b"3\n")
    return buffer.getvalue()


def _npy(array: np.ndarray, **changes: object) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, **changes)  # type: ignore[arg-type]
    return buffer.getvalue()


def _with_header(header: bytes, body: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    return b"\x93NUMPY" + version + len(header).to_bytes(2, "little") + header + body


def array_damages() -> Iterator[tuple[str, bytes]]:
    """Yield names and contents of files that are none of the arrays of 66 points which belong there."""
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
    yield "objects", _npy(np.array([[Malice()] * 3] * 66, dtype=object), allow_pickle=True)
    yield (
        "a thousand times a thousand rows",
        _with_header(b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 3), }\n", good.tobytes()),
    )
    yield "negative", _with_header(b"{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 3), }\n", good.tobytes())
    yield "deep header", _with_header(b"(" * 400 + b")" * 400 + b"\n", good.tobytes())
    yield "code", _with_header(b"__import__('os').system('touch ' + __import__('os').environ['MALICE'])\n", good.tobytes())
    yield "version 2", b"\x93NUMPY\x02\x00" + (10**9).to_bytes(4, "little") + b"{}"
    yield "archive", zipped(b"x")
