"""What a colour on a mesh means: the quantity, its unit, its range and its colour map. No widgets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dmp.mesh import FloatArray

Quantity = Literal["magnitude", "signed", "plain"]
RangePolicy = Literal["step", "run"]
Unit = Literal["edges", "file"]
UpAxis = Literal["y", "z"]

Values = NDArray[np.float32]
ColorTable = NDArray[np.uint8]

# A few vertices far off would otherwise take the whole scale for themselves.
PERCENTILE = 98.0


@dataclass(frozen=True)
class ColorPolicy:
    """How the meshes are coloured.

    Attributes:
        quantity: ``magnitude`` of the displacement from the smoothed mesh, the same ``signed`` along the smoothed mesh's
            normal, or ``plain`` shading.
        range: limits from the shown ``step``, or from every snapshot of the ``run``.
        unit: ``edges`` (mean edge lengths of the input) or ``file`` (units of the file).
    """

    quantity: Quantity = "magnitude"
    range: RangePolicy = "step"
    unit: Unit = "edges"


@dataclass(frozen=True)
class Limits:
    """The values at both ends of the colour bar."""

    low: float
    high: float


def displacement_values(positions: FloatArray, base: FloatArray, normals: FloatArray, quantity: Quantity) -> Values:
    """Return the coloured value of each vertex, (V,) float32, in file units.

    Args:
        positions: (V, 3), file units.
        base: smoothed positions, (V, 3), file units.
        normals: unit normals of the smoothed mesh, (V, 3).
        quantity: which value; ``plain`` gives the magnitude, which is then not shown.
    """
    displacement = positions - base
    if quantity == "signed":
        return np.einsum("vc,vc->v", displacement, normals).astype(np.float32)
    return np.linalg.norm(displacement, axis=1).astype(np.float32)


def extent(values: Values) -> float:
    """Return the size below which :data:`PERCENTILE` per cent of the values lie, whatever their sign."""
    return float(np.percentile(np.abs(values), PERCENTILE)) if len(values) else 0.0


def limits_for(quantity: Quantity, extents: list[float]) -> Limits:
    """Return one range for all panes: from 0 for magnitudes, symmetric about 0 for signed values."""
    high = max([size for size in extents if np.isfinite(size)], default=0.0)
    if high <= 0:
        high = 1.0
    return Limits(-high if quantity == "signed" else 0.0, high)


def color_table(quantity: Quantity) -> ColorTable:
    """Return the colour map of a quantity as (256, 4) RGBA: viridis, or blue over light grey to red for signed values."""
    import pyqtgraph

    name = "CET-D1A" if quantity == "signed" else "viridis"
    return np.asarray(pyqtgraph.colormap.get(name).getLookupTable(0.0, 1.0, 256, alpha=True, mode="byte"), dtype=np.uint8)


def nice_ticks(low: float, high: float, most: int) -> list[float]:
    """Return round numbers between ``low`` and ``high``, at most ``most`` of them."""
    span = high - low
    if not np.isfinite(span) or span <= 0 or most < 2:
        return [low]
    power = 10.0 ** np.floor(np.log10(span / most))
    for factor in (1, 2, 2.5, 5, 10, 20):
        step = factor * power
        first = np.ceil(low / step - 1e-9)
        last = np.floor(high / step + 1e-9)
        if last - first + 1 <= most:
            return [float(step * number) for number in np.arange(first, last + 1)]
    return [low, high]
