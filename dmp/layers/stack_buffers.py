"""Memory for the layers of one network on one mesh."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import torch
from torch import Tensor

from dmp.compiled.blocked_matrix import BlockedMatrix
from dmp.compiled.fused_stack import FusedStack
from dmp.compiled.packed_weights import packing_for
from dmp.compiled.stack_passes import StackPasses
from dmp.compiled.stack_rows import ROWS
from dmp.layers.stack_sizes import gathers_first, outputs_wanted_again


class StackBuffers:
    """Memory for the layers of one network on one mesh, the same in each step.

    Attributes:
        dtype: in which activations are kept: float32 or bfloat16.
        keep_outputs: whether outputs of layers that are needed again are kept beside what they are computed from. Without, a
            step takes longer and a training less memory. Never where all layers are one launch, which has no use for them.
        generation: number of forward passes that have used the buffers.
        mixed: what each layer normalises, z, (V, out).
        gathered: P x for the layers that begin with it, (V, in), else None.
        fused: all layers in one launch, where that can be done: in float32, with a product for it.
    """

    def __init__(
        self,
        n_vertices: int,
        input_channels: int,
        widths: Sequence[int],
        *,
        dtype: torch.dtype = torch.float32,
        keep_outputs: bool = True,
    ) -> None:
        """Make the buffers.

        Args:
            n_vertices: V.
            input_channels: channels of the features.
            widths: output channels of the layers.
            dtype: see above.
            keep_outputs: see above.
        """
        self.generation = 0
        self.dtype = dtype
        packing = packing_for(dtype)
        self.keep_outputs = keep_outputs = keep_outputs and packing is None
        self._n_vertices = n_vertices
        self._matrix: tuple[Tensor, BlockedMatrix] | None = None

        # Room for whole blocks, so that a product of a block's rows needs no care for the last one.
        room = n_vertices + ROWS if packing else n_vertices

        def rows(channels: int) -> Tensor:
            return torch.zeros((room, channels), dtype=dtype)[:n_vertices]

        first = gathers_first(input_channels, widths)
        self.mixed = [rows(width) for width in widths]
        self.gathered = [rows(i) if f else None for i, f in zip((input_channels, *widths[:-1]), first, strict=True)]
        self._widest = max(input_channels, *widths)
        # Only what is used of it takes memory.
        self._scratch = [torch.zeros(room * self._widest, dtype=dtype) for _ in range(3 if keep_outputs or packing else 4)]
        again = outputs_wanted_again(input_channels, widths)
        self._outputs = [rows(width) if a and keep_outputs else None for width, a in zip(widths, again, strict=True)]
        self.fused = FusedStack(packing, input_channels, self.mixed, self.gathered, self._scratch) if packing else None
        self._passes = None if self.fused else StackPasses(n_vertices, self._widest)

    def first(self, n_vertices: int) -> StackBuffers:
        """Return buffers for fewer vertices in the same memory; of these and those only one can be in use at a time."""
        part = copy.copy(self)
        part._n_vertices = n_vertices
        part._matrix = None
        part.mixed = [rows[:n_vertices] for rows in self.mixed]
        part.gathered = [None if rows is None else rows[:n_vertices] for rows in self.gathered]
        part._outputs = [None if rows is None else rows[:n_vertices] for rows in self._outputs]
        part.fused = self.fused.first(part.mixed, part.gathered) if self.fused else None
        part._passes = None if part.fused else StackPasses(n_vertices, self._widest)
        return part

    def blocked(self, propagation: Tensor) -> BlockedMatrix:
        """Return ``propagation`` (V, V) as the passes need it, made once for each matrix."""
        if self._matrix is None or self._matrix[0] is not propagation:
            rows = self.fused.block_rows if self.fused else ROWS
            self._matrix = propagation, BlockedMatrix(propagation, rows)
        return self._matrix[1]

    @property
    def passes(self) -> StackPasses:
        """What is done with the layers one by one, where they are not one launch."""
        assert self._passes is not None
        return self._passes

    def scratch(self, number: int, channels: int) -> Tensor:
        """Return a working place (V, channels): number 0 to 2, or 3 for :meth:`output`.

        Its content lasts until the next that asks for it.
        """
        return self._scratch[number][: self._n_vertices * channels].view(self._n_vertices, channels)

    def output(self, layer: int) -> Tensor:
        """Return the place for the output of a layer that is needed again; without ``keep_outputs`` all layers share it."""
        kept = self._outputs[layer]
        return self.scratch(3, self.mixed[layer].shape[1]) if kept is None else kept
