"""What a colour on a mesh can mean: the quantity, its unit, its range, its colour map and round numbers beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Quantity = Literal["magnitude", "signed", "input_distance", "error", "normal_error", "step", "curvature", "normals", "plain"]
Unit = Literal["edges", "file", "diagonal"]
Kind = Literal["length", "angle", "curvature", "direction", "none"]

Values = NDArray[np.float32]
ColorTable = NDArray[np.uint8]


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
        "Error: distance", "How far each vertex lies from the ground truth.", needs="a ground truth"
    ),
    "normal_error": QuantitySpec(
        "Error: angle", "The angle between the surface and the ground truth; its mean over the faces is the MAD.", "angle",
        needs="a ground truth with the same faces",
    ),
    "step": QuantitySpec(
        "Distance from a step", "How far each vertex lies from its place at the reference step.",
        needs="a reference step",
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
class Limits:
    """The values at both ends of the colour bar."""

    low: float
    high: float


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


def tick_text(value: float, step: float) -> str:
    """Return a tick's number with as many digits as its step needs."""
    if value == 0:
        return "0"
    if abs(value) >= 1e5 or abs(step) < 1e-4:
        return f"{value:.2g}".replace("-", "−")
    decimals = max(0, -int(np.floor(np.log10(abs(step)) + 1e-9)))
    if round(step, decimals) != round(step, 10):
        decimals += 1
    return f"{value:.{decimals}f}".replace("-", "−")
