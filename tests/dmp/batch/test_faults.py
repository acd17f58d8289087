"""A disk that is full where a job is done: it ends with that reason, and is done when there is room again."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pytest

from dmp.batch import conducting
from dmp.batch.conducting import Place, run_batch
from dmp.batch.doing import Order, deliver, do_job
from dmp.batch.jobs import jobs_from_files
from dmp.batch.summary import write_summary
from dmp.errors import RunError
from dmp.settings import settings_for
from tests.soak.disks import _disk, _fill

SETTINGS = settings_for("denoise", steps=8, snapshot_every=4, log_every=2, threads=1, width_divisor=32)


@pytest.mark.parametrize("free", [0, 60_000])
def test_a_full_disk_on_the_worker_is_the_reason(
    scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int
) -> None:
    [job, *_] = jobs_from_files([str(scans)], SETTINGS, None)
    delivery = deliver(job, tmp_path / "out" / "runs" / job.name)
    (tmp_path / "disks").mkdir()
    with _disk(tmp_path / "disks") as disk:
        if disk is None:
            pytest.skip("a disk can be mounted by the superuser only")
        monkeypatch.setattr(tempfile, "tempdir", str(disk))
        _fill(disk, free)
        done = do_job(job, None, Order(batch="full"), delivery, threads=1)
        assert "the disk is full" in done.outcome.failure
        assert not done.outcome.result
        # Nothing is left of it but what fills the disk.
        assert [path.name for path in disk.rglob("*") if path.is_file()] == ["filler"]
        (disk / "filler").unlink()
        again = do_job(job, None, Order(batch="full"), delivery, threads=1)
        assert again.outcome.failure == ""
        assert again.result


def test_a_full_disk_at_home_is_told_and_the_next_call_goes_on(
    cluster: Any, scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conducting, "check_versions", lambda *_: ())
    jobs = jobs_from_files([str(scans)], SETTINGS, None)
    place = Place(scheduler=cluster.scheduler.address)
    (tmp_path / "disks").mkdir()
    with _disk(tmp_path / "disks") as disk:
        if disk is None:
            pytest.skip("a disk can be mounted by the superuser only")
        _fill(disk, 60_000)
        with pytest.raises(RunError, match="the disk is full"):
            run_batch(jobs, disk / "out", place)
        (disk / "filler").unlink()
        assert run_batch(jobs[:1], disk / "out", place).done == 1
        write_summary(jobs, disk / "out")
        assert "done" in (disk / "out" / "summary.md").read_text()
