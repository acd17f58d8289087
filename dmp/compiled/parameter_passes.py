"""Passes over all trained parameters at once: one launch for what would be an operation for each of fifty tensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dmp.compiled import parameter_kernels as kernels
from dmp.compiled.launching import launch

# Values that a thread takes at a time.
_PIECE = 1 << 14
_SIZE = 4  # bytes of a float32


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Which tensor each piece belongs to, its first value there in bytes, and its number of values; all (pieces,) int64."""

    tensors: NDArray[np.int64]
    offsets: NDArray[np.int64]
    counts: NDArray[np.int64]


def can_pass_over(tensors: Sequence[Tensor]) -> bool:
    """Return whether these tensors lie as the kernels need them: float32, without gaps, in the processor's memory."""
    return all(tensor.dtype == torch.float32 and tensor.is_contiguous() and tensor.is_cpu for tensor in tensors)


def are_finite(gradients: Sequence[Tensor]) -> bool:
    """Return whether every value of these tensors, of which :func:`can_pass_over` is true, is finite."""
    pieces = _pieces(tuple(gradient.numel() for gradient in gradients))
    table = np.zeros((len(pieces.counts), kernels.PIECE_WORDS), dtype=np.int64)
    table[:, 1] = _addresses(gradients)[pieces.tensors] + pieces.offsets
    table[:, 5] = pieces.counts
    flags = np.zeros(len(table), dtype=np.int32)
    launch(kernels.look, (table.ctypes.data, flags.ctypes.data), len(table))
    return not flags.any()


def adam_step(
    parameters: Sequence[Tensor],
    gradients: Sequence[Tensor],
    means: Sequence[Tensor],
    squares: Sequence[Tensor],
    counts: Sequence[Tensor],
    *,
    rate: float,
    decays: tuple[float, float],
    epsilon: float,
) -> None:
    """Do one step of Adam (Kingma & Ba 2015, algorithm 1), in place.

    Args:
        parameters: theta; of all :func:`can_pass_over` must be true, and all but the counts have one shape for each number.
        gradients: g.
        means: m.
        squares: v.
        counts: t, this step counted; () each.
        rate: alpha.
        decays: beta 1 and beta 2.
        epsilon: of the denominator.

    Raises:
        ValueError: when the sizes do not go together; addresses are all that a kernel sees.
    """
    table = piece_table(parameters, gradients, means, squares, counts)
    settings = np.array((rate, *decays, epsilon))
    launch(kernels.adam, (table.ctypes.data, settings.ctypes.data), len(table))


def piece_table(
    parameters: Sequence[Tensor],
    gradients: Sequence[Tensor],
    means: Sequence[Tensor],
    squares: Sequence[Tensor],
    counts: Sequence[Tensor],
) -> NDArray[np.int64]:
    """Return what the kernels of :func:`adam_step` need to know of each piece, (pieces, words)."""
    sizes = tuple(parameter.numel() for parameter in parameters)
    if any(tuple(tensor.numel() for tensor in tensors) != sizes for tensors in (gradients, means, squares)):
        raise ValueError("Each parameter needs a gradient and running means of its size.")
    if [count.numel() for count in counts] != [1] * len(sizes):
        raise ValueError("Each parameter needs one count of steps.")
    pieces = _pieces(sizes)
    table = np.empty((len(pieces.counts), kernels.PIECE_WORDS), dtype=np.int64)
    for column, tensors in enumerate((parameters, gradients, means, squares)):
        table[:, column] = _addresses(tensors)[pieces.tensors] + pieces.offsets
    table[:, 4] = _addresses(counts)[pieces.tensors]
    table[:, 5] = pieces.counts
    return table


def _addresses(tensors: Sequence[Tensor]) -> NDArray[np.int64]:
    return np.fromiter((tensor.data_ptr() for tensor in tensors), dtype=np.int64, count=len(tensors))


@lru_cache(maxsize=8)
def _pieces(sizes: tuple[int, ...]) -> _Pieces:
    each = [np.arange(0, size, _PIECE) for size in sizes]
    tensors = np.repeat(np.arange(len(sizes)), [len(firsts) for firsts in each])
    firsts: NDArray[Any] = np.concatenate([np.empty(0, dtype=np.int64), *each])
    counts = np.minimum(_PIECE, np.array(sizes, dtype=np.int64)[tensors] - firsts)
    return _Pieces(tensors, firsts * _SIZE, counts)
