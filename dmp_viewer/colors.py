"""What a colour on a mesh means: the quantity, its unit, its range and its colour map. No widgets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dmp.vertex_measures import ROBUST_PERCENTILE

Quantity = Literal["magnitude", "signed", "input_distance", "error", "normal_error", "step", "curvature", "normals", "plain"]
RangePolicy = Literal["step", "run", "locked"]
Unit = Literal["edges", "file", "diagonal"]
UpAxis = Literal["y", "z"]
Kind = Literal["length", "angle", "curvature", "direction", "none"]

Values = NDArray[np.float32]
ColorTable = NDArray[np.uint8]

PERCENTILE = ROBUST_PERCENTILE


@dataclass(frozen=True)
class QuantitySpec:
    """One thing that can be shown as colours.

    Attributes:
        label: its name in lists.
        help: what it means, one sentence.
        kind: what it is measured in.
        is_signed: whether values below and above 0 mean different things.
        needs: what is missing when it cannot be shown, as the end of "Needs …"; empty when it always can.
    """

    label: str
    help: str
    kind: Kind = "length"
    is_signed: bool = False
    needs: str = ""


QUANTITIES: Mapping[Quantity, QuantitySpec] = {
    "magnitude": QuantitySpec("Displacement", "How far each vertex lies from the smoothed mesh."),
    "signed": QuantitySpec(
        "Signed displacement", "The displacement along the normal of the smoothed mesh: inwards blue, outwards red.",
        is_signed=True,
    ),
    "input_distance": QuantitySpec("Distance from input", "How far each vertex was moved away from the input."),
    "error": QuantitySpec(
        "Error: distance", "How far each vertex lies from the ground truth.", needs="a ground truth (File > Open ground truth)"
    ),
    "normal_error": QuantitySpec(
        "Error: angle", "The angle between the surface and the ground truth; its mean over the faces is the MAD.", "angle",
        needs="a ground truth with the same faces (File > Open ground truth)",
    ),
    "step": QuantitySpec(
        "Distance from a step", "How far each vertex lies from its place at the reference step.",
        needs="a reference step (Step > Use as reference step)",
    ),
    "curvature": QuantitySpec(
        "Mean curvature", "How the surface bends: hollow blue, bulging red. Noise shows as speckles.", "curvature",
        is_signed=True,
    ),
    "normals": QuantitySpec(
        "Normals", "The direction of the surface as a colour, which makes the slightest roughness visible.", "direction"
    ),
    "plain": QuantitySpec("Plain", "The bare surface without colours.", "none"),
}  # fmt: skip


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


@dataclass(frozen=True)
class Limits:
    """The values at both ends of the colour bar."""

    low: float
    high: float


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


def limits_for(quantity: Quantity, extents: list[float]) -> Limits:
    """Return one range for all panes: from 0 for sizes, symmetric about 0 for signed values."""
    high = max([size for size in extents if np.isfinite(size)], default=0.0)
    if high <= 0:
        high = 1.0
    return Limits(-high if QUANTITIES[quantity].is_signed else 0.0, high)


def unit_of(kind: Kind, unit: Unit, edge_length: float, diagonal: float) -> tuple[float, str]:
    """Return by what a value in file units is multiplied for the colour bar, and the name of the unit.

    Args:
        kind: what the value is.
        unit: the wanted unit of length.
        edge_length: mean edge length, file units.
        diagonal: diagonal of the bounding box, file units.
    """
    if kind == "angle":
        return 1.0, "degrees"
    length = {"edges": edge_length, "file": 1.0, "diagonal": diagonal / 100.0}[unit]
    if kind == "curvature":
        return length, {"edges": "per edge length", "file": "per file unit", "diagonal": "per % of diagonal"}[unit]
    return 1.0 / length, {"edges": "edge lengths", "file": "file units", "diagonal": "% of diagonal"}[unit]


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
