"""Seconds per training step of the presets, beside torch_geometric and beside what the machine could do at best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch

from dmp.benchmark.floors import copying, least_traffic, matrix_products
from dmp.benchmark.rivals import peer_steps
from dmp.benchmark.settings import for_timing
from dmp.benchmark.timing import take_turns
from dmp.captured_step import WARM_UP
from dmp.devices import available_cores, choose_device, cuda_products, has_fast_bfloat16
from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.network import LAYOUTS
from dmp.problem import Problem, denoising
from dmp.settings import Settings
from dmp.training import Training

_FLOAT32, _BFLOAT16, _TF32 = "dmp, float32", "dmp, bfloat16", "dmp, TF32"
_PRODUCTS, _PRODUCTS_BFLOAT16 = "matrix products alone, float32", "matrix products alone, bfloat16"
_PRODUCTS_TF32 = "matrix products alone, TF32"
_COPY = "copying"


def time_steps(
    mesh: TriangleMesh,
    preset: str,
    *,
    rounds: int = 5,
    threads: int = 0,
    rivals: bool = True,
    device: str = "cpu",
    **overrides: Any,
) -> dict[str, Any]:
    """Time whole training steps of one preset; all contestants take turns in this process.

    Args:
        mesh: noisy.
        preset: of denoising.
        rounds: steps of each contestant that count.
        threads: processor threads; 0 for all.
        rivals: whether torch_geometric takes part.
        device: where all of them compute: cpu, cuda or cuda:N.
        overrides: of single settings.

    Returns:
        Counts; medians in seconds by contestant, of wall and of processor time; the floor of memory traffic; and the ratio
        of our processor time, on a GPU of our wall time, to each of the others'.

    Raises:
        SettingsError: when torch_geometric is wanted and not installed, or there is no such device.
    """
    threads = threads or available_cores()
    settings = for_timing(preset, threads, **{"device": device, **overrides})
    place = choose_device(settings.device)
    is_gpu = place.type == "cuda"
    problem = denoising(mesh, settings)
    training = training_for(problem, settings)
    contestants: dict[str, Callable[[], object]] = {_FLOAT32: _stepping(training)}
    values: dict[str, Any] = {
        "preset": preset,
        "vertices": mesh.n_vertices,
        "faces": mesh.n_faces,
        "parameters": training.n_parameters,
        "threads": threads,
        "device": str(place),
        "rounds": rounds,
    }
    if is_gpu:
        contestants[_TF32] = _stepping(training_for(problem, replace(settings, precision="auto")))
    traffic = None
    if settings.method == "prior":
        traffic = _add_company(contestants, problem, settings, rivals)
    # On a GPU a step is recorded after a few usual ones, and goes on when it has been sent.
    of_gpu: dict[str, Any] = {"warm_up": WARM_UP + 2, "finish": lambda: torch.cuda.synchronize(place)} if is_gpu else {}
    timings = take_turns(contestants, rounds, **of_gpu)
    values["seconds"] = {name: timing.seconds for name, timing in timings.items() if name != _COPY}
    values["processor_seconds"] = {name: timing.processor_seconds for name, timing in timings.items() if name != _COPY}
    if traffic is not None:
        bytes_moved, bytes_copied = traffic
        values["traffic_bytes"] = bytes_moved
        values["copy_bytes_per_second"] = bytes_copied / timings[_COPY].seconds
        values["seconds"]["memory traffic alone, float32"] = bytes_moved / bytes_copied * timings[_COPY].seconds
        values["processor_seconds"]["memory traffic alone, float32"] = (
            bytes_moved / bytes_copied * timings[_COPY].processor_seconds
        )
    compared = values["seconds" if is_gpu else "processor_seconds"]
    values["ratios"] = {name: compared[_FLOAT32] / seconds for name, seconds in compared.items() if name != _FLOAT32}
    return values


def _stepping(training: Training) -> Callable[[], object]:
    steps = training.steps()
    next(steps)  # the untrained network, and the number of threads
    return lambda: next(steps)


def _add_company(
    contestants: dict[str, Callable[[], object]], problem: Problem, settings: Settings, rivals: bool
) -> tuple[int, int]:
    """Add whatever is compared with the displacement network; return the bytes of a step and those of the copying."""
    layout = LAYOUTS[settings.architecture].divided(settings.width_divisor)
    sizes = (settings.input_channels, *layout.widths, layout.hidden, 3)
    n_vertices, place = problem.mesh.n_vertices, choose_device(settings.device)
    if place.type == "cuda":
        products = matrix_products(n_vertices, sizes, device=place)

        def run_in_tf32() -> None:
            with cuda_products("tf32"):
                products()

        contestants[_PRODUCTS_TF32] = run_in_tf32
    elif has_fast_bfloat16():
        halved = for_timing(settings.preset, settings.threads, precision="bfloat16", width_divisor=settings.width_divisor)
        contestants[_BFLOAT16] = _stepping(training_for(problem, halved))
        contestants[_PRODUCTS_BFLOAT16] = matrix_products(n_vertices, sizes, torch.bfloat16)
    if rivals:
        contestants.update(peer_steps(problem, settings))
    contestants[_PRODUCTS] = matrix_products(n_vertices, sizes, device=place)
    contestants[_COPY], copied = copying(place)
    return least_traffic(n_vertices, sizes), copied


def steps_text(values: dict[str, Any]) -> str:
    """Return the comparison as lines for people."""
    where = f"{values['threads']} threads" if values["device"] == "cpu" else values["device"]
    lines = [
        f"Preset {values['preset']}, {values['vertices']} vertices, {values['parameters']} parameters, "
        f"{where}, median of {values['rounds']} steps taken in turns:",
        f"  {'':36} {'wall':>9} {'processor':>10}   dmp, float32, takes",
    ]
    for name, seconds in values["seconds"].items():
        ratio = f"{values['ratios'][name]:5.2f} times as long" if name in values["ratios"] else ""
        lines.append(f"  {name:36} {seconds:7.3f} s {values['processor_seconds'][name]:8.3f} s   {ratio}".rstrip())
    return "\n".join(lines)
