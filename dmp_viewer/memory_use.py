"""How much memory the program uses now, where the system tells."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def process_memory() -> int | None:
    """Return the resident memory of this process in bytes, or None where the system does not tell it simply."""
    if sys.platform != "linux":
        return None
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return None
    return pages * os.sysconf("SC_PAGE_SIZE")


def device_memory(device: str) -> int | None:
    """Return what the tensors on a GPU take, in bytes; None for a training on the processor."""
    if not device.upper().startswith("CUDA"):
        return None
    import torch

    number = device.upper().removeprefix("CUDA:").split(" ")[0]
    return int(torch.cuda.memory_allocated(int(number) if number.isdigit() else 0)) if torch.cuda.is_available() else None


def memory_text(device: str) -> str:
    """Return in a few words what the program uses now; empty where the system does not tell."""
    used, on_gpu = process_memory(), device_memory(device)
    parts = [f"{size_text(used)} memory"] if used is not None else []
    return ", ".join([*parts, *([f"{size_text(on_gpu)} on the GPU"] if on_gpu is not None else [])])


def size_text(n_bytes: int) -> str:
    """Return a size as people say it: 850 MB, 1.3 GB."""
    megabytes = n_bytes / 1e6
    return f"{megabytes:.0f} MB" if megabytes < 1000 else f"{megabytes / 1000:.1f} GB"
