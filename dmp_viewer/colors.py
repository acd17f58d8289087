"""What a colour on a mesh means: the quantity, its unit, its range and its colour map. No widgets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dmp.quantities import QUANTITIES as _QUANTITIES
from dmp.quantities import ColorTable, Kind, Limits, Quantity, QuantitySpec, Unit, Values, limits_for, nice_ticks, unit_of
from dmp.vertex_measures import ROBUST_PERCENTILE

RangePolicy = Literal["step", "run", "locked"]
UpAxis = Literal["y", "z"]

PERCENTILE = ROBUST_PERCENTILE

__all__ = [
    "PERCENTILE", "QUANTITIES", "ColorPolicy", "ColorTable", "Histogram", "Kind", "Limits", "Quantity", "QuantitySpec",
    "RangePolicy", "Unit", "UpAxis", "Values", "color_table", "histogram", "limits_for", "nice_ticks", "unit_of",
]  # fmt: skip

# Where in the menus that is found which a quantity needs.
_WHERE: Mapping[Quantity, str] = {
    "error": " (File > Open ground truth)",
    "normal_error": " (File > Open ground truth)",
    "step": " (Step > Use as reference step)",
}
QUANTITIES: Mapping[Quantity, QuantitySpec] = {
    name: replace(spec, needs=spec.needs + _WHERE.get(name, "")) for name, spec in _QUANTITIES.items()
}


@dataclass(frozen=True)
class ColorPolicy:
    """How the meshes are coloured.

    Attributes:
        quantity: key of :data:`QUANTITIES`.
        range: limits from the shown ``step``, from every snapshot of the ``run``, or ``locked`` where they are.
        unit: ``edges`` (mean edge lengths of the input), ``file`` (units of the file), or ``diagonal`` (per cent of the
            diagonal of the bounding box).
        outliers: whether the range covers every vertex, instead of :data:`PERCENTILE` per cent of them.
    """

    quantity: Quantity = "magnitude"
    range: RangePolicy = "step"
    unit: Unit = "edges"
    outliers: bool = False

    @property
    def percentile(self) -> float:
        """How many per cent of the vertices the range covers."""
        return 100.0 if self.outliers else PERCENTILE


@dataclass(frozen=True, eq=False)
class Histogram:
    """How the values are spread over the range of the colours.

    Attributes:
        counts: how many vertices of the shown prediction fall into each of equally wide bins, (n,).
        others: the same for the input, (n,); None without a prediction beside it.
        share_outside: share of the vertices of the shown prediction beyond the range, 0 to 1.
    """

    counts: NDArray[np.int64]
    others: NDArray[np.int64] | None
    share_outside: float


def histogram(values: Values, others: Values | None, limits: Limits, bins: int = 64) -> Histogram:
    """Count values, (V,), in equal parts of the range; those that are no number count nowhere."""
    finite = values[np.isfinite(values)]
    counts = np.histogram(finite, bins, (limits.low, limits.high))[0]
    outside = 1.0 - counts.sum() / len(finite) if len(finite) else 0.0
    compared = None
    if others is not None:
        compared = np.histogram(others[np.isfinite(others)], bins, (limits.low, limits.high))[0]
    return Histogram(counts, compared, float(outside))


def color_table(quantity: Quantity) -> ColorTable:
    """Return the colour map of a quantity as (256, 4) RGBA: viridis, or blue over light grey to red for signed values."""
    import pyqtgraph

    name = "CET-D1A" if QUANTITIES[quantity].is_signed else "viridis"
    return np.asarray(pyqtgraph.colormap.get(name).getLookupTable(0.0, 1.0, 256, alpha=True, mode="byte"), dtype=np.uint8)
