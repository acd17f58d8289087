"""Weights in the order in which MKL reads them, so that products of a few rows are as fast as those of all.

torch brings Intel's MKL along and makes its functions visible. With them a kernel can multiply rows that it has just made,
while they are in the cache. Where there is no MKL (other processors), products are left to torch.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

# How MKL is told of the order of numbers: row by row; a factor as it is, transposed, packed; and that it is the right factor.
BY_ROWS, PLAIN, TRANSPOSED, PACKED, RIGHT_FACTOR = 101, 111, 112, 151, 162


@dataclass(frozen=True)
class Packing:
    """MKL's functions.

    Attributes:
        room: bytes that packed weights take, for which of the factors, rows, columns and inner length.
        pack_at: address of ``cblas_sgemm_pack``.
        multiply_at: address of ``cblas_sgemm_compute``.
    """

    room: Callable[[int, int, int, int], int]
    pack_at: int
    multiply_at: int

    def bytes_for(self, n_in: int, n_out: int, rows: int) -> int:
        """Return the bytes of packed weights (in, out) by which always so many ``rows`` are multiplied."""
        return self.room(RIGHT_FACTOR, rows, n_out, n_in)


def packing_for(dtype: torch.dtype) -> Packing | None:
    """Return MKL's functions for numbers of this type, or None where there are none."""
    return _packing if dtype == torch.float32 else None


def _find() -> Packing | None:
    for path in (Path(torch.__file__).parent / "lib").glob("*torch_cpu*"):
        try:
            library = ctypes.CDLL(str(path))
            room, pack, multiply = (getattr(library, f"cblas_sgemm_{name}") for name in ("pack_get_size", "pack", "compute"))
        except (OSError, AttributeError):
            continue
        room.argtypes, room.restype = (ctypes.c_int,) * 4, ctypes.c_size_t
        pack_at, multiply_at = (ctypes.cast(function, ctypes.c_void_p).value for function in (pack, multiply))
        if pack_at is not None and multiply_at is not None:
            return Packing(room, pack_at, multiply_at)
    return None


_packing = _find()
