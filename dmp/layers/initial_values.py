"""First values of weights."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn


def glorot_(tensor: Tensor, fan_in: int, fan_out: int) -> Tensor:
    """Fill ``tensor`` from the uniform distribution on +-sqrt(6 / (fan_in + fan_out)) (Glorot & Bengio 2010, eq. 16)."""
    bound = math.sqrt(6.0 / (fan_in + fan_out))
    return nn.init.uniform_(tensor, -bound, bound)


def glorot_parameter(*shape: int, fan_in: int, fan_out: int) -> nn.Parameter:
    """Return a fresh parameter of that shape; see :func:`glorot_`."""
    return nn.Parameter(glorot_(torch.empty(shape), fan_in, fan_out))
