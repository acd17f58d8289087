"""What a step could cost at best: its matrix products alone, and its memory traffic alone, as this machine does them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import torch

# Much larger than the caches of a desktop computer, so that memory itself is measured.
_COPIED_VALUES = 1 << 25


def matrix_products(
    n_vertices: int, sizes: Sequence[int], dtype: torch.dtype = torch.float32, device: torch.device | None = None
) -> Callable[[], None]:
    """Return what runs the dense products of one step: forward X W, backward G W^T and X^T G of each layer.

    Args:
        n_vertices: V, rows of X (V, in) and G (V, out).
        sizes: channels of the features and of the output of each layer.
        dtype: of all factors.
        device: where they lie; the processor's memory by default.
    """
    widest = max(sizes)
    inputs = torch.randn(n_vertices * widest).to(device, dtype)
    gradients = torch.randn(n_vertices * widest).to(device, dtype)
    results = torch.empty_like(inputs)
    weights = [torch.randn(i, o).to(device, dtype) for i, o in pairwise(sizes)]
    places = [torch.empty_like(weight) for weight in weights]

    def run() -> None:
        for weight, place in zip(weights, places, strict=True):
            n_in, n_out = weight.shape
            features = inputs[: n_vertices * n_in].view(n_vertices, n_in)
            gradient = gradients[: n_vertices * n_out].view(n_vertices, n_out)
            torch.mm(features, weight, out=results[: n_vertices * n_out].view(n_vertices, n_out))
            torch.mm(gradient, weight.T, out=results[: n_vertices * n_in].view(n_vertices, n_in))
            torch.mm(features.T, gradient, out=place)

    return run


def least_traffic(n_vertices: int, sizes: Sequence[int], value_bytes: int = 4) -> int:
    """Return the bytes that the layers of one step must move at least, however much is done at once on what is in the cache.

    Batch normalisation needs all of z before any of its output. So forward a layer reads x, writes z, reads z, writes y;
    backward it reads gradient and z, then both again, reads x, and writes the gradient of x. Weights are not counted.
    """
    values = sum(3 * n_in + 7 * n_out for n_in, n_out in pairwise(sizes))
    return n_vertices * values * value_bytes


def copying(device: torch.device | None = None) -> tuple[Callable[[], object], int]:
    """Return what copies a large array, in the processor's memory by default, and the bytes that this moves."""
    source, target = (torch.zeros(_COPIED_VALUES, device=device) for _ in range(2))
    return lambda: target.copy_(source), 2 * 4 * _COPIED_VALUES
