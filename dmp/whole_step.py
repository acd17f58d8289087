"""A whole training step of graph convolutions and two linear layers in one launch: forward, losses, backward, Adam.

Done one by one, Python and torch's operations around the layers took 4 of the 88 milliseconds of a step of the published
network on 5,000 vertices with two threads, most of it on one of them, because what they need has left the caches meanwhile.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dmp.adam import Adam
from dmp.compiled import fused_kernels as kernels
from dmp.compiled.fused_stack import FusedStack
from dmp.compiled.parameter_rows import PIECE_WORDS
from dmp.compiled.phase_table import PhaseTable, Value
from dmp.compiled.phases import FIRST_ARGUMENT
from dmp.compiled.team import Team
from dmp.compiled_losses import CompiledLosses
from dmp.layers.stack_buffers import StackBuffers

_SIZE = 4  # bytes of a float32
_PIECE = 1 << 14  # values of parameters that are changed at once


@dataclass(frozen=True, eq=False)
class Trained:
    """What is trained, all parameters float32 and contiguous.

    Attributes:
        buffers: memory of the graph convolutions, which are one launch there.
        propagation: P, (V, V) CSR.
        features: (V, in).
        layers: weight, bias, gamma and beta of each graph convolution and its normalisation.
        ends: weight and bias of both linear layers, LeakyReLU between them.
        base: what is added to the output, (V, 3) float32; None for nothing.
    """

    buffers: StackBuffers
    propagation: Tensor
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
            optimiser: of these parameters and no others; its running means must stay in their places.

        Raises:
            ValueError: when sizes or types do not go together; addresses are all that a kernel sees.
        """
        stack = trained.buffers.fused
        if stack is None:
            raise ValueError("These layers are not one launch.")
        self._trained, self._stack, self._losses, self._optimiser = trained, stack, losses, optimiser
        self._parameters = [*trained.layers, *trained.ends]
        self._check(stack)
        n_vertices, n_hidden, n_last = len(trained.features), len(trained.ends[1]), len(trained.ends[3])
        self._hidden = torch.empty((n_vertices, n_hidden))
        self.output, self._of_output = torch.empty((n_vertices, n_last)), torch.empty((n_vertices, n_last))
        self._found = torch.empty(3)
        self.is_finite = True
        self._n_ends = sum(part.numel() for part in trained.ends)
        # Of the weights, of the linear layers, of all gamma, of all beta.
        self._gradients = torch.zeros(stack.n_weights + self._n_ends + 2 * stack.n_channels)
        self._of_parameters = self._split_gradients()
        self._settings = np.array((0.0, *optimiser.decays, optimiser.epsilon))
        self._threads = 0
        self._table: PhaseTable | None = None

    def _check(self, stack: FusedStack) -> None:
        trained = self._trained
        (n_hidden, n_in), last_bias = trained.ends[0].shape, trained.ends[3]
        sizes = [(n_hidden, n_in), (n_hidden,), (len(last_bias), n_hidden), (len(last_bias),)]
        if n_hidden > stack.widest or n_in != len(trained.layers[-1]) or [part.shape for part in trained.ends] != sizes:
            raise ValueError("The linear layers do not go together, or the first has more channels than any layer before.")
        base = [] if trained.base is None else [trained.base]
        if any(part.shape != (len(trained.features), len(last_bias)) for part in base):
            raise ValueError("What is added to the output must have its size.")
        if any(part.dtype != torch.float32 or not part.is_contiguous() for part in (*self._parameters, *base)):
            raise ValueError("Parameters and what is added to the output must be float32 and contiguous.")
        if len(self._parameters) != len(self._optimiser.param_groups[0]["params"]):
            raise ValueError("The optimiser has other parameters than the network.")

    def __call__(self) -> Tensor:
        """Do one step and return total, data and Laplacian loss, (3,)."""
        if self._table is None or self._threads != torch.get_num_threads():
            self._make_table()
        assert self._table is not None
        # A backward pass of an earlier forward pass through the same buffers must not go on with what they hold now.
        self._trained.buffers.generation += 1
        self._stack.take(self._trained.features)
        self._settings[0] = self._optimiser.param_groups[0]["lr"]
        self._optimiser.count(1)
        seconds, processor_seconds = time.perf_counter(), time.process_time()
        self._table.run(self._team.size)
        self._team.took(time.perf_counter() - seconds, time.process_time() - processor_seconds)
        self.is_finite = not self._flags.any()
        if not (self.is_finite and np.isfinite(self._found[0].item())):
            self._optimiser.count(-1)
        return self._found.clone()

    def gradients(self) -> dict[Tensor, Tensor]:
        """Return the gradient of each parameter in the last step; written anew by the next one."""
        return dict(zip(self._parameters, self._of_parameters, strict=True))

    def _split_gradients(self) -> list[Tensor]:
        """Return the place of each parameter's gradient."""
        stack, ends = self._stack, self._trained.ends
        split = stack.n_weights, stack.n_weights + self._n_ends
        of_weights, of_ends, of_moments = torch.tensor_split(self._gradients, split)
        parts = torch.split(of_ends, [part.numel() for part in ends])
        return [
            *stack.gradients(of_weights, of_moments),
            *(part.view_as(parameter) for part, parameter in zip(parts, ends, strict=True)),
        ]

    def _make_table(self) -> None:
        trained, stack = self._trained, self._stack
        threads = torch.get_num_threads()
        stack.prepare(trained.buffers.blocked(trained.propagation), trained.layers)
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
        flags = np.zeros(table.parts, dtype=np.int32)
        self._add_update(table, flags)
        table.place(of_weights=self._gradients.data_ptr(), of_moments=self._gradients[-2 * stack.n_channels :].data_ptr())
        self._table, self._threads, self._flags, self._team = table, threads, flags, Team(table.parts)

    def _values_of_ends(self, table: PhaseTable) -> dict[str, Value]:
        """Return what belongs to the linear layers."""
        trained, stack = self._trained, self._stack
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

    def _add_update(self, table: PhaseTable, flags: NDArray[np.int32]) -> None:
        """Add the phases that look for numbers that are not finite, a part at a flag, and change the parameters."""
        moments = self._optimiser.moments_of(self._parameters)
        pieces = _pieces(self._parameters, self._of_parameters, moments)
        # Pieces are small beside what a part has of them.
        ends = np.cumsum(pieces[:, -1])
        shares = ends[-1] * np.arange(1, table.parts) // table.parts
        starts = np.array([0, *np.searchsorted(ends, shares), len(pieces)], dtype=np.int32)
        table.keep(pieces, starts, moments, flags)
        found = {"gradients": self._gradients.data_ptr(), "n_gradients": len(self._gradients), "flags": flags.ctypes.data}
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
