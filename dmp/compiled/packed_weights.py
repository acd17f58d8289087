"""Weights in the order in which MKL reads them, so that products of a few rows are as fast as those of all.

torch brings Intel's MKL along and makes its functions visible. With them a kernel can multiply rows that it has just made,
while they are in the cache. Where there is no MKL (other processors), products are left to torch.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

_ROW_MAJOR, _PLAIN, _TRANSPOSED, _RIGHT_FACTOR = 101, 111, 112, 162


def _find() -> tuple[Callable[..., Any], Callable[..., Any], int] | None:
    """Return MKL's functions for the room of packed weights and for packing, and the address of the one that multiplies."""
    for path in (Path(torch.__file__).parent / "lib").glob("*torch_cpu*"):
        try:
            library = ctypes.CDLL(str(path))
            room, pack, multiply = (getattr(library, f"cblas_sgemm_{name}") for name in ("pack_get_size", "pack", "compute"))
        except (OSError, AttributeError):
            continue
        number, address = ctypes.c_int, ctypes.c_void_p
        room.argtypes, room.restype = (number,) * 4, ctypes.c_size_t
        pack.argtypes, pack.restype = (*(number,) * 6, ctypes.c_float, address, number, address), None
        where = ctypes.cast(multiply, ctypes.c_void_p).value
        if where is not None:
            return room, pack, where
    return None


_functions = _find()


def can_pack() -> bool:
    """Return whether there is an MKL to pack weights for."""
    return _functions is not None


class PackedWeights:
    """Room for the packed form of one layer's weights."""

    def __init__(self, n_in: int, n_out: int, rows: int) -> None:
        """Make room for weights (in, out) by which always so many ``rows`` are multiplied."""
        assert _functions is not None
        room, self._pack, self.multiply_at = _functions
        self._sizes = rows, n_out, n_in
        # Rounded up to whole cache lines, which MKL wants its data to begin at.
        self._memory = torch.empty(room(_RIGHT_FACTOR, rows, n_out, n_in) // 4 + 32, dtype=torch.float32)
        self.address = -(-self._memory.data_ptr() // 64) * 64

    def pack(self, weights: Tensor, *, transposed: bool = False) -> None:
        """Pack ``weights`` (in, out), or with ``transposed`` (out, in), float32 and contiguous."""
        order = _TRANSPOSED if transposed else _PLAIN
        place = weights.data_ptr(), weights.shape[1]
        self._pack(_ROW_MAJOR, _RIGHT_FACTOR, order, *self._sizes, 1.0, *place, self.address)
