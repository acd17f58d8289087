"""Compiling a function into a kernel, once for each version of the program and each processor."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba import cfunc, types

_OPTIONS: dict[str, Any] = {"fastmath": {"contract", "nsz"}, "error_model": "numpy"}
_SIGNATURE = types.void(types.CPointer(types.int64))


def kernel(function: Callable[..., None]) -> Any:
    """Compile ``function``, which takes a pointer to int64; see :func:`dmp.compiled.launching.launch`.

    What was compiled is kept in the user's cache, or in the folder that NUMBA_CACHE_DIR names. Where it can neither be read nor
    written, the function is compiled in memory.
    """
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(_FOLDER)
    try:
        return cfunc(_SIGNATURE, cache=True, **_OPTIONS)(function)
    except Exception:
        # Whatever is wrong with the folder or a file in it (nobody else writes there) must not keep anybody from training.
        with suppress(OSError):
            for path in _FOLDER.rglob(f"*{function.__name__}*"):
                path.unlink()
        return cfunc(_SIGNATURE, **_OPTIONS)(function)
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
