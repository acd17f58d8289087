"""Where a training computes: the device and the number of processor threads."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import torch

from dmp.errors import SettingsError

if TYPE_CHECKING:
    from dmp.settings import Precision

# From so many channels in the widest layer on, bfloat16 was measured to be faster where the processor has products for it; and
# with fewer, for meshes of so many vertices.
_WIDE, _LESS_WIDE, _MANY_VERTICES = 512, 128, 15_000


def choose_device(name: str) -> torch.device:
    """Return the device that ``name`` (auto, cpu, cuda or cuda:N) stands for.

    Raises:
        SettingsError: when a CUDA device is asked for and cannot be used.
    """
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    device = torch.device(name)
    if device.type == "cuda":
        if not torch.cuda.is_available():
            raise SettingsError(
                f"--device {name} needs an NVIDIA GPU and a CUDA build of torch, and none can be used here "
                f"(torch {torch.__version__}). Use --device cpu, or install a CUDA build as the README tells."
            )
        if (device.index or 0) >= torch.cuda.device_count():
            raise SettingsError(f"--device {name}: there are only {torch.cuda.device_count()} GPUs, numbered from 0.")
    return device


def device_description(device: torch.device) -> str:
    """Return the device as a person would name it, such as ``cpu`` or ``cuda:0 (NVIDIA H200)``."""
    if device.type == "cuda":
        return f"cuda:{device.index or 0} ({torch.cuda.get_device_name(device)})"
    return device.type


def has_fast_bfloat16() -> bool:
    """Return whether the processor multiplies matrices of bfloat16 in hardware made for it (Intel's AMX).

    Without it they were not found to be faster. Systems other than Linux do not say, and are taken to have none.
    """
    try:
        return " amx_bf16" in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False


@contextlib.contextmanager
def cuda_products(precision: Literal["tf32", "ieee"]) -> Iterator[None]:
    """Have dense float32 products on GPUs computed in TF32, with factors of 10 binary places, or in full ("ieee").

    The setting is the process's; afterwards it is as it was. GPUs without TF32 compute in full.
    """
    products = torch.backends.cuda.matmul
    before = products.fp32_precision
    products.fp32_precision = precision
    try:
        yield
    finally:
        products.fp32_precision = before


def type_between_layers(precision: Precision, widest: int, n_vertices: int) -> torch.dtype:
    """Return the type of the numbers that a network on the processor keeps between its layers.

    Args:
        precision: of the settings; ``auto`` takes bfloat16 where it was measured to be faster.
        widest: channels of the widest layer.
        n_vertices: of the mesh.
    """
    if precision == "auto":
        is_wide = widest >= (_LESS_WIDE if n_vertices >= _MANY_VERTICES else _WIDE)
        return torch.bfloat16 if is_wide and has_fast_bfloat16() else torch.float32
    return torch.bfloat16 if precision == "bfloat16" else torch.float32


def available_cores() -> int:
    """Return how many processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def cores_beside_a_window() -> int:
    """Return how many threads to train with while a window must stay alive: one core is left to it."""
    return max(1, available_cores() - 1)
