"""Running a compiled kernel on several threads: those that torch's own operations use, so that no two teams compete."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch

from dmp.compiled.kernel import Kernel


def launch(kernel: Kernel, arguments: Sequence[int], parts: int, threads: int | None = None) -> None:
    """Run ``kernel``, which takes one part of the work after the other until none is left, on the threads of torch.

    Args:
        kernel: gets a pointer to int64: number of the next part, number of parts, ``arguments``.
        arguments: sizes and addresses; what lies there must stay where it is until this returns.
        parts: number of parts.
        threads: how many threads share them, of those of torch; all by default.
    """
    job = np.array((0, parts, *arguments), dtype=np.int64)
    threads = min(threads or torch.get_num_threads(), parts)
    if threads > 1 and _in_parallel is not None:
        _in_parallel(kernel.address, job.ctypes.data, threads, 0)
    else:
        # Products in a kernel would be divided among threads that nobody has asked for, each of them anew.
        before = _set_threads_of_products(1)
        try:
            _CALL(kernel.address)(job.ctypes.data)
        finally:
            _set_threads_of_products(before)


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


def _find_threads_of_products() -> Callable[[int], int]:
    """Return MKL's function that sets for this thread how many share a product (0: as for all), and returns what was set."""
    for library in (Path(torch.__file__).parent / "lib").glob("*torch_cpu*"):
        try:
            function = ctypes.CDLL(str(library)).MKL_Set_Num_Threads_Local
        except (OSError, AttributeError):
            continue
        function.argtypes, function.restype = (ctypes.c_int,), ctypes.c_int
        found: Callable[[int], int] = function
        return found
    # Where there is no MKL, kernels have no products.
    return lambda _: 0


_in_parallel, _set_threads_of_products = _find_in_parallel(), _find_threads_of_products()
