"""What is measured in the course of a training, as it is told to a person: labels, help and units."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from dmp.settings import Settings


@dataclass(frozen=True)
class Measure:
    """A column of the curve and how it is told to a person.

    Attributes:
        name: as in :class:`dmp.snapshot.StepRecord`.
        label: short name for the legend.
        help: what it means, one or two sentences.
        unit: ``edges`` (mean edge lengths), ``degrees``, ``training`` (the length that is 1 during training), or ``none``.
        shown: drawn unless the user switches it off.
    """

    name: str
    label: str
    help: str
    unit: str
    shown: bool


MEASURES: tuple[Measure, ...] = (
    Measure("data_loss", "Data loss", "How far the prediction is from the noisy input. It falls as long as training goes on, "
            "first by learning the shape, later by learning the noise.", "training", True),
    Measure("laplacian_loss", "Laplacian loss", "How rough the prediction is: the distance of each vertex from the middle of "
            "its neighbours.", "training", True),
    Measure("position_loss", "Position loss", "How far the prediction is from recorrupted copies of the input.",
            "training", False),
    Measure("normal_loss", "Normal loss", "How far the normals of the prediction are from those of recorrupted copies.",
            "none", False),
    Measure("total_loss", "Total loss", "What the optimiser minimises: the data loss plus λ times the Laplacian loss.",
            "training", False),
    Measure("held_out_error", "Held-out error", "Error on vertices that the training never sees. Where it stops falling, the "
            "network has begun to learn the noise: a good place to keep a step.", "edges", True),
    Measure("held_out_normal_error", "Held-out error, normal", "The same, counted along the surface normal only.",
            "edges", False),
    Measure("held_out_risk", "Held-out risk", "The loss on vertices that the training never sees. Where it begins to rise, the "
            "network has begun to learn the noise.", "none", True),
    Measure("held_out_excess", "Risk above its lowest", "By how many standard errors the held-out risk is above the lowest so "
            "far. From 2 on it has clearly risen, and an earlier step is suggested.", "none", False),
    Measure("held_out_lowest_step", "Step of lowest risk", "Where the held-out risk was lowest so far.", "none", False),
    Measure("displacement", "Displacement", "Mean distance of the prediction from the smoothed mesh.", "edges", False),
    Measure("input_distance", "Distance to input", "Mean distance of the prediction from the input.", "edges", False),
    Measure("vertex_error", "Vertex error", "Mean distance of the vertices from the ground truth.", "edges", False),
    Measure("inserted_movement", "Movement", "How far the inserted vertices still move, as a mean, in edge lengths per 100 "
            "steps. When it comes to rest, the completion is done.", "edges", True),
    Measure("made_up_error", "Error in made-up holes", "Mean error in holes that were made up where the truth is known. It "
            "tells how well the real holes are filled.", "edges", True),
    Measure("hole_distance", "Distance in holes", "Mean distance of the inserted vertices from the true surface.",
            "edges", True),
    Measure("hole_normal_error", "Angle in holes", "Mean angle between the inserted faces and the true surface.",
            "degrees", True),
    Measure("mad", "MAD", "Mean angle between the normals of the prediction and of the ground truth. Lower is better; its "
            "minimum is the best step.", "degrees", True),
)  # fmt: skip

MEASURE_BY_NAME: Mapping[str, Measure] = {measure.name: measure for measure in MEASURES}


def unit_text(unit: str, settings: Settings | None) -> str:
    """Return the unit of a measure in words."""
    if unit in ("degrees", "none"):
        return unit
    if unit == "training" and settings is not None and settings.scaling == "box":
        return "box sizes"
    return "edge lengths"


def axis_text(names: Iterable[str], settings: Settings | None) -> str:
    """Return what an axis with these measures is called: by their unit, or by what they are where that differs."""
    drawn = list(names)
    units = {unit_text(MEASURE_BY_NAME[name].unit, settings) for name in drawn}
    if len(units) == 1 and units != {"none"}:
        return units.pop().capitalize()
    if all(name.endswith("_loss") for name in drawn):
        return "Loss"
    return "Error" if not any(name.endswith("_loss") for name in drawn) else "Loss and error"
