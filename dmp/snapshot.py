"""What a training tells whoever watches it: one record a step, and now and then a snapshot of the mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from dmp.mesh import FloatArray, read_only


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The predicted mesh at one step.

    Attributes:
        run_id: identifies the training that made it.
        step: which training step's output this is; 0 is the untrained network.
        vertices: predicted positions, (V, 3) float64, read-only, in the units and place of the file. Double precision,
            because a mesh that lies far from the origin loses its shape in single precision; a run folder keeps the
            displacements from the smoothed mesh instead, for which single precision is ample.
        metrics: losses and metrics by name, as in :class:`StepRecord`.
        seconds: training time until this step, pauses not counted.
    """

    run_id: str
    step: int
    vertices: FloatArray
    metrics: Mapping[str, float] = field(default_factory=dict)
    seconds: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", read_only(self.vertices, np.float64))
        object.__setattr__(self, "metrics", MappingProxyType(dict(self.metrics)))


@dataclass(frozen=True, eq=False)
class StepRecord:
    """One step of a training.

    Attributes:
        step: its number, from 1; 0 stands for the untrained network.
        seconds: training time until this step, pauses not counted.
        metrics: empty except at logged steps. Names: ``data_loss`` and ``laplacian_loss`` (unweighted), ``total_loss``,
            ``displacement`` (mean length, in mean edge lengths), ``input_distance`` (mean distance of the prediction from
            the input, mean edge lengths), ``held_out_error`` and ``held_out_normal_error`` (mean distance, and mean
            distance along the normal, of the hidden vertices from their input positions, mean edge lengths); for a
            completion ``inserted_movement`` (:class:`dmp.rest.RestWatch`); with a ground truth ``mad`` (degrees) and
            ``vertex_error`` (mean edge lengths of the truth), or ``hole_distance`` and ``hole_normal_error``
            (:class:`dmp.hole_metrics.HoleTruth`).
        snapshot: present at step 0, every ``snapshot_every`` steps and at the last step.
    """

    step: int
    seconds: float
    metrics: Mapping[str, float] = field(default_factory=dict)
    snapshot: Snapshot | None = None
