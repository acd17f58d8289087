"""The training loop that all methods share: one record a step, snapshots now and then, states to go on from."""

from __future__ import annotations

import math
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dmp.devices import available_cores, choose_device
from dmp.errors import TrainingError
from dmp.measures import Measures
from dmp.mesh import IntArray
from dmp.problem import Problem
from dmp.rest import RestWatch
from dmp.settings import Settings
from dmp.snapshot import Snapshot, StepRecord

CHECKPOINT_VERSION = 1


class Training(ABC):
    """A training that is asked for its steps one at a time.

    Pausing is not asking for the next step; stopping is closing the iterator. Between two steps :meth:`state` holds all
    that is needed to go on later. A method derives from this class and says what one update is.

    Attributes:
        problem: what is fitted.
        settings: how.
        run_id: identifies this training in its snapshots.
        step: number of steps done.
        seconds: time spent in steps, pauses not counted.
        device: where it computes.
        threads: processor threads that it uses.
        held_out: indices of the known vertices that the data term never sees, (N,) int64.
    """

    def __init__(self, problem: Problem, settings: Settings, held_out: IntArray, run_id: str | None = None) -> None:
        self.problem = problem
        self.settings = settings
        self.held_out = held_out
        self.run_id = run_id or uuid.uuid4().hex
        self.step = 0
        self.seconds = 0.0
        self.device = choose_device(settings.device)
        self.threads = settings.threads or available_cores()
        self._measures = Measures(problem, held_out)
        self._rest = RestWatch(np.flatnonzero(~problem.known), problem.edge_length, settings.rest_movement)
        self._losses: Mapping[str, Tensor] = {}

    # -- what a method says ---------------------------------------------------------------------------------------

    @property
    @abstractmethod
    def n_parameters(self) -> int:
        """Number of trained values in the network."""

    @abstractmethod
    def _losses_before(self) -> Mapping[str, Tensor]:
        """Evaluate the untrained network and return its loss terms by name, ``total_loss`` among them."""

    @abstractmethod
    def _compute_gradients(self) -> Mapping[str, Tensor]:
        """Run the network forward and backward and return the loss terms by name, ``total_loss`` among them."""

    @abstractmethod
    def _apply_gradients(self) -> None:
        """Update the weights, and whatever else one step changes."""

    @abstractmethod
    def _prediction(self) -> Tensor:
        """Return the predicted positions as they are shown, (V, 3), training units."""

    @abstractmethod
    def _weights(self) -> dict[str, Any]:
        """Return the method's own part of :meth:`state`."""

    @abstractmethod
    def _load_weights(self, state: Mapping[str, Any]) -> None:
        """Take back what :meth:`_weights` returned; may raise anything when it does not fit."""

    # -- what they share ------------------------------------------------------------------------------------------

    def steps(self) -> Iterator[StepRecord]:
        """Train until ``settings.steps``, or until the inserted vertices rest, yielding a record after each step.

        A fresh training yields the untrained network first, as step 0. Losses are those of the network's output in that
        step; the metrics and the snapshot are those of the prediction.

        Raises:
            TrainingError: when a loss is no longer finite; the weights are then still those of the last good step.
        """
        # Process-wide, like every thread count of torch: trainings in one process share it.
        torch.set_num_threads(self.threads)
        if self.step == 0:
            with self._timed():
                self._losses = self._losses_before()
                record = self._record()
            yield record
        while self.step < self.settings.steps and not self._rest.is_at_rest:
            with self._timed():
                losses = self._compute_gradients()
                # On a GPU looking at a number waits for the device, so there it is checked at logged steps only.
                if self.device.type == "cpu" or self._is_due(self.step + 1):
                    self._check_finite(losses["total_loss"].item())
                self._apply_gradients()
                self.step += 1
                self._losses = losses
                record = self._record()
            yield record

    def current(self) -> StepRecord | None:
        """Return a record with a snapshot of the step just done, whatever the interval; None before the first step."""
        return self._record(ahead_of_time=True) if self._losses and self.step else None

    @property
    def is_done(self) -> bool:
        """Whether there is nothing left to do: the last step is reached, or the inserted vertices have come to rest."""
        return self.step >= self.settings.steps or self._rest.is_at_rest

    def state(self) -> dict[str, Any]:
        """Return everything that :meth:`load_state` needs to go on from here: tensors and plain values only."""
        return {
            "version": CHECKPOINT_VERSION,
            "step": self.step,
            "seconds": self.seconds,
            "rest": self._rest.state(),
            **self._weights(),
        }

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what :meth:`state` returned for the same problem and settings.

        Raises:
            TrainingError: when the state does not fit this network.
        """
        try:
            if state["version"] != CHECKPOINT_VERSION:
                raise TrainingError(f"The checkpoint has version {state['version']}, this program writes {CHECKPOINT_VERSION}.")
            self._load_weights(state)
            self._rest.load_state(state["rest"])
            self.step, self.seconds = int(state["step"]), float(state["seconds"])
        except (KeyError, TypeError, ValueError, RuntimeError, AttributeError, IndexError) as error:
            raise TrainingError(f"The checkpoint does not fit the settings of its run ({error}).") from error

    def _timed(self) -> _Stopwatch:
        return _Stopwatch(self)

    def _check_finite(self, loss: float) -> None:
        if not math.isfinite(loss):
            raise TrainingError(
                f"The training left the range of numbers at step {self.step + 1}: the loss is {loss}. "
                f"Snapshots until then are good. A smaller learning rate than {self.settings.learning_rate:g} may help."
            )

    def _is_due(self, step: int) -> bool:
        settings = self.settings
        return step % settings.log_every == 0 or step % settings.snapshot_every == 0 or step in (0, 1, settings.steps)

    def _record(self, ahead_of_time: bool = False) -> StepRecord:
        if not (ahead_of_time or self._is_due(self.step)):
            return StepRecord(self.step, self.seconds)
        vertices = self.problem.joined(self.problem.to_file_units(self._prediction().cpu().numpy()))
        metrics = {name: value.item() for name, value in self._losses.items()}
        metrics.update(self._measures(vertices))
        if not ahead_of_time:
            # A record out of turn must not change what an uninterrupted training would measure later.
            metrics.update(self._rest.update(self.step, vertices))
        wanted = ahead_of_time or self.step % self.settings.snapshot_every == 0 or self.is_done
        snapshot = Snapshot(self.run_id, self.step, vertices, metrics, self.seconds) if wanted else None
        return StepRecord(self.step, self.seconds, metrics, snapshot)


class _Stopwatch:
    """Adds the time of its block to the training's seconds."""

    def __init__(self, training: Training) -> None:
        self._training = training

    def __enter__(self) -> None:
        self._started = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self._training.seconds += time.perf_counter() - self._started
