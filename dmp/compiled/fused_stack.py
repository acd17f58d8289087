"""A series of graph convolutions in one launch forward and one backward, see :mod:`dmp.compiled.fused_kernels`."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from dmp.compiled import fused_kernels as kernels
from dmp.compiled import stack_passes
from dmp.compiled.blocked_matrix import LEAST_ROWS, BlockedMatrix, equal_blocks
from dmp.compiled.packed_weights import PLAIN, TRANSPOSED, Packing
from dmp.compiled.phase_table import Later, PhaseTable, Value
from dmp.compiled.stack_rows import ROWS

_SIZE = 4  # bytes of a float32
_LINE = 16  # float32 in a cache line, at which MKL wants its data to begin


class FusedStack:
    """Layers in float32, with memory of their own beside what they are given.

    Attributes:
        n_weights: values of all weights.
        n_channels: output channels of all layers together.
        widest: the most channels.
    """

    def __init__(
        self,
        packing: Packing,
        input_channels: int,
        mixed: Sequence[Tensor],
        gathered: Sequence[Tensor | None],
        scratch: Sequence[Tensor],
    ) -> None:
        """Make the memory.

        Args:
            packing: what multiplies.
            input_channels: of the features.
            mixed: place for the z of each layer, (V, out), with room for whole blocks of rows, as all.
            gathered: place for P x where a layer takes that first, (V, in), else None.
            scratch: three places for (V, C), C the most channels.
        """
        self._packing, self._n_vertices, self._scratch = packing, len(mixed[0]), scratch
        self._mixed, self._gathered = mixed, gathered
        self._sizes = list(pairwise((input_channels, *(z.shape[1] for z in mixed))))
        self.n_weights = sum(n_in * n_out for n_in, n_out in self._sizes)
        self.n_channels = sum(n_out for _, n_out in self._sizes)
        widest = max(max(sizes) for sizes in self._sizes)
        self.widest = widest
        self._features = torch.zeros((self._n_vertices + ROWS, input_channels))
        self._sums = torch.empty((2, (self._n_vertices // LEAST_ROWS + 1) * widest))
        self._joined = torch.empty((2, widest), dtype=torch.float64)
        # Mean, scale and 1 / deviation of each layer; slope and constant of the one that a gradient is in.
        self._normalised = [torch.empty((3, n_out)) for _, n_out in self._sizes]
        self._slopes = torch.empty((2, widest))
        # For each number of parts: blocks that a part has for itself, and gradients of the weights of all parts but the first.
        self._of_parts: dict[int, tuple[Tensor, Tensor]] = {}
        self._packed = [self._room_for(*sizes) for sizes in self._sizes]
        self._forget()

    def first(self, mixed: Sequence[Tensor], gathered: Sequence[Tensor | None]) -> FusedStack:
        """Return the same for fewer vertices, as many as these places have rows, in the same memory."""
        part = copy.copy(self)
        part._n_vertices, part._mixed, part._gathered = len(mixed[0]), mixed, gathered
        part._forget()
        return part

    @property
    def block_rows(self) -> int:
        """Rows of a block."""
        return equal_blocks(self._n_vertices)

    def forward(
        self,
        features: Tensor,
        matrix: BlockedMatrix,
        parameters: Sequence[Tensor],
        moments: Sequence[tuple[Tensor, Tensor]] | None,
    ) -> Tensor:
        """Return the output of the last layer, (V, out).

        Args:
            features: (V, in).
            matrix: P.
            parameters: weight (in, out), bias, gamma and beta of each layer, float32 and contiguous.
            moments: mean and 1 / deviation by which each layer is normalised; None for its own.

        Raises:
            ValueError: when anything has another size or type than the layers were made for; addresses are all that a kernel
                sees.
        """
        self.take(features)
        self._prepare_tables(matrix, parameters, moments is None)
        if moments is not None:
            for normalised, (mean, over_deviation), gamma in zip(self._normalised, moments, parameters[2::4], strict=True):
                normalised.copy_(torch.stack([mean, gamma.detach() * over_deviation, over_deviation]))
        # Fresh memory, because the buffers are written again in the next step.
        output = torch.empty((self._n_vertices, self._sizes[-1][1]))
        assert self._forward_table is not None
        self._forward_table.place(output=output.data_ptr())
        self._forward_table.run()
        return output.to(features.dtype)

    def backward(self, gradient: Tensor, *, of_features: bool) -> tuple[Tensor | None, list[Tensor]]:
        """Return the gradient of the features, where that is asked for, and those of the parameters, in their order.

        Args:
            gradient: that of the output, (V, out).
            of_features: whether that of the features is wanted.
        """
        gradient = gradient.float().contiguous()
        table = self._backward_tables.get(of_features)
        if table is None:
            table = self._backward_tables[of_features] = self.table()
            table.add(kernels.SUMS, **self.values(len(self._sizes)), of_before=Later("gradient"))
            self.add_backward(table, Later("gradient"), of_features=of_features)
        # Fresh memory, because it is kept as the parameters' gradients.
        of_weights, of_moments = torch.empty(self.n_weights), torch.empty(2 * self.n_channels)
        table.place(gradient=gradient.data_ptr(), of_weights=of_weights.data_ptr(), of_moments=of_moments.data_ptr())
        table.run()
        first = self._of_before(0)[: self._n_vertices * self._sizes[0][0]].view(self._n_vertices, -1)
        return first.clone() if of_features else None, self.gradients(of_weights, of_moments)

    def gradients(self, of_weights: Tensor, of_moments: Tensor) -> list[Tensor]:
        """Return the gradients of the parameters, in their order.

        Args:
            of_weights: where the table of a backward pass has them, (n_weights,).
            of_moments: those of all gamma, and then of all beta, (2 n_channels,).
        """
        outs = [n_out for _, n_out in self._sizes]
        # All that a bias adds is taken off again.
        of_bias = torch.zeros(self.n_channels)
        weights = torch.split(of_weights, [n_in * n_out for n_in, n_out in self._sizes])
        others = (torch.split(part, outs) for part in (of_bias, of_moments[: self.n_channels], of_moments[self.n_channels :]))
        found: list[Tensor] = []
        for sizes, weight, bias, gamma, beta in zip(self._sizes, weights, *others, strict=True):
            found += [weight.view(sizes), bias, gamma, beta]
        return found

    # -- tables ---------------------------------------------------------------------------------------------------

    def _forget(self) -> None:
        self._key: object = None
        self._matrix: BlockedMatrix | None = None
        self._forward_table: PhaseTable | None = None
        self._backward_tables: dict[bool, PhaseTable] = {}

    def _prepare_tables(self, matrix: BlockedMatrix, parameters: Sequence[Tensor], own_moments: bool) -> None:
        """Write the tables anew where anything that stands in them has changed."""
        key = torch.get_num_threads(), own_moments, *(parameter.data_ptr() for parameter in parameters)
        if self._matrix is matrix and self._key == key:
            return
        self.prepare(matrix, parameters)
        self._key = key
        self._forward_table = self.table()
        self.add_forward(self._forward_table, own_moments=own_moments)
        # What makes the y before a layer makes that after the last one.
        self._forward_table.add(kernels.ACTIVATE, **self.values(len(self._sizes)), output=Later("output"))

    def prepare(self, matrix: BlockedMatrix, parameters: Sequence[Tensor]) -> None:
        """Make ready for tables of P and these parameters, see :meth:`forward`, and as many threads as torch uses now.

        Raises:
            ValueError: when they have another size or type than the layers were made for.
        """
        if matrix.n_rows != self._n_vertices:
            raise ValueError(f"The layers were made for {self._n_vertices} vertices, and the matrix has {matrix.n_rows} rows.")
        if matrix.rows != self.block_rows:
            raise ValueError(f"The layers have blocks of {self.block_rows} rows, and the matrix has blocks of {matrix.rows}.")
        if any(parameter.dtype != torch.float32 or not parameter.is_contiguous() for parameter in parameters):
            raise ValueError("The parameters must be float32 and contiguous.")
        self._forget()
        self._matrix, self._parameters = matrix, parameters
        is_worth_sharing = self._n_vertices * self.widest >= stack_passes.WORTH_SHARING
        self._sweep = matrix.sweep(torch.get_num_threads() if is_worth_sharing else 1)
        parts = self._sweep.n_parts
        if parts not in self._of_parts:
            self._of_parts[parts] = torch.zeros((parts, 2, ROWS, self.widest)), torch.zeros((parts - 1, self.n_weights))
        self._own, self._others = self._of_parts[parts]
        self._block_starts = (np.arange(parts + 1) * matrix.n_blocks // parts).astype(np.int32)
        self._to_pack = {order: self._weights_to_pack(order) for order in (PLAIN, TRANSPOSED)}

    def take(self, features: Tensor) -> None:
        """Take the features, (V, in), of which a table begins.

        Raises:
            ValueError: when they have another size than the layers were made for.
        """
        if features.shape != (self._n_vertices, self._sizes[0][0]):
            raise ValueError(f"The layers were made for {self._n_vertices} vertices with {self._sizes[0][0]} features.")
        self._features[: self._n_vertices] = features

    def table(self) -> PhaseTable:
        """Return an empty table."""
        table = PhaseTable(self._sweep.n_parts)
        table.keep(self._matrix, self._parameters, self._sweep, self._own, self._others, self._block_starts, self._to_pack)
        return table

    def add_forward(self, table: PhaseTable, *, own_moments: bool) -> None:
        """Add the phases that make z of the last layer and its moments, from the features."""
        matrix = self._matrix
        assert matrix is not None
        self._add_packing(table, PLAIN)
        for layer in range(len(self._sizes)):
            way = kernels.FORWARD_MULTIPLYING if self._gathered[layer] is None else kernels.FORWARD_GATHERING
            values = {**self.values(layer), "way": way}
            if not own_moments:
                values["first_sums"] = 0
            if layer == 0 and way == kernels.FORWARD_GATHERING:
                # The features are all there, so there is nothing to begin with.
                values |= {"places": self._features.data_ptr(), "columns": matrix.addresses[1]}
                self._add_finish(table, values, self._block_starts, matrix.all_blocks)
            else:
                self._add_sweep(table, values)
            if own_moments:
                table.add(kernels.JOIN_MOMENTS, **values)

    def add_backward(self, table: PhaseTable, of_y: Value, *, of_features: bool = False) -> None:
        """Add the phases that make the gradients, written later to ``of_weights`` and ``of_moments``.

        Args:
            table: whose phases so far make the sums for the last layer.
            of_y: where the gradient of the last y is.
            of_features: whether the gradient of the features is wanted.
        """
        self._add_packing(table, TRANSPOSED)
        last = len(self._sizes)
        self._add_join_sums(table, last - 1)
        weights_before = self.n_weights
        for layer in reversed(range(last)):
            n_in, n_out = self._sizes[layer]
            weights_before -= n_in * n_out
            of_before = self._of_before(layer).data_ptr() if layer or of_features else 0
            values = {
                **self.values(layer),
                "way": kernels.BACKWARD_MULTIPLYING if self._gathered[layer] is None else kernels.BACKWARD_GATHERING,
                "of_y": of_y,
                "of_before": of_before,
                "of_weight": Later("of_weights", _SIZE * weights_before),
                "of_weight_others": self._others.data_ptr() + _SIZE * weights_before,
                "others_bytes": _SIZE * self.n_weights,
            }
            self._add_sweep(table, values)
            if layer:
                self._add_join_sums(table, layer - 1)
            of_y = of_before
        if table.parts > 1:
            others = {"of_weight_others": self._others.data_ptr(), "others_bytes": _SIZE * self.n_weights}
            table.add(kernels.ADD_UP, of_weight=Later("of_weights"), **others)

    def _add_packing(self, table: PhaseTable, order: int) -> None:
        weights = self._to_pack[order]
        values: dict[str, Value] = {"weights": weights.ctypes.data, "n_weights": len(weights), "block_rows": self.block_rows}
        table.add(kernels.PACK, pack=self._packing.pack_at, **values)

    def _add_sweep(self, table: PhaseTable, values: dict[str, Value]) -> None:
        sweep = self._sweep
        plan = {"bounds": sweep.bounds, "queue_starts": sweep.queue_starts, "queue": sweep.queue, "highest": sweep.highest}
        table.add(kernels.SWEEP, **values, **{name: part.ctypes.data for name, part in plan.items()})
        if len(sweep.others):
            self._add_finish(table, values, sweep.other_starts, sweep.others)

    def _add_finish(self, table: PhaseTable, values: dict[str, Value], starts: np.ndarray, blocks: np.ndarray) -> None:
        table.add(kernels.FINISH, **values, queue_starts=starts.ctypes.data, queue=blocks.ctypes.data)

    def _add_join_sums(self, table: PhaseTable, layer: int) -> None:
        before = sum(n_out for _, n_out in self._sizes[:layer])
        of_gamma, of_beta = Later("of_moments", _SIZE * before), Later("of_moments", _SIZE * (self.n_channels + before))
        table.add(kernels.JOIN_SUMS, **self.values(layer), of_gamma=of_gamma, of_beta=of_beta)

    def values(self, layer: int) -> dict[str, Value]:
        """Return what belongs to a layer in all phases; for the number after the last: to the layer that would follow."""
        assert self._matrix is not None
        starts, _, values = self._matrix.addresses
        sums, joined, slopes = self._sums, self._joined, self._slopes
        found: dict[str, Value] = {
            **{"starts": starts, "columns": self._sweep.columns.ctypes.data, "values": values},
            **{"n_rows": self._n_vertices, "block_rows": self.block_rows},
            **{"places": self._scratch[1].data_ptr(), "slots": self._sweep.slots.ctypes.data},
            **{"own": self._own.data_ptr(), "own_bytes": _SIZE * self._own.stride(1), "multiply": self._packing.multiply_at},
            **{"first_sums": sums[0].data_ptr(), "second_sums": sums[1].data_ptr(), "joined": joined.data_ptr()},
            **{"slope": slopes[0].data_ptr(), "constant": slopes[1].data_ptr(), "features": self._features.data_ptr()},
        }
        if layer:
            mean, scale, _, _, beta = self._normalisation(layer - 1)
            found |= {"z_before": self._mixed[layer - 1].data_ptr(), "n_in": self._sizes[layer - 1][1]}
            found |= {"mean_before": mean, "scale_before": scale, "beta_before": beta}
        if layer < len(self._sizes):
            mean, scale, over_deviation, gamma, beta = self._normalisation(layer)
            n_in, n_out = self._sizes[layer]
            gathered = self._gathered[layer]
            found |= {"z": self._mixed[layer].data_ptr(), "n_in": n_in, "n_out": n_out, "packed": _aligned(self._packed[layer])}
            found |= {"mean": mean, "scale": scale, "over_deviation": over_deviation, "gamma": gamma, "beta": beta}
            found["gathered"] = 0 if gathered is None else gathered.data_ptr()
        return found

    def _normalisation(self, layer: int) -> tuple[int, int, int, int, int]:
        """Return the addresses of a layer's mean, scale, 1 / deviation, gamma and beta."""
        mean, scale, over_deviation = self._normalised[layer]
        gamma, beta = self._parameters[4 * layer + 2], self._parameters[4 * layer + 3]
        return mean.data_ptr(), scale.data_ptr(), over_deviation.data_ptr(), gamma.data_ptr(), beta.data_ptr()

    def place_of_last(self) -> int:
        """Return the address where a gradient of the last y can be put, (V, out), for :meth:`add_backward`."""
        return self._of_before(len(self._sizes)).data_ptr()

    def _of_before(self, layer: int) -> Tensor:
        """Return the place for the gradient of what goes into a layer: by turns, as that of its y is still wanted."""
        return self._scratch[0 if layer % 2 else 2]

    def _room_for(self, n_in: int, n_out: int) -> Tensor:
        sizes = (n_in, n_out, ROWS), (n_out, n_in, ROWS)
        return torch.empty(max(self._packing.bytes_for(*size) for size in sizes) // _SIZE + 2 * _LINE)

    def _weights_to_pack(self, order: int) -> np.ndarray:
        """Return what packing has to know of the weights, (layers, words) int64."""
        weights = np.empty((len(self._sizes), kernels.WEIGHT_WORDS), dtype=np.int64)
        for layer, (n_in, n_out) in enumerate(self._sizes):
            sizes = (n_in, n_out) if order == PLAIN else (n_out, n_in)
            weights[layer] = (self._parameters[4 * layer].data_ptr(), _aligned(self._packed[layer]), *sizes, order)
        return weights


def _aligned(memory: Tensor) -> int:
    line = _SIZE * _LINE
    return -(-memory.data_ptr() // line) * line
