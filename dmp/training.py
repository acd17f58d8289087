"""The training loop that all methods share: one record a step, snapshots now and then, states to go on from."""

from __future__ import annotations

import contextlib
import math
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dmp.adam import Adam
from dmp.devices import available_cores, choose_device
from dmp.errors import TrainingError
from dmp.measures import Measures
from dmp.mesh import IntArray
from dmp.problem import Problem
from dmp.rest import RestWatch
from dmp.settings import Settings
from dmp.snapshot import Snapshot, StepRecord
from dmp.training_state import check_state

CHECKPOINT_VERSION = 1


class Training(ABC):
    """A training that is asked for its steps one at a time.

    Pausing is not asking for the next step; stopping is closing the iterator. Between two steps :meth:`state` holds all
    that is needed to go on later. A method derives from this class and says what one update is; it sets ``_network`` and
    ``_optimiser``.

    Attributes:
        problem: what is fitted: the trainable part of what was asked for, see :meth:`dmp.problem.Problem.trainable_part`.
        settings: how.
        run_id: identifies this training in its snapshots.
        step: number of steps done.
        seconds: time spent in steps, pauses not counted.
        device: where it computes.
        threads: processor threads that it uses.
        warnings: sentences for the user about what goes another way than it should; a run takes them over.
        held_out: indices of the known vertices that the data term never sees, (N,) int64.
    """

    _network: Any  # a torch.nn.Module, with more that only the method knows
    _optimiser: Adam | torch.optim.Optimizer

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
        self.warnings: list[str] = []
        self._losses: Mapping[str, Tensor] = {}
        self._is_half_done = False
        # Where looking waits for the device: the step that it is at, and the first one whose loss or gradient was not finite,
        # 0 for none. Both stay in their places, so that a step that is recorded and replayed finds them.
        self._device_step, self._first_bad = (torch.zeros((), dtype=torch.int64, device=self.device) for _ in range(2))

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

    def _release(self) -> None:  # noqa: B027  # not every method has any
        """Give back memory that only steps need, and that the next step makes again."""

    def _arithmetic(self) -> contextlib.AbstractContextManager[None]:
        """Return what products of a step are computed under, where that is a matter of the whole process."""
        return contextlib.nullcontext()

    # -- what they share ------------------------------------------------------------------------------------------

    def steps(self) -> Iterator[StepRecord]:
        """Train until ``settings.steps``, or until the inserted vertices rest, yielding a record after each step.

        A fresh training yields the untrained network first, as step 0. Losses are those of the network's output in that
        step; the metrics and the snapshot are those of the prediction.

        Raises:
            TrainingError: when a step was broken off half-way before, see :meth:`state`; or when the loss, its gradient or the
                prediction is no longer finite. On a processor the weights are
                then still those of the last good step, unless it was the prediction. On a GPU loss and gradient are looked
                at in logged steps only, because looking waits for the device; the step named is the right one all the same.
        """
        self._check_whole()
        # Process-wide, like every thread count of torch: trainings in one process share it.
        torch.set_num_threads(self.threads)
        self._device_step.fill_(self.step)
        try:
            if self.step == 0:
                with self._timed(), self._arithmetic():
                    self._losses = self._losses_before()
                    self._check_loss(self._losses["total_loss"].item(), 0)
                    record = self._record()
                yield record
            while self.step < self.settings.steps and not self._rest.is_at_rest:
                with self._timed(), self._arithmetic():
                    self._is_half_done = True
                    try:
                        losses = self._update()
                    except TrainingError:
                        # Said of a step that changed nothing, or of earlier ones.
                        self._is_half_done = False
                        raise
                    self.step += 1
                    self._losses = losses
                    self._is_half_done = False
                    record = self._record()
                yield record
        finally:
            self._release()

    def current(self) -> StepRecord | None:
        """Return a record with a snapshot of the step just done, whatever the interval; None before the first step."""
        return self._record(ahead_of_time=True) if self._losses and self.step else None

    @property
    def is_done(self) -> bool:
        """Whether there is nothing left to do: the last step is reached, or the inserted vertices have come to rest."""
        return self.step >= self.settings.steps or self._rest.is_at_rest

    def state(self) -> dict[str, Any]:
        """Return everything that :meth:`load_state` needs to go on from here: tensors and plain values only.

        Raises:
            TrainingError: when the last step was broken off half-way, by Ctrl-C in a notebook for example.
        """
        self._check_whole()
        return {
            "version": CHECKPOINT_VERSION,
            "run_id": self.run_id,
            "step": self.step,
            "seconds": self.seconds,
            "rest": self._rest.state(),
            **self._weights(),
        }

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what :meth:`state` returned for the same problem and settings.

        Raises:
            TrainingError: when the state does not fit this network, or holds anything that this program would not write.
        """
        try:
            if state["version"] != CHECKPOINT_VERSION:
                raise TrainingError(f"The checkpoint has version {state['version']}, this program writes {CHECKPOINT_VERSION}.")
            checked = check_state(state, self._network, self._optimiser)
            # What steps have made for themselves may hold on to the tensors that are about to be replaced.
            self._release()
            self._load_weights(checked)
            self._rest.load_state(checked["rest"])
            self.step, self.seconds = checked["step"], float(checked["seconds"])
            self._is_half_done = False
            self._device_step.fill_(self.step)
            self._first_bad.zero_()
        except (KeyError, TypeError, ValueError, RuntimeError, AttributeError, IndexError, OverflowError) as error:
            cause = " ".join(str(error).split())[:200]
            raise TrainingError(f"The checkpoint does not fit the settings of its run ({cause}).") from error

    def _check_whole(self) -> None:
        if self._is_half_done:
            raise TrainingError(
                f"Step {self.step + 1} was broken off half-way, and what was learnt fits no step any more. Go on from a state "
                "that was kept before, or begin anew."
            )

    def _timed(self) -> _Stopwatch:
        return _Stopwatch(self)

    def _update(self) -> Mapping[str, Tensor]:
        """Do one step and return its loss terms by name."""
        losses = self._compute_gradients()
        self._check_finite(losses["total_loss"])
        self._look_at_first_bad()
        self._apply_gradients()
        return losses

    def _check_finite(self, loss: Tensor) -> None:
        """Look at the loss of a step and its gradient, or have the device remember what there is to see."""
        gradients = [parameter.grad for parameter in self._network.parameters() if parameter.grad is not None]
        # The largest value: the usual norm overflows although each value is finite, and torch's largest norm is slow.
        extremes = [extreme for gradient in gradients for extreme in torch.aminmax(gradient)]
        largest = torch.stack(extremes).abs().max()
        if self._looks_at_each_step:
            self._check_loss(loss.item(), self.step + 1)
            if not math.isfinite(largest.item()):
                raise self._left_the_numbers(self.step + 1, "the gradient of the loss is not finite")
            return
        self._device_step.add_(1)
        is_bad = ~(torch.isfinite(loss.detach()) & torch.isfinite(largest))
        self._first_bad.copy_(torch.where(is_bad & (self._first_bad == 0), self._device_step, self._first_bad))

    def _look_at_first_bad(self) -> None:
        """Look at what the device remembers, if the step under way is one at which that is read anyway."""
        if not self._looks_at_each_step and self._is_due(self.step + 1) and (first := int(self._first_bad.item())):
            raise self._left_the_numbers(first, "the loss or its gradient is not finite")

    @property
    def _looks_at_each_step(self) -> bool:
        return self.device.type == "cpu"

    def _check_loss(self, loss: float, step: int) -> None:
        if not math.isfinite(loss):
            raise self._left_the_numbers(step, f"the loss is {loss}")

    def _left_the_numbers(self, step: int, how: str) -> TrainingError:
        remedy = f"A smaller learning rate than {self.settings.learning_rate:g} may help."
        if step:
            remedy = f"Snapshots of earlier steps are good. {remedy}"
        return TrainingError(f"The training left the range of numbers at step {step}: {how}. {remedy}")

    def _is_due(self, step: int) -> bool:
        settings = self.settings
        return step % settings.log_every == 0 or step % settings.snapshot_every == 0 or step in (0, 1, settings.steps)

    def _record(self, ahead_of_time: bool = False) -> StepRecord:
        if not (ahead_of_time or self._is_due(self.step)):
            return StepRecord(self.step, self.seconds)
        predicted = self._prediction().cpu().numpy()
        if not np.isfinite(predicted).all():
            count = np.count_nonzero(~np.isfinite(predicted).all(axis=1))
            raise self._left_the_numbers(self.step, f"{count} of {len(predicted)} predicted positions are not finite")
        vertices = self.problem.joined(self.problem.to_file_units(predicted))
        metrics = {name: value.item() for name, value in self._losses.items()}
        metrics.update(self._measures(vertices))
        if not ahead_of_time:
            # A record out of turn must not change what an uninterrupted training would measure later.
            metrics.update(self._rest.update(self.step, vertices))
        wanted = ahead_of_time or self.step % self.settings.snapshot_every == 0 or self.is_done
        snapshot = Snapshot(self.run_id, self.step, self.problem.placed(vertices), metrics, self.seconds) if wanted else None
        return StepRecord(self.step, self.seconds, metrics, snapshot)


class _Stopwatch:
    """Adds the time of its block to the training's seconds."""

    def __init__(self, training: Training) -> None:
        self._training = training

    def __enter__(self) -> None:
        self._started = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self._training.seconds += time.perf_counter() - self._started
