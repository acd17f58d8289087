"""A whole training step of graph convolutions and two linear layers in one launch: forward, losses, backward, Adam.

Python and torch's operations around the layers take 4 of the 90 milliseconds of a step of the published network on 5,000
vertices with two threads, most of it on one of them, because what they need has left the caches meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dmp.adam import Adam
from dmp.compiled import fused_kernels as kernels
from dmp.compiled.blocked_matrix import BlockedMatrix
from dmp.compiled.fused_stack import FusedStack
from dmp.compiled.parameter_rows import PIECE_WORDS
from dmp.compiled.phase_table import PhaseTable, Value
from dmp.compiled.phases import FIRST_ARGUMENT
from dmp.compiled_losses import CompiledLosses

_SIZE = 4  # bytes of a float32
_PIECE = 1 << 14  # values of parameters that are changed at once


@dataclass(frozen=True, eq=False)
class Trained:
    """What is trained, all parameters float32 and contiguous.

    Attributes:
        stack: memory of the graph convolutions.
        matrix: P.
        features: (V, in).
        layers: weight, bias, gamma and beta of each graph convolution and its normalisation.
        ends: weight and bias of both linear layers, LeakyReLU between them.
        base: what is added to the output, (V, 3) float32; None for nothing.
    """

    stack: FusedStack
    matrix: BlockedMatrix
    features: Tensor
    layers: Sequence[Tensor]
    ends: Sequence[Tensor]
    base: Tensor | None


class WholeStep:
    """One step after the other, in memory of its own.

    Attributes:
        output: prediction of the last step, (V, 3); written anew by the next one.
        is_finite: whether the gradients of the last step were finite; if they or the loss were not, it changed no parameter.
    """

    def __init__(self, trained: Trained, losses: CompiledLosses, optimiser: Adam) -> None:
        """Make ready.

        Args:
            trained: the network, its mesh and its input; what lies there must stay in its place.
            losses: what is made smaller.
            optimiser: whose parameters are those of ``trained``, and whose running means must stay in their places.
        """
        n_vertices, n_out = len(trained.features), len(trained.ends[-1])
        self._trained, self._losses, self._optimiser = trained, losses, optimiser
        self._hidden = torch.empty((n_vertices, len(trained.ends[1])))
        self.output, self._of_output = torch.empty((n_vertices, n_out)), torch.empty((n_vertices, n_out))
        self._found = torch.empty(3)
        self.is_finite = True
        stack = trained.stack
        stack.take(trained.features)
        self._n_ends = sum(part.numel() for part in trained.ends)
        # Of the weights, of the linear layers, of all gamma, of all beta.
        self._gradients = torch.zeros(stack.n_weights + self._n_ends + 2 * stack.n_channels)
        self._settings = np.array((0.0, *optimiser.decays, optimiser.epsilon))
        self._threads = 0
        self._table: PhaseTable | None = None

    def __call__(self) -> Tensor:
        """Do one step and return total, data and Laplacian loss, (3,)."""
        if self._table is None or self._threads != torch.get_num_threads():
            self._table = self._make_table()
        self._settings[0] = self._optimiser.param_groups[0]["lr"]
        self._optimiser.count(1)
        self._table.run()
        self.is_finite = not self._flags.any()
        if not (self.is_finite and np.isfinite(self._found[0].item())):
            self._optimiser.count(-1)
        return self._found.clone()

    def gradients(self) -> dict[Tensor, Tensor]:
        """Return the gradient of each parameter in the last step; written anew by the next one."""
        return dict(zip(self._parameters, self._views(), strict=True))

    @property
    def _parameters(self) -> list[Tensor]:
        return [*self._trained.layers, *self._trained.ends]

    def _views(self) -> list[Tensor]:
        """Return the places of the gradients, in the order of the parameters."""
        stack, ends = self._trained.stack, self._trained.ends
        split = stack.n_weights, stack.n_weights + self._n_ends
        of_weights, of_ends, of_moments = torch.tensor_split(self._gradients, split)
        parts = torch.split(of_ends, [part.numel() for part in ends])
        return [
            *stack.gradients(of_weights, of_moments),
            *(part.view_as(parameter) for part, parameter in zip(parts, ends, strict=True)),
        ]

    def _make_table(self) -> PhaseTable:
        trained, stack = self._trained, self._trained.stack
        self._threads = torch.get_num_threads()
        stack.prepare(trained.matrix, trained.layers)
        table = stack.table()
        stack.add_forward(table, own_moments=True)
        ends = self._values_of_ends(table)
        table.add(kernels.ENDS, **ends)
        arguments = self._losses.arguments(self.output, self._of_output, self._found)
        losses = np.array([0] * FIRST_ARGUMENT + list(arguments), dtype=np.int64)
        table.keep(losses)
        for way in range(2):
            table.add(kernels.LOSSES, way=way, losses=losses.ctypes.data)
        table.add(kernels.OF_ENDS, **ends)
        stack.add_backward(table, ends["of_before"])
        if table.parts > 1:
            table.add(kernels.ADD_UP, **ends)
        self._add_update(table)
        table.place(of_weights=self._gradients.data_ptr(), of_moments=self._gradients[-2 * stack.n_channels :].data_ptr())
        return table

    def _values_of_ends(self, table: PhaseTable) -> dict[str, Value]:
        """Return what belongs to the linear layers."""
        trained, stack = self._trained, self._trained.stack
        hidden_weight, hidden_bias, last_weight, last_bias = (part.data_ptr() for part in trained.ends)
        others = torch.zeros((table.parts - 1, self._n_ends))
        table.keep(others)
        found: dict[str, Value] = {
            **stack.values(len(trained.layers) // 4),
            **{"hidden": self._hidden.data_ptr(), "n_hidden": self._hidden.shape[1], "n_last": self.output.shape[1]},
            **{"hidden_weight": hidden_weight, "hidden_bias": hidden_bias, "last_weight": last_weight, "last_bias": last_bias},
            **{"output": self.output.data_ptr(), "of_output": self._of_output.data_ptr(), "n_gradients": self._n_ends},
            **{"of_before": stack.place_of_last(), "of_weight": self._gradients[stack.n_weights :].data_ptr()},
            **{"of_weight_others": others.data_ptr(), "others_bytes": _SIZE * self._n_ends},
            "base": 0 if trained.base is None else trained.base.data_ptr(),
        }
        return found

    def _add_update(self, table: PhaseTable) -> None:
        """Add the phases that look for numbers that are not finite, and change the parameters."""
        self._flags = np.zeros(table.parts, dtype=np.int32)
        parameters, gradients = self._parameters, self._views()
        moments = self._optimiser.moments_of(parameters)
        pieces = _pieces(parameters, gradients, moments)
        # Pieces are small beside what a part has of them.
        ends = np.cumsum(pieces[:, -1])
        shares = ends[-1] * np.arange(1, table.parts) // table.parts
        starts = np.array([0, *np.searchsorted(ends, shares), len(pieces)], dtype=np.int32)
        table.keep(pieces, starts, moments, parameters, gradients)
        found = {"gradients": self._gradients.data_ptr(), "n_gradients": len(self._gradients), "flags": self._flags.ctypes.data}
        table.add(kernels.LOOK, **found)
        found |= {"pieces": pieces.ctypes.data, "queue_starts": starts.ctypes.data, "settings": self._settings.ctypes.data}
        table.add(kernels.ADAM, **found, loss=self._found.data_ptr())


def _pieces(parameters: Sequence[Tensor], gradients: Sequence[Tensor], moments: Sequence[dict[str, Tensor]]) -> np.ndarray:
    """Return what :func:`dmp.compiled.parameter_rows.adam_piece` needs to know of each piece, (pieces, words) int64."""
    rows: list[tuple[int, ...]] = []
    for parameter, gradient, kept in zip(parameters, gradients, moments, strict=True):
        places = [tensor.data_ptr() for tensor in (parameter, gradient, kept["exp_avg"], kept["exp_avg_sq"])]
        for first in range(0, parameter.numel(), _PIECE):
            here = (place + _SIZE * first for place in places)
            rows.append((*here, kept["step"].data_ptr(), min(_PIECE, parameter.numel() - first)))
    return np.array(rows, dtype=np.int64).reshape(-1, PIECE_WORDS)
