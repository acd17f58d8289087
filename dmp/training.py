"""The training loop: one mesh, one network, one record a step (paper, section 3.2)."""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dmp.devices import available_cores, choose_device
from dmp.errors import SettingsError, TrainingError
from dmp.geometry import vertex_normals
from dmp.losses import data_loss, laplacian_loss
from dmp.mesh import FloatArray, IntArray
from dmp.network import DisplacementNetwork, scaled_widths
from dmp.operators import normalised_adjacency, to_torch
from dmp.problem import Problem
from dmp.settings import Settings
from dmp.snapshot import Snapshot, StepRecord
from dmp.topology import adjacency

CHECKPOINT_VERSION = 1


class Training:
    """A training that is asked for its steps one at a time.

    Pausing is not asking for the next step; stopping is closing the iterator. Between two steps :meth:`state` holds all
    that is needed to go on later.

    Attributes:
        run_id: identifies this training in its snapshots.
        step: number of steps done.
        seconds: time spent in steps, pauses not counted.
        device: where it computes.
        held_out: indices of the known vertices that the data term never sees, (N,) int64.
    """

    def __init__(self, problem: Problem, settings: Settings, *, run_id: str | None = None) -> None:
        self.problem = problem
        self.settings = settings
        self.run_id = run_id or uuid.uuid4().hex
        self.step = 0
        self.seconds = 0.0
        self.device = choose_device(settings.device)
        self.threads = settings.threads or available_cores()

        generator = np.random.default_rng(settings.seed)
        features = generator.standard_normal((problem.mesh.n_vertices, settings.input_channels), dtype=np.float32)
        self.held_out = _choose_held_out(problem, settings.hold_out, generator)
        fitted = np.setdiff1d(np.flatnonzero(problem.known), self.held_out, assume_unique=True)

        neighbours = adjacency(problem.mesh.faces, problem.mesh.n_vertices)
        self._propagation = to_torch(normalised_adjacency(problem.mesh.faces, problem.mesh.n_vertices), self.device)
        self._adjacency = to_torch(neighbours, self.device)
        # A vertex of degenerate faces only may have no neighbour; its Laplacian is then the vertex itself over 1.
        self._valence = self._tensor(np.maximum(neighbours.sum(axis=1), 1.0)[:, None])
        self._features = torch.from_numpy(features).to(self.device)
        self._target = self._tensor(problem.to_training_units(problem.target))
        self._base = self._tensor(problem.to_training_units(problem.base))
        self._fitted = None if len(fitted) == len(problem.known) else torch.from_numpy(fitted).to(self.device)
        self._measures = _Measures(problem, self.held_out)

        # Forked, so that the caller's own random numbers stay as they were.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            network = DisplacementNetwork(settings.input_channels, scaled_widths(settings.width_divisor))
        self._network = network.to(self.device)
        self._optimiser = torch.optim.Adam(self._network.parameters(), lr=settings.learning_rate, fused=True)
        self._average: Tensor | None = None
        self._latest: tuple[Tensor, Tensor, Tensor] | None = None

    @property
    def n_parameters(self) -> int:
        """Number of trained values in the network."""
        return sum(parameter.numel() for parameter in self._network.parameters())

    def steps(self) -> Iterator[StepRecord]:
        """Train until ``settings.steps``, yielding a record after each step.

        A fresh training yields the untrained network first, as step 0. Losses are those of the network's output in that
        step; the metrics and the snapshot are those of the prediction, which is the running average of the outputs.

        Raises:
            TrainingError: when a loss is no longer finite; the weights are then still those of the last good step.
        """
        # Process-wide, like every thread count of torch: trainings in one process share it.
        torch.set_num_threads(self.threads)
        if self.step == 0:
            with torch.no_grad():
                started = time.perf_counter()
                record = self._record(*self._forward(), force=True)
                self.seconds += time.perf_counter() - started
            yield record
        while self.step < self.settings.steps:
            started = time.perf_counter()
            output, data, laplacian = self._forward()
            loss = data + self.settings.laplacian_weight * laplacian
            self._optimiser.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            # On a GPU looking at a number waits for the device, so there it is checked at logged steps only.
            if (self.device.type == "cpu" or self._is_due(self.step + 1)) and not math.isfinite(loss.item()):
                raise TrainingError(
                    f"The training left the range of numbers at step {self.step + 1}: the loss is {loss.item()}. "
                    f"Snapshots until then are good. A smaller learning rate than {self.settings.learning_rate:g} may help."
                )
            self._optimiser.step()
            self.step += 1
            self._latest = (self._averaged(output.detach()), data.detach(), laplacian.detach())
            record = self._record(*self._latest)
            self.seconds += time.perf_counter() - started
            yield record

    def current(self) -> StepRecord | None:
        """Return a record with a snapshot of the step just done, whatever the interval; None before the first step."""
        return None if self._latest is None else self._record(*self._latest, force=True)

    def state(self) -> dict[str, Any]:
        """Return everything that :meth:`load_state` needs to go on from here: tensors and plain values only."""
        return {
            "version": CHECKPOINT_VERSION,
            "step": self.step,
            "seconds": self.seconds,
            "network": self._network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "average": self._average,
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on from what :meth:`state` returned for the same problem and settings.

        Raises:
            TrainingError: when the state does not fit this network.
        """
        try:
            if state["version"] != CHECKPOINT_VERSION:
                raise TrainingError(f"The checkpoint has version {state['version']}, this program writes {CHECKPOINT_VERSION}.")
            self._network.load_state_dict(state["network"])
            self._optimiser.load_state_dict(state["optimiser"])
            average = state["average"]
            if average is not None and average.shape != self._target.shape:
                raise TrainingError("The checkpoint belongs to a mesh with another number of vertices.")
            self._average = None if average is None else average.to(self.device)
            self.step, self.seconds = int(state["step"]), float(state["seconds"])
        except (KeyError, TypeError, ValueError, RuntimeError, AttributeError) as error:
            raise TrainingError(f"The checkpoint does not fit the settings of its run ({error}).") from error

    def _tensor(self, values: FloatArray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32)).to(self.device)

    def _forward(self) -> tuple[Tensor, Tensor, Tensor]:
        output = self._network(self._features, self._propagation)
        if self.settings.predict == "displacement":
            output = output + self._base
        data = data_loss(output, self._target, self._fitted)
        laplacian = laplacian_loss(output, self._adjacency, self._valence, self.settings.laplacian_form)
        return output, data, laplacian

    def _averaged(self, output: Tensor) -> Tensor:
        if self.settings.average == 0:
            return output
        if self._average is None:
            self._average = output.clone()
        else:
            # The decay grows towards its value, so that the first, poor outputs are soon forgotten.
            decay = min(self.settings.average, (1 + self.step) / (10 + self.step))
            self._average.lerp_(output, 1 - decay)
        return self._average

    def _is_due(self, step: int) -> bool:
        settings = self.settings
        return step % settings.log_every == 0 or step % settings.snapshot_every == 0 or step in (1, settings.steps)

    def _record(self, prediction: Tensor, data: Tensor, laplacian: Tensor, force: bool = False) -> StepRecord:
        if not (force or self._is_due(self.step)):
            return StepRecord(self.step, self.seconds)
        vertices = self.problem.to_file_units(prediction.cpu().numpy())
        metrics = {"data_loss": data.item(), "laplacian_loss": laplacian.item()}
        metrics["total_loss"] = metrics["data_loss"] + self.settings.laplacian_weight * metrics["laplacian_loss"]
        metrics.update(self._measures(vertices))
        wanted = force or self.step % self.settings.snapshot_every == 0 or self.step == self.settings.steps
        snapshot = Snapshot(self.run_id, self.step, vertices, metrics, self.seconds) if wanted else None
        return StepRecord(self.step, self.seconds, metrics, snapshot)


class _Measures:
    """What is measured of a prediction, all in mean edge lengths of the input unless said otherwise."""

    def __init__(self, problem: Problem, held_out: IntArray) -> None:
        self._problem = problem
        self._held_out = held_out
        # Of the smoothed mesh: the noise has hardly touched these, so an error along them is an error of the shape.
        self._normals = vertex_normals(problem.base, problem.mesh.faces)[held_out]

    def __call__(self, vertices: FloatArray) -> dict[str, float]:
        problem = self._problem
        residual = vertices - problem.target
        values = {
            "displacement": float(np.linalg.norm(vertices - problem.base, axis=1).mean()) / problem.edge_length,
            "input_distance": float(np.linalg.norm(residual[problem.known], axis=1).mean()) / problem.edge_length,
        }
        if len(self._held_out):
            hidden = residual[self._held_out]
            along = np.abs(np.einsum("vc,vc->v", hidden, self._normals))
            values["held_out_error"] = float(np.linalg.norm(hidden, axis=1).mean()) / problem.edge_length
            values["held_out_normal_error"] = float(along.mean()) / problem.edge_length
        if problem.ground_truth is not None:
            values.update(problem.ground_truth.measures(vertices))
        return values


def _choose_held_out(problem: Problem, share: float, generator: np.random.Generator) -> IntArray:
    known = np.flatnonzero(problem.known)
    count = round(share * len(known))
    if share > 0 and len(known) - count < 1:
        raise SettingsError(f"--hold-out {share:g} leaves no vertex to learn from.")
    return np.sort(generator.choice(known, size=count, replace=False))


def train(problem: Problem, settings: Settings) -> Iterator[Snapshot]:
    """Train on one problem and yield a snapshot every ``settings.snapshot_every`` steps and at the end.

    Example:
        >>> settings = settings_for("denoise", steps=200)
        >>> for snapshot in train(denoising(read_mesh("noisy.ply"), settings), settings):
        ...     print(snapshot.step, snapshot.metrics["data_loss"])
    """
    for record in Training(problem, settings).steps():
        if record.snapshot is not None:
            yield record.snapshot
