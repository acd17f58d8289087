"""Running a compiled kernel on several threads: those that torch's own operations use, so that no two teams compete."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch

from dmp.compiled.kernel import Kernel


def launch(kernel: Kernel, arguments: Sequence[int], parts: int) -> None:
    """Run ``kernel``, which takes one part of the work after the other until none is left, on the threads of torch.

    Args:
        kernel: gets a pointer to int64: number of the next part, number of parts, ``arguments``.
        arguments: sizes and addresses; what lies there must stay where it is until this returns.
        parts: number of parts.
    """
    job = np.array((0, parts, *arguments), dtype=np.int64)
    threads = min(torch.get_num_threads(), parts)
    if threads > 1 and _in_parallel is not None:
        _in_parallel(kernel.address, job.ctypes.data, threads, 0)
    else:
        _CALL(kernel.address)(job.ctypes.data)


_CALL = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


def _find_in_parallel() -> Callable[[int, int, int, int], None] | None:
    """Return ``GOMP_parallel(function, data, threads, flags)`` of the OpenMP library that torch brings along, or None.

    Without it kernels run on one thread, with the same results.
    """
    for library in sorted((Path(torch.__file__).parent / "lib").glob("lib*omp*")):
        try:
            function = ctypes.CDLL(str(library)).GOMP_parallel
        except (OSError, AttributeError):
            continue
        function.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint, ctypes.c_uint)
        function.restype = None
        found: Callable[[int, int, int, int], None] = function
        return found
    return None


_in_parallel = _find_in_parallel()
