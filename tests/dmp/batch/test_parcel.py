"""Run folders as one piece of bytes, and what must never be unpacked."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dmp.batch.parcel import pack, private_folder, unpack
from dmp.errors import RunError
from dmp.mesh import TriangleMesh
from dmp.problem import denoising
from dmp.runs import Run, record
from dmp.settings import settings_for


def parcel(files: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def test_a_run_arrives_as_it_was_sent(noisy_sphere: TriangleMesh, tmp_path: Path) -> None:
    settings = settings_for("denoise", steps=4, snapshot_every=2, threads=1, width_divisor=32)
    sent = Run.create(denoising(noisy_sphere, settings), settings, folder=tmp_path / "sent")
    for _ in record(sent.resume(), sent):
        pass
    (tmp_path / "sent" / "notes.txt").write_text("mine")
    unpack(pack(tmp_path / "sent"), tmp_path / "come")
    come = Run.open(tmp_path / "come")
    assert come.run_id == sent.run_id
    assert come.curve() == sent.curve()
    for step in (0, 2, 4):
        assert np.array_equal(come.snapshot(step).vertices, sent.snapshot(step).vertices)
    assert come.resume(8).step == 4
    # Only what belongs to a run travels.
    assert not (tmp_path / "come" / "notes.txt").exists()
    unpack(pack(tmp_path / "sent", without_snapshots=True), tmp_path / "bare")
    assert Run.open(tmp_path / "bare").snapshot_steps() == []


@pytest.mark.parametrize(
    "name", ["../run.json", "/run.json", "snapshots/../../run.json", "run.json/x", "snapshots/1.npy", "x.sh", "remote.json"]
)
def test_a_parcel_with_anything_else_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="not a run folder"):
        unpack(parcel({"run.json": b"{}", name: b"x"}), tmp_path / "come")
    assert not (tmp_path / "run.json").exists()


def test_damaged_and_lying_parcels_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="damaged"):
        unpack(b"PK no archive", tmp_path / "come")
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("curve.csv", b"0" * 1_000_000)
    with pytest.raises(RunError, match="larger than it is"):
        unpack(buffer.getvalue(), tmp_path / "come")


def test_a_folder_of_ones_own_is_private(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    folder = private_folder("../batch 1")
    assert folder.parent.parent == tmp_path
    assert folder.parent.stat().st_mode & 0o077 == 0
