"""Whether a training state that was read from a file can be gone on from: nothing in it is believed before it is checked.

A digest tells that a file is as it was written, not who wrote it. So names, shapes, kinds and values are compared with what
the training itself would have written, and sizes before anything is copied.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import torch
from torch import Tensor, nn

from dmp.adam import Adam
from dmp.errors import TrainingError

# Far beyond the longest training that the settings allow.
_MOST_STEPS, _MOST_SECONDS = 10**9, 1e12
_DEEPEST, _MOST_VALUES = 8, 100_000


def check_state(state: Mapping[str, Any], network: nn.Module, optimiser: Adam | torch.optim.Optimizer) -> dict[str, Any]:
    """Return ``state`` with the optimiser's own settings in place of those that were read.

    Args:
        state: what was read; see :meth:`dmp.training.Training.state`.
        network: whose weights are to be replaced.
        optimiser: of that network, fresh.

    Raises:
        TrainingError: when the state holds numbers that are not finite, or does not fit network and optimiser.
    """
    for name, tensor in _tensors(state):
        if tensor.is_floating_point() and not torch.isfinite(tensor).all():
            raise TrainingError(f"The checkpoint holds numbers that are not finite ({name}).")
    step, seconds = state["step"], state["seconds"]
    if type(step) is not int or not 0 <= step <= _MOST_STEPS:
        raise TrainingError("The checkpoint does not say which step it was written at.")
    if not isinstance(seconds, (int, float)) or not math.isfinite(seconds) or not 0 <= seconds <= _MOST_SECONDS:
        raise TrainingError("The checkpoint does not say how long the training took.")
    own = optimiser.state_dict()
    return {**state, "optimiser": {"state": _checked_moments(state, network), "param_groups": own["param_groups"]}}


def _checked_moments(state: Mapping[str, Any], network: nn.Module) -> dict[int, dict[str, Tensor]]:
    """Return the running means of the optimiser by number of the parameter, checked against the parameters."""
    moments = state["optimiser"]["state"]
    parameters = list(network.parameters())
    # Before the first step the optimiser has nothing to remember.
    if not isinstance(moments, dict) or set(moments) not in (set(), set(range(len(parameters)))):
        raise TrainingError("The checkpoint belongs to another network: its optimiser has other parameters.")
    for number, kept in moments.items():
        shapes = {"step": torch.Size([]), "exp_avg": parameters[number].shape, "exp_avg_sq": parameters[number].shape}
        if not isinstance(kept, dict) or kept.keys() != shapes.keys():
            raise TrainingError("The checkpoint belongs to another optimiser.")
        for name, shape in shapes.items():
            tensor = kept[name]
            if not isinstance(tensor, Tensor) or tensor.shape != shape or not tensor.is_floating_point():
                raise TrainingError("The checkpoint belongs to another network: its optimiser has other shapes.")
        if kept["exp_avg_sq"].min() < 0 or kept["step"] < 0:
            raise TrainingError("The checkpoint is damaged: its optimiser holds impossible values.")
    return moments


def tensor_bytes(state: Any) -> int:
    """Return how much memory the tensors in a state claim; a view can claim more than any file holds.

    Raises:
        ValueError: when values are nested deeper, or are more, than in any state that this program writes.
    """
    return sum(tensor.numel() * tensor.element_size() for _, tensor in _tensors(state))


def _tensors(state: Any) -> Iterator[tuple[str, Tensor]]:
    """Yield all tensors with their names; lists that hold each other many times over are not followed for ever."""
    waiting: list[tuple[str, Any, int]] = [("", state, 0)]
    n_seen = 0
    while waiting:
        name, value, depth = waiting.pop()
        n_seen += 1
        if depth > _DEEPEST or n_seen > _MOST_VALUES:
            raise ValueError("its values are nested too deeply, or too many")
        if isinstance(value, Tensor):
            yield name, value
        elif isinstance(value, Mapping):
            waiting += [(f"{name}.{key}".lstrip("."), item, depth + 1) for key, item in value.items()]
        elif isinstance(value, (list, tuple)):
            waiting += [(f"{name}[{index}]", item, depth + 1) for index, item in enumerate(value)]
