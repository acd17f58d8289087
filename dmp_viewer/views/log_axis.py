"""A vertical axis whose logarithmic ticks stay legible on any range."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyqtgraph as pg

from dmp_viewer.colors import nice_ticks

_PIXELS_PER_LABEL = 30


class LogAxis(pg.AxisItem):
    """Labels 1, 2, 5 of each decade, only the decades on long ranges, and round numbers on short ones.

    pyqtgraph itself labels every multiple, one over the other.
    """

    def tickValues(self, low: float, high: float, size: float) -> list[tuple[Any, list[float]]]:
        """Return labelled ticks and, on long ranges, unlabelled ones between them."""
        if not self.logMode or not np.isfinite([low, high]).all() or high <= low:
            return super().tickValues(low, high, size)
        return log_ticks(low, high, max(2, int(size / _PIXELS_PER_LABEL)))

    def tickStrings(self, values: list[float], scale: float, spacing: Any) -> list[str]:
        """Write labelled ticks as plain numbers; ``spacing`` is None for those that stay without a label."""
        if not self.logMode:
            return super().tickStrings(values, scale, spacing)
        return [f"{10.0**value:.3g}" if spacing is not None else "" for value in values]


def log_ticks(low: float, high: float, most: int) -> list[tuple[Any, list[float]]]:
    """Return ticks between two decimal logarithms as (spacing, logarithms); a spacing of None means "no label".

    Args:
        low: lower end of the axis, as a decimal logarithm.
        high: upper end.
        most: how many labels there is room for.
    """
    decades = np.arange(np.floor(low), np.ceil(high) + 1)

    def within(factors: tuple[int, ...]) -> list[float]:
        ticks = (decades[:, None] + np.log10(np.array(factors))).ravel()
        return [float(tick) for tick in ticks if low <= tick <= high]

    for factors, others in (
        ((1, 2, 3, 4, 5, 6, 8), ()),
        ((1, 2, 5), (3, 4, 6, 7, 8, 9)),
        ((1, 3), (2, 4, 5, 6, 7, 8, 9)),
        ((1,), (2, 5)),
    ):
        labelled = within(factors)
        if 3 <= len(labelled) <= most:
            return [(1.0, labelled), (None, within(others) if others else [])]
    if high - low < 1:
        return [(1.0, [float(np.log10(tick)) for tick in nice_ticks(10.0**low, 10.0**high, most) if tick > 0])]
    step = int(np.ceil(len(decades) / most))
    return [(1.0, [float(decade) for decade in decades[::step] if low <= decade <= high])]
