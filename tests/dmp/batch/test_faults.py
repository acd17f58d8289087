"""A scheduler that restarts, with its workers."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from pathlib import Path

from dmp.batch.conducting import Place, Watcher, run_batch
from dmp.batch.folder import BatchFolder
from dmp.batch.jobs import jobs_from_files
from dmp.settings import settings_for
from tests.dmp.batch.conftest import make_scans
from tests.remote_server import served

SETTINGS = settings_for("denoise", steps=700, snapshot_every=25, log_every=25, threads=1, width_divisor=32)


def test_a_batch_outlives_a_restart_of_the_scheduler(tmp_path: Path) -> None:
    jobs = jobs_from_files([str(make_scans(tmp_path / "scans", 2))], SETTINGS, None)
    reached, said = threading.Event(), list[str]()
    with ExitStack() as first:
        (tmp_path / "first").mkdir()
        (tmp_path / "second").mkdir()
        port = first.enter_context(served(tmp_path / "first"))

        def restart() -> None:
            reached.wait(120)
            first.close()
            with served(tmp_path / "second", port=port):
                done.wait(200)

        done = threading.Event()
        restarting = threading.Thread(target=restart)
        restarting.start()
        try:
            counted = run_batch(
                jobs,
                tmp_path / "out",
                Place(scheduler=f"127.0.0.1:{port}"),
                watcher=Watcher(told=lambda _name, share: reached.set() if share > 0.1 else None, said=said.append),
            )
        finally:
            reached.set()
            done.set()
            restarting.join(60)
    assert (counted.done, counted.failed) == (2, 0)
    outcomes = [BatchFolder(tmp_path / "out").read(job.name) for job in jobs]
    assert all(outcome is not None and outcome.steps == 700 for outcome in outcomes)
    # The one that was under way went on from its checkpoint, and says why there were two attempts.
    again = [outcome for outcome in outcomes if outcome is not None and outcome.retries]
    assert len(again) == 1
    assert again[0].resumed_from > 0
    assert any("lost" in text for text in again[0].retries)
