"""The training curve as the window keeps it: rows in, series out, smoothed causally for drawing. No widgets."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dmp.measure_names import MEASURE_BY_NAME, MEASURES, Measure, axis_text, unit_text

__all__ = [
    "EXPLANATIONS", "MEASURES", "MEASURE_BY_NAME", "Curve", "Measure", "Reference", "RunningAverage", "Series", "axis_text",
    "unit_text",
]  # fmt: skip

Series = tuple[NDArray[np.float64], NDArray[np.float64]]

# What the curve shows, by the kind of training.
EXPLANATIONS = {
    "denoise": "The data loss falls as long as training goes on: first the network learns the shape, later the noise as well. "
    "The held-out error, measured on vertices that the training never sees, stops falling where the noise begins to be learnt. "
    "Keep a step around there. With a ground truth, the lowest MAD marks the best step.",
    "complete": "The network learns the shape around the holes and carries it into them. The movement tells how far the "
    "inserted vertices still move: when it comes to rest, the completion is done. With a ground truth, the distance in the "
    "holes tells how close it is.",
    "made-up-holes": "The network learns to fill holes that are made up where the truth is known. The error in some that it "
    "never learns from tells how well the real holes are filled. With a ground truth, the distance in the holes tells how "
    "close it is.",
    "complete, denoise": "The network learns the shape, fills the holes with it, and later learns the noise as well. The "
    "held-out error, measured on vertices that the training never sees, stops falling where the noise begins to be learnt. "
    "Keep a step around there.",
}


@dataclass(frozen=True)
class Reference:
    """A value to compare a measure with, drawn as a level line.

    Attributes:
        name: the measure.
        value: in the unit of the measure.
        label: what it is, two or three words.
    """

    name: str
    value: float
    label: str


class Curve:
    """The logged steps of one run, in ascending order.

    Attributes:
        generation: grows whenever rows are taken back, so that who has drawn part of a series knows to begin anew.
    """

    def __init__(self, rows: Iterable[Mapping[str, float]] = ()) -> None:
        self.generation = 0
        self._rows: list[dict[str, float]] = []
        self._columns: dict[str, tuple[array[float], array[float]]] = {}
        self._lowest: dict[str, float] = {}
        self.extend(rows)

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def rows(self) -> list[dict[str, float]]:
        """The rows, as :meth:`dmp.runs.Run.curve` gives them."""
        return self._rows

    def extend(self, rows: Iterable[Mapping[str, float]]) -> None:
        """Append rows; one whose step is not above the last takes the place of those from that step on."""
        for row in rows:
            if self._rows and self._rows[-1]["step"] >= row["step"]:
                self._take_back(row["step"])
            self._append(dict(row))

    def _append(self, row: dict[str, float]) -> None:
        self._rows.append(row)
        for name, value in row.items():
            # The first step changes nothing yet; its movement of 0 would only keep the axis from being logarithmic.
            if name in MEASURE_BY_NAME and not (name == "inserted_movement" and row["step"] <= 1):
                steps, values = self._columns.setdefault(name, (array("d"), array("d")))
                steps.append(row["step"])
                values.append(value)
                self._lowest[name] = min(value, self._lowest.get(name, math.inf))

    def _take_back(self, step: float) -> None:
        remaining = [row for row in self._rows if row["step"] < step]
        self._rows, self._columns, self._lowest = [], {}, {}
        self.generation += 1
        for row in remaining:
            self._append(row)

    def names(self) -> list[str]:
        """Return the measures that occur, in the order of :data:`MEASURES`."""
        return [measure.name for measure in MEASURES if measure.name in self._columns]

    def series(self, name: str) -> Series:
        """Return steps and values of one measure, two float arrays of equal length."""
        steps, values = self._columns.get(name, (array("d"), array("d")))
        return np.array(steps, dtype=np.float64), np.array(values, dtype=np.float64)

    def lowest(self, name: str) -> float:
        """Return the lowest value of a measure so far, infinity when there is none."""
        return self._lowest.get(name, math.inf)

    def nearest(self, step: float) -> Mapping[str, float] | None:
        """Return the row whose step is nearest, or None when nothing is logged."""
        if not self._rows:
            return None
        index = bisect_left(self._rows, step, key=lambda row: row["step"])
        return min(self._rows[max(0, index - 1) : index + 1], key=lambda row: abs(row["step"] - step))

    def value_at(self, name: str, step: int) -> float | None:
        """Return a measure at a logged step, or None when it was not measured there."""
        row = self.nearest(step)
        return None if row is None or int(row["step"]) != step else row.get(name)

    def best(self, name: str, steps: Iterable[int]) -> int | None:
        """Return the one of ``steps`` where a measure is lowest, or None when none of them was measured."""
        wanted = set(steps)
        rows = [row for row in self._rows if name in row and int(row["step"]) in wanted]
        return int(min(rows, key=lambda row: row[name])["step"]) if rows else None


class RunningAverage:
    """A debiased running average that grows with its series: each point knows only what came before it.

    Args:
        strength: weight of the past, 0 (none) to 0.99.
    """

    def __init__(self, strength: float) -> None:
        self.strength = min(max(strength, 0.0), 0.99)
        self.values: list[float] = []
        self._average = 0.0
        self._norm = 0.0

    def follow(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the average of all ``values``, of which those seen before are not computed again."""
        weight = self.strength
        for value in values[len(self.values) :].tolist():
            self._average = weight * self._average + (1 - weight) * value
            self._norm = weight * self._norm + (1 - weight)
            self.values.append(self._average / self._norm)
        return np.array(self.values, dtype=np.float64)
