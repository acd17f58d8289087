"""What comes before and after the training: reading, smoothing, operators, writing; and the memory that a training takes."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from dmp.benchmark.meshes import noisy_torus
from dmp.errors import TrainingError
from dmp.memory import peak_memory
from dmp.mesh import TriangleMesh


def time_preparation(mesh: TriangleMesh, preset: str, suffix: str = ".ply") -> dict[str, float]:
    """Return the seconds that each part takes which is not training: import of the library, reading, and so on.

    Args:
        mesh: noisy.
        preset: of denoising.
        suffix: of the file that is read and written.
    """
    from dmp.meshio import read_mesh, write_mesh
    from dmp.methods import training_for
    from dmp.problem import Problem, check_trainable
    from dmp.settings import settings_for
    from dmp.smoothing import smooth

    settings = settings_for("denoise", preset, device="cpu")
    importing = [sys.executable, "-c", "import dmp.methods"]
    seconds = {"import": _timed(lambda: subprocess.run(importing, check=True))}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"mesh{suffix}"
        seconds["writing"] = _timed(lambda: write_mesh(path, mesh))
        seconds["reading"] = _timed(lambda: read_mesh(path))
    seconds["checking"] = _timed(lambda: check_trainable(mesh))
    started = time.perf_counter()
    base = smooth(mesh, settings.smoothing, settings.smoothing_steps)
    seconds["smoothing"] = time.perf_counter() - started
    problem = Problem.from_base(mesh, settings, base=base)
    seconds["operators"] = _timed(lambda: training_for(problem, settings))
    return seconds


def _timed(run: Callable[[], Any]) -> float:
    started = time.perf_counter()
    run()
    return time.perf_counter() - started


def measure_memory(n_vertices: int, preset: str, *, steps: int = 2, **overrides: Any) -> dict[str, float]:
    """Train a few steps in a process of its own and return its peak memory in bytes.

    Returns:
        ``start``: with the library loaded and nothing made; ``peak``: in the whole training; ``per_vertex``: the
        difference over the number of vertices.

    Raises:
        TrainingError: when the other process ends without an answer.
    """
    context = multiprocessing.get_context("spawn")
    receiving, sending = context.Pipe(duplex=False)
    process = context.Process(target=_train_a_little, args=(sending, n_vertices, preset, steps, overrides))
    process.start()
    sending.close()
    try:
        start, peak, made = receiving.recv()
    except EOFError as error:
        raise TrainingError(f"The training of {n_vertices} vertices whose memory was to be measured broke off.") from error
    finally:
        process.join()
        receiving.close()
    return {"vertices": made, "start": start, "peak": peak, "per_vertex": (peak - start) / made}


def _train_a_little(sending: Connection, n_vertices: int, preset: str, steps: int, overrides: dict[str, Any]) -> None:
    from dmp.methods import train
    from dmp.problem import denoising
    from dmp.settings import settings_for

    start = peak_memory()
    mesh = noisy_torus(n_vertices)
    settings = settings_for("denoise", preset, device="cpu", steps=steps, **overrides)
    for _ in train(denoising(mesh, settings), settings):
        pass
    sending.send((start, peak_memory(), mesh.n_vertices))
