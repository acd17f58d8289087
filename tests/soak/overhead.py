"""Measures what ``dmp batch`` adds to a job in a running cluster: ``python -m tests.soak.overhead STEPS PAIRS``.

The same job is done directly and by a batch, in turn; processor time is that of everything that takes part, which is this
process (with the scheduler and the worker's keeper in it) and the worker.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

from dmp.batch.asking import ask
from dmp.batch.cluster import local_client
from dmp.batch.conducting import Place, run_batch
from dmp.batch.doing import Order, do_job
from dmp.batch.jobs import jobs_from_files
from dmp.meshio import write_mesh
from dmp.settings import settings_for
from tests.meshes import sphere_mesh


def measure(steps: int, pairs: int) -> None:
    """Print seconds on the clock and of processor time for seeds 1 to ``pairs``, on 4,098 vertices; seed 0 is not counted."""
    with tempfile.TemporaryDirectory(prefix="dmp-overhead-") as name, local_client(1) as client:
        folder, ball = Path(name), sphere_mesh(5)
        noise = 0.01 * np.random.default_rng(0).standard_normal(ball.vertices.shape)
        write_mesh(folder / "scan.ply", ball.with_vertices(ball.vertices + noise))
        walls: list[float] = []
        costs: list[float] = []
        for seed in range(pairs + 1):
            settings = settings_for("denoise", steps=steps, threads=1, seed=seed)
            [job] = jobs_from_files([str(folder / "scan.ply")], settings, None)
            place, found = Place(scheduler=client.scheduler.address), {}
            for kind in ("direct", "batch") if seed % 2 else ("batch", "direct"):
                began = _now(client)
                if kind == "direct":
                    do_job(job, folder / f"direct{seed}", Order(), threads=1)
                else:
                    run_batch([job], folder / f"batch{seed}", place)
                found[kind] = _now(client) - began
            wall, here, there = (found["batch"] - found["direct"]).tolist()
            print(
                f"seed {seed}: direct {found['direct'].round(2)}, batch {found['batch'].round(2)} (clock, here, worker)",
                flush=True,
            )
            if seed:
                walls.append(wall)
                costs.append(here + there)
        clock, processor = statistics.median(walls), statistics.median(costs)
        print(f"median difference: {clock:.2f} s on the clock, {processor:.2f} s of processor time")
        print(f"load average: {os.getloadavg()[0]:.1f}")


def _now(client: object) -> np.ndarray:
    [there] = ask(client, time.process_time).values()  # type: ignore[arg-type]
    return np.array([time.perf_counter(), time.process_time(), there])


if __name__ == "__main__":
    torch.set_num_threads(1)
    measure(int(sys.argv[1]), int(sys.argv[2]))
