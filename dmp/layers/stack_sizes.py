"""What the layers of a plain series of graph convolutions keep in memory."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise


def gathers_first(input_channels: int, widths: Sequence[int]) -> list[bool]:
    """Return for each layer whether it takes P x before the product with the weights: on the narrower side."""
    return [i < o for i, o in pairwise((input_channels, *widths))]


def outputs_wanted_again(input_channels: int, widths: Sequence[int]) -> list[bool]:
    """Return for each layer whether the backward pass needs its output: what the next layer multiplies, not what it gathers."""
    return [*(not first for first in gathers_first(input_channels, widths)[1:]), False]


def bytes_per_vertex(
    input_channels: int, widths: Sequence[int], *, value_bytes: int = 4, keep_outputs: bool = True, fused: bool = False
) -> int:
    """Return what :class:`dmp.layers.stack_buffers.StackBuffers` takes for each vertex, beside sums of blocks and room for one.

    Args:
        input_channels: channels of the features.
        widths: output channels of the layers.
        value_bytes: of a number.
        keep_outputs: see there.
        fused: whether all layers are gone through in one launch, which keeps no outputs but a copy of the features.
    """
    sizes = (input_channels, *widths)
    values = sum(widths) + sum(i for i, first in zip(sizes, gathers_first(input_channels, widths), strict=False) if first)
    if fused:
        return value_bytes * (values + 3 * max(sizes) + input_channels)
    values += max(sizes) * (3 if keep_outputs else 4)
    if keep_outputs:
        wanted = outputs_wanted_again(input_channels, widths)
        values += sum(width for width, again in zip(widths, wanted, strict=True) if again)
    return value_bytes * values


def bytes_of_weights(input_channels: int, widths: Sequence[int]) -> int:
    """Return what each thread needs for its part of the gradient of all weights."""
    return 4 * sum(i * o for i, o in pairwise((input_channels, *widths)))


def bytes_of_whole_pass(widths: Sequence[int], *, value_bytes: int = 4) -> int:
    """Return what a :class:`dmp.patches.whole_pass.WholePass` takes for each vertex of a large mesh."""
    return 2 * max(widths) * value_bytes
