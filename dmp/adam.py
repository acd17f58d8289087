"""Adam, without what torch's own class brings along."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import torch
from torch import Tensor, nn

_BETAS, _EPSILON = (0.9, 0.999), 1e-8


class Adam:
    """Adam (Kingma & Ba 2015) with the usual decays 0.9 and 0.999: same arithmetic and same states as ``torch.optim.Adam``.

    The first optimiser of torch's own that a process makes loads 800 modules of its compiler, which was measured to take
    1.4 seconds; nothing here is ever compiled.

    From the second step on a step makes no new tensors but changes those that are there, the counts of steps among them. So one
    can be recorded and replayed on a GPU (:mod:`dmp.captured_step`); a replay keeps the ``lr`` of the recording.

    Attributes:
        param_groups: one, whose ``lr`` may be changed between steps.
    """

    def __init__(self, parameters: Iterable[nn.Parameter], lr: float) -> None:
        self._parameters = list(parameters)
        # Counts of steps, in one tensor so that they are counted in one operation.
        self._counts = torch.zeros(len(self._parameters), device=self._parameters[0].device if self._parameters else None)
        self._moments: dict[int, dict[str, Tensor]] = {}
        self.param_groups: list[dict[str, Any]] = [{"lr": lr, "params": list(range(len(self._parameters)))}]

    def zero_grad(self, set_to_none: bool = True) -> None:
        """Forget the gradients."""
        for parameter in self._parameters:
            if set_to_none:
                parameter.grad = None
            elif parameter.grad is not None:
                parameter.grad.zero_()

    @torch.no_grad()
    def step(self) -> None:
        """Update the parameters that have a gradient."""
        gradients = {number: p.grad for number, p in enumerate(self._parameters) if p.grad is not None}
        if not gradients:
            return
        self._make_moments(gradients)
        moments = [self._moments[number] for number in gradients]
        counts = [kept["step"] for kept in moments]
        if len(counts) == len(self._parameters):
            self._counts.add_(1)
        else:
            torch._foreach_add_(counts, 1)
        torch._fused_adam_(
            [self._parameters[number] for number in gradients],
            list(gradients.values()),
            [kept["exp_avg"] for kept in moments],
            [kept["exp_avg_sq"] for kept in moments],
            [],
            counts,
            lr=self.param_groups[0]["lr"],
            beta1=_BETAS[0],
            beta2=_BETAS[1],
            weight_decay=0.0,
            eps=_EPSILON,
            amsgrad=False,
            maximize=False,
        )

    @property
    def decays(self) -> tuple[float, float]:
        """Beta 1 and beta 2."""
        return _BETAS

    @property
    def epsilon(self) -> float:
        """Added to the denominator."""
        return _EPSILON

    def moments_of(self, parameters: Iterable[Tensor]) -> list[dict[str, Tensor]]:
        """Return the count of steps and both running means of these parameters, for whoever does the step in our place.

        Raises:
            KeyError: when one of them is none of the optimiser's.
        """
        numbers = {id(parameter): number for number, parameter in enumerate(self._parameters)}
        wanted = [numbers[id(parameter)] for parameter in parameters]
        self._make_moments(wanted)
        return [self._moments[number] for number in wanted]

    def count(self, steps: int) -> None:
        """Count so many steps of all parameters, which somebody else does."""
        self._counts.add_(steps)

    def _make_moments(self, numbers: Iterable[int]) -> None:
        for number in numbers:
            if number not in self._moments:
                parameter = self._parameters[number]
                self._moments[number] = {
                    "step": self._counts[number],
                    "exp_avg": torch.zeros_like(parameter),
                    "exp_avg_sq": torch.zeros_like(parameter),
                }

    def state_dict(self) -> dict[str, Any]:
        """Return the running means by number of the parameter, and the settings."""
        return {
            "state": {number: {**kept, "step": kept["step"].clone()} for number, kept in self._moments.items()},
            "param_groups": [dict(group) for group in self.param_groups],
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take back what :meth:`state_dict`, or that of ``torch.optim.Adam``, returned for the same parameters."""
        self._counts.zero_()
        self._moments = {
            number: {
                name: tensor.detach().to(device=self._parameters[number].device, dtype=torch.float32, copy=True).contiguous()
                for name, tensor in kept.items()
            }
            for number, kept in state["state"].items()
        }
        for number, kept in self._moments.items():
            self._counts[number] = kept["step"]
            kept["step"] = self._counts[number]
        self.param_groups[0]["lr"] = state["param_groups"][0]["lr"]
