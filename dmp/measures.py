"""What is measured of a prediction at each logged step."""

from __future__ import annotations

import numpy as np

from dmp.geometry import vertex_normals
from dmp.mesh import FloatArray, IntArray
from dmp.problem import Problem


class Measures:
    """Distances of a prediction, in mean edge lengths of the input, and its distance from the ground truth if there is one.

    Called with predicted positions, (V, 3), file units, it returns the metrics that :class:`dmp.snapshot.StepRecord` names.
    """

    def __init__(self, problem: Problem, held_out: IntArray) -> None:
        self._problem = problem
        self._held_out = held_out
        # Of the smoothed mesh: the noise has hardly touched these, so an error along them is an error of the shape.
        self._normals = vertex_normals(problem.base, problem.mesh.faces)[held_out]

    def __call__(self, vertices: FloatArray) -> dict[str, float]:
        """Return the metrics of predicted positions, (V, 3), file units."""
        problem = self._problem
        residual = vertices - problem.target
        values = {
            "displacement": float(np.linalg.norm(vertices - problem.base, axis=1).mean()) / problem.edge_length,
            "input_distance": float(np.linalg.norm(residual[problem.known], axis=1).mean()) / problem.edge_length,
        }
        if len(self._held_out):
            hidden = residual[self._held_out]
            along = np.abs(np.einsum("vc,vc->v", hidden, self._normals))
            values["held_out_error"] = float(np.linalg.norm(hidden, axis=1).mean()) / problem.edge_length
            values["held_out_normal_error"] = float(along.mean()) / problem.edge_length
        if problem.ground_truth is not None:
            values.update(problem.ground_truth.measures(vertices))
        return values
