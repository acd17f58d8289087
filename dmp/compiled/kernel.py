"""Compiling functions into kernels, once for each version of the program and each processor."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
import platformdirs
import torch
from numba import cfunc, types

from dmp.compiled.pointers import halves

_OPTIONS: dict[str, Any] = {"fastmath": {"contract", "nsz"}, "error_model": "numpy"}
# In the function's module, what makes pointers to rows of activations of their addresses.
_ROWS = "rows"
_LOCK = threading.Lock()


class Kernel:
    """A function of a pointer to int64, compiled when it is first wanted; see :func:`dmp.compiled.launching.launch`."""

    def __init__(self, function: FunctionType) -> None:
        self._function = function
        self._compiled: Any = None
        self._for_halves: Kernel | None = None

    @property
    def address(self) -> int:
        """Where the compiled function begins."""
        if self._compiled is None:
            self._compiled = _compiled(self._function)
        address: int = self._compiled.address
        return address

    @property
    def has_rows(self) -> bool:
        """Whether there is a kernel for each type of rows."""
        return _ROWS in self._function.__code__.co_names

    def of(self, dtype: torch.dtype) -> Kernel:
        """Return the kernel for rows of float32 or bfloat16."""
        if dtype != torch.bfloat16:
            return self
        if self._for_halves is None:
            function = self._function
            name = f"{function.__name__}_halves"
            copy = FunctionType(function.__code__, {**function.__globals__, _ROWS: halves}, name)
            # Kept under another name than the one for float32, whose source it shares.
            copy.__qualname__, copy.__module__ = name, function.__module__
            self._for_halves = Kernel(copy)
        return self._for_halves


def kernel(function: Callable[..., None]) -> Kernel:
    """Make a kernel of ``function``."""
    assert isinstance(function, FunctionType)
    return Kernel(function)


def _compiled(function: FunctionType) -> Any:
    """Compile, or take what was compiled before from the user's cache or from the folder that NUMBA_CACHE_DIR names.

    Where that can neither be read nor written, the function is compiled in memory.
    """
    signature = types.void(types.CPointer(types.int64))
    # The setting holds for the whole process, and there may be two trainings in it.
    with _LOCK:
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = str(_FOLDER)
        try:
            return cfunc(signature, cache=True, **_OPTIONS)(function)
        except Exception:
            # Whatever is wrong with the folder or a file in it (nobody else writes there) must not keep anybody from training.
            with suppress(OSError):
                for path in _FOLDER.rglob(f"*.{function.__name__}-*"):
                    path.unlink()
            return cfunc(signature, **_OPTIONS)(function)
        finally:
            numba.config.CACHE_DIR = before


def _folder() -> Path:
    """Return where kernels of just these sources are kept: numba itself looks only at the file that a kernel stands in."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    base = Path(chosen) if chosen else platformdirs.user_cache_path("dmp-viewer")
    return base / "kernels" / f"{numba.__version__}-{digest.hexdigest()[:16]}"


_FOLDER = _folder()
