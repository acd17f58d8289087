"""When a completion is done: the inserted vertices have come to rest (paper, section 4.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from dmp.mesh import FloatArray, IntArray

# The movement has to stay below its bound for this many steps in a row.
_PATIENCE = 300


class RestWatch:
    """Watches how far the inserted vertices move from one logged step to the next.

    The paper trains "until the displacements hardly change". Here that is: the mean movement of the inserted vertices,
    in mean edge lengths per 100 steps, stays below a bound for 300 steps.
    """

    def __init__(self, inserted: IntArray, edge_length: float, bound: float) -> None:
        """Watch the vertices ``inserted`` (N,); ``edge_length`` in file units; a ``bound`` of 0 never rests."""
        self._inserted = inserted
        self._edge_length = edge_length
        self._bound = bound
        self._before: tuple[int, FloatArray] | None = None
        self._resting_since: int | None = None

    @property
    def is_at_rest(self) -> bool:
        """Whether the movement has been below its bound for long enough."""
        if self._resting_since is None or self._before is None:
            return False
        return self._before[0] - self._resting_since >= _PATIENCE

    def update(self, step: int, vertices: FloatArray) -> dict[str, float]:
        """Take in the prediction of a logged step, (V, 3), file units, and return ``inserted_movement``."""
        if not len(self._inserted):
            return {}
        now = vertices[self._inserted]
        before, self._before = self._before, (step, now)
        if before is None or step <= before[0]:
            return {}
        moved = float(np.linalg.norm(now - before[1], axis=1).mean()) / self._edge_length * 100 / (step - before[0])
        if moved >= self._bound:
            self._resting_since = None
        elif self._resting_since is None:
            self._resting_since = before[0]
        return {"inserted_movement": moved}

    def state(self) -> dict[str, Any]:
        """Return what :meth:`load_state` needs, tensors and plain values only."""
        before = None if self._before is None else (self._before[0], torch.tensor(self._before[1]))
        return {"before": before, "resting_since": self._resting_since}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Go on from :meth:`state`; may raise anything when it does not fit."""
        before = state["before"]
        self._before = None if before is None else (int(before[0]), before[1].numpy().reshape(len(self._inserted), 3))
        since = state["resting_since"]
        self._resting_since = None if since is None else int(since)
