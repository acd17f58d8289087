"""The method of the paper: a graph network learns the displacements of one mesh from its smoothed copy (section 3)."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from torch import Tensor

from dmp.adam import Adam
from dmp.captured_step import CapturedStep, CudaGraphRecorder, Recorder
from dmp.devices import choose_device, cuda_products, type_between_layers
from dmp.errors import SettingsError, TrainingError
from dmp.layers import convolution_maker, graph_for
from dmp.losses import data_loss, laplacian_loss
from dmp.memory_needs import LARGEST_PATCH, has_room_for_outputs, patch_vertices_for
from dmp.mesh import FloatArray, IntArray
from dmp.network import LAYOUTS, DisplacementNetwork
from dmp.operators import to_torch
from dmp.problem import Problem
from dmp.renumbering import inverse_of, locality_order, renumbered
from dmp.settings import Settings
from dmp.topology import adjacency
from dmp.training import Training

if TYPE_CHECKING:
    from dmp.compiled_losses import CompiledLosses
    from dmp.layers.stack_buffers import StackBuffers
    from dmp.patches.gradients import PatchedNetwork
    from dmp.whole_step import WholeStep


class DeepMeshPrior(Training):
    """Trains a displacement network on fixed random input: q = s + F(sigma; theta), with E + lambda * E_lap as loss.

    The prediction is the running average of the outputs (``settings.average``), which was measured to be closer to the
    truth than each output and costs nothing.

    On a GPU a step is recorded and replayed (:mod:`dmp.captured_step`).

    Attributes:
        makes_whole_steps: whether a step on a processor is one launch where it can be (:mod:`dmp.whole_step`), and not
            a series of operations; looked at in the first step.

    Raises:
        SettingsError: when the settings ask for numbers that a GPU is not given.
    """

    def __init__(self, problem: Problem, settings: Settings, *, run_id: str | None = None) -> None:
        if settings.precision == "bfloat16" and choose_device(settings.device).type == "cuda":
            raise SettingsError(
                "--precision bfloat16 is for the processor alone. On a GPU use --precision auto, which is fast there, or "
                "--device cpu."
            )
        generator = np.random.default_rng(settings.seed)
        features = generator.standard_normal((problem.mesh.n_vertices, settings.input_channels), dtype=np.float32)
        super().__init__(problem, settings, _choose_held_out(problem, settings.hold_out, generator), run_id)
        fitted = np.setdiff1d(np.flatnonzero(problem.known), self.held_out, assume_unique=True)

        # Inside, vertices have another order than in the file; what comes out is in that of the file again.
        n_vertices = problem.mesh.n_vertices
        neighbours = adjacency(problem.mesh.faces, n_vertices)
        order = locality_order(neighbours)
        inverse = inverse_of(order)
        neighbours = renumbered(neighbours, order)
        faces, base = inverse[problem.mesh.faces], problem.base[order]
        fitted = np.sort(inverse[fitted])
        self._order, self._inverse = (torch.from_numpy(numbers).to(self.device) for numbers in (order, inverse))

        self._graph = graph_for(settings, faces, base, self.device, neighbours)
        self._adjacency = to_torch(neighbours, self.device)
        # A vertex of degenerate faces only may have no neighbour; its Laplacian is then the vertex itself over 1.
        self._valence = self._tensor(np.maximum(neighbours.sum(axis=1), 1.0)[:, None])
        self._features = torch.from_numpy(features[order]).to(self.device)
        self._target = self._tensor(problem.to_training_units(problem.target[order]))
        self._base = self._tensor(problem.to_training_units(base))
        self._fitted = None if len(fitted) == len(problem.known) else torch.from_numpy(fitted).to(self.device)

        # Forked, so that the caller's own random numbers stay as they were.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            layout = LAYOUTS[settings.architecture].divided(settings.width_divisor)
            network = DisplacementNetwork(
                settings.input_channels,
                layout.widths,
                layout.hidden,
                skip=settings.skip,
                convolution=convolution_maker(settings),
            )
        self._network = network.to(self.device)
        self._buffers: StackBuffers | None = None
        self._compiled_losses: CompiledLosses | None = None
        self._compiles_losses = self.makes_whole_steps = self.device.type == "cpu"
        self._has_buffers = self.device.type == "cpu" and network.has_use_for_buffers
        self._between_layers = type_between_layers(settings.precision, max(layout.widths), n_vertices)
        # Where the layers of the whole mesh find no room, this many vertices at a time; 0 for all at once.
        self._patch_vertices = patch_vertices_for(settings, n_vertices) if self._has_buffers else 0
        self._patched: PatchedNetwork | None = None
        self._optimiser: Adam = Adam(self._network.parameters(), lr=settings.learning_rate)
        self._output = self._base
        self._average: Tensor | None = None
        self._recorder: Recorder | None = CudaGraphRecorder(self.device) if self.device.type == "cuda" else None
        self._captured: CapturedStep | None = None
        self._whole_step: WholeStep | None = None

    @property
    def n_parameters(self) -> int:
        """Number of trained values in the network."""
        return sum(parameter.numel() for parameter in self._network.parameters())

    def _forward(self) -> Mapping[str, Tensor]:
        output = self._network_output()
        if self.settings.predict == "displacement":
            output = output + self._base
        self._output = output.detach()
        total, data, laplacian = self._losses_of(output)
        return {"total_loss": total, "data_loss": data, "laplacian_loss": laplacian}

    def _losses_of(self, output: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return total, data and Laplacian loss."""
        if self._compiles_losses:
            return self._losses_on_processor()(output)
        data = data_loss(output, self._target, self._fitted)
        smoothed = output if self.settings.laplacian_of == "prediction" else output - self._target
        laplacian = laplacian_loss(
            smoothed, self._adjacency, self._valence, self.settings.laplacian_form, self.settings.laplacian_epsilon
        )
        return data + self.settings.laplacian_weight * laplacian, data, laplacian

    def _losses_on_processor(self) -> CompiledLosses:
        if self._compiled_losses is None:
            # Loads the compiled kernels, which a program that trains nothing can do without.
            from dmp.compiled_losses import CompiledLosses

            self._compiled_losses = CompiledLosses(self.settings, self._target, self._adjacency, self._valence, self._fitted)
        return self._compiled_losses

    def _network_output(self) -> Tensor:
        """Return the network's output, (V, 3), making the memory for it in the first step."""
        if self._patch_vertices and isinstance(self._graph, Tensor):
            if self._patched is None:
                base = self._base.numpy()
                # Loads the compiled kernels, which a program that trains nothing can do without.
                from dmp.patches.gradients import PatchedNetwork

                self._patched = PatchedNetwork(
                    self._network, self._graph, base, self._patch_vertices, dtype=self._between_layers
                )
            return self._patched(self._features)
        output: Tensor = self._network(self._features, self._graph, self._layer_buffers())
        return output

    def _layer_buffers(self) -> StackBuffers | None:
        """Return the memory of the layers, made when it is first wanted, or None where they have no use for it."""
        if self._has_buffers and self._buffers is None:
            n_vertices = len(self._features)
            # Whether outputs are kept changes no digit of the result.
            keep_outputs = has_room_for_outputs(self.settings, n_vertices)
            self._buffers = self._network.buffers_for(n_vertices, dtype=self._between_layers, keep_outputs=keep_outputs)
        return self._buffers

    def _arithmetic(self) -> contextlib.AbstractContextManager[None]:
        if self.device.type != "cuda":
            return contextlib.nullcontext()
        return cuda_products("tf32" if self.settings.precision == "auto" else "ieee")

    def _update(self) -> Mapping[str, Tensor]:
        if self._recorder is None:
            return self._update_on_processor()
        if self._captured is None:
            self._captured = CapturedStep(self._unread_update, self._recorder, self._optimiser.zero_grad)
        losses = self._captured()
        if self._captured.refusal is not None:
            self.warnings.append(
                "The GPU could not record a training step as a whole, so each of its parts is sent to it one by one. That is "
                f"slower, and the result is the same ({self._captured.refusal})."
            )
            self._recorder = self._captured = None
        self._look_at_first_bad()
        return losses

    def _update_on_processor(self) -> Mapping[str, Tensor]:
        """Do one step, in one launch where that can be done."""
        step = self._whole_step = self._whole_step or self._make_whole_step()
        if step is None:
            return super()._update()
        losses = dict(zip(("total_loss", "data_loss", "laplacian_loss"), step().unbind(), strict=True))
        self._check_loss(losses["total_loss"].item(), self.step + 1)
        if not step.is_finite:
            raise self._left_the_numbers(self.step + 1, "the gradient of the loss is not finite")
        # A copy, so that after a step that failed the last good one is shown.
        self._output = step.output.clone()
        self._update_average()
        return losses

    def _make_whole_step(self) -> WholeStep | None:
        """Return what does a step in one launch, or None where that cannot be done."""
        if not self.makes_whole_steps or self._patch_vertices:
            return None
        buffers, network = self._layer_buffers(), self._network
        if buffers is None or buffers.fused is None or network.hidden is None:
            return None
        # Loads the compiled kernels, which a program that trains nothing can do without.
        from dmp.layers.gcn_stack import layer_parameters
        from dmp.whole_step import Trained, WholeStep

        if network.hidden.out_features > buffers.fused.widest:
            return None
        trained = Trained(
            buffers=buffers,
            propagation=cast(Tensor, self._graph),
            features=self._features,
            layers=layer_parameters(network.convolutions, network.normalisations),
            ends=[network.hidden.weight, network.hidden.bias, network.output.weight, network.output.bias],
            base=self._base if self.settings.predict == "displacement" else None,
        )
        return WholeStep(trained, self._losses_on_processor(), self._optimiser)

    def _unread_update(self) -> Mapping[str, Tensor]:
        """Do one step in which nothing is read back from the device and no number comes from Python but constants."""
        losses = self._compute_gradients()
        self._check_finite(losses["total_loss"])
        self._apply_gradients()
        return losses

    def _losses_before(self) -> Mapping[str, Tensor]:
        with torch.no_grad():
            return self._forward()

    def _compute_gradients(self) -> Mapping[str, Tensor]:
        losses = self._forward()
        self._optimiser.zero_grad(set_to_none=True)
        losses["total_loss"].backward()  # type: ignore[no-untyped-call]
        return {name: value.detach() for name, value in losses.items()}

    def _apply_gradients(self) -> None:
        self._optimiser.step()
        self._update_average()

    def _update_average(self) -> None:
        if self.settings.average == 0:
            return
        # The decay grows towards its value, so that the first, poor outputs are soon forgotten.
        if self._average is None:
            self._average = self._output.clone()
        elif self._looks_at_each_step:
            decay = min(self.settings.average, (2 + self.step) / (11 + self.step))
            self._average.lerp_(self._output, 1 - decay)
        else:
            # The same on the device, which counts the step under way already, in the same double precision.
            share = (1 + self._device_step).double() / (10 + self._device_step)
            self._average.lerp_(self._output, (1 - share.clamp(max=self.settings.average)).float())

    def _release(self) -> None:
        self._buffers = self._compiled_losses = self._patched = self._captured = self._whole_step = None
        if self._recorder is not None:
            self._recorder.forget()

    def _prediction(self) -> Tensor:
        shown = self._output if self._average is None else self._average
        return shown.index_select(0, self._inverse)

    def _weights(self) -> dict[str, Any]:
        return {
            "network": self._network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "patch_vertices": self._patch_vertices,
            "average": None if self._average is None else self._average.index_select(0, self._inverse),
        }

    def _load_weights(self, state: Mapping[str, Any]) -> None:
        patch_vertices = state.get("patch_vertices", 0)
        if type(patch_vertices) is not int or not 0 <= patch_vertices <= LARGEST_PATCH:
            raise TrainingError("The checkpoint is damaged: it tells of impossible patches.")
        # As it began, so that it goes on to the last digit; unless that was with more memory than there is now.
        self._patch_vertices = patch_vertices or self._patch_vertices
        self._network.load_state_dict(state["network"])
        self._optimiser.load_state_dict(state["optimiser"])
        average = state["average"]
        if average is not None and average.shape != self._target.shape:
            raise TrainingError("The checkpoint belongs to a mesh with another number of vertices.")
        self._average = None if average is None else average.to(self.device).index_select(0, self._order)

    def _tensor(self, values: FloatArray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32)).to(self.device)


def _choose_held_out(problem: Problem, share: float, generator: np.random.Generator) -> IntArray:
    known = np.flatnonzero(problem.known)
    count = round(share * len(known))
    if share > 0 and len(known) - count < 1:
        raise SettingsError(f"--hold-out {share:g} leaves no vertex to learn from.")
    return np.sort(generator.choice(known, size=count, replace=False))
