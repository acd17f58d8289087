"""The best parameters of a filter for one mesh, found with the ground truth, as published comparisons choose them.

Nobody has the ground truth of a scan: a tuned filter is a rival that knows more than it could.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from dmp.errors import MeshError, SettingsError
from dmp.filters.catalogue import FILTERS, Value, filter_named
from dmp.filters.running import results
from dmp.mesh import FloatArray, TriangleMesh
from dmp.metrics import GroundTruth

Measure = Literal["mad", "vertex_error"]

# So many counts in a row, each worse than the one before, and larger ones are not tried: filters that have begun to
# destroy a shape go on doing so.
_PATIENCE = 4


@dataclass(frozen=True, eq=False)
class TunedFilter:
    """A filter with the parameters that came closest to the ground truth.

    Attributes:
        name: of the filter.
        parameters: all of them; a count of 0 stands for the input, where no other result is closer.
        vertices: the result, (V, 3), in the units of the mesh.
        mad: its mean angular difference to the ground truth, degrees.
        vertex_error: its mean vertex distance, in mean edge lengths of the ground truth.
        n_tried: number of results that were compared.
    """

    name: str
    parameters: Mapping[str, Value]
    vertices: FloatArray
    mad: float
    vertex_error: float
    n_tried: int


def tuned(mesh: TriangleMesh, truth: GroundTruth, name: str, *, measure: Measure = "mad") -> TunedFilter:
    """Return the best result of a filter over its grid of parameters; the default ones and the input are always among them.

    All counts of steps or iterations are recorded on one run for each combination of the other parameters. The run ends
    early when four counts in a row were each worse than the one before, unless the other parameters are the default ones.

    Args:
        mesh: the input.
        truth: what to compare with, aligned to ``mesh``.
        name: one of :data:`dmp.filters.FILTERS`.
        measure: which of the two measures to make small; of equal ones the first in the order of the grid is kept.

    Raises:
        SettingsError: when there is no such filter or measure.
        MeshError: when a filter of MeshLab fails (see :func:`dmp.meshlab.run_filters`).
    """
    chosen = filter_named(name)
    if measure not in get_args(Measure):
        raise SettingsError(f"A filter can be tuned by {' or '.join(get_args(Measure))}, not by '{measure}'.")
    counts = [int(count) for count in chosen.count.grid]
    others = chosen.parameters[1:]
    best: TunedFilter | None = None
    n_tried = 0
    for values in itertools.product(*(parameter.grid for parameter in others)):
        named = dict(zip((parameter.name for parameter in others), values, strict=True))
        is_default = all(named[parameter.name] == parameter.default for parameter in others)
        before, n_worse = math.inf, 0
        for count, vertices in zip(counts, results(mesh, chosen, counts, named), strict=False):
            n_tried += 1
            measures = truth.measures(vertices)
            if best is None or measures[measure] < getattr(best, measure):
                best = TunedFilter(name, {chosen.count.name: count, **named}, vertices, **measures, n_tried=0)
            n_worse = n_worse + 1 if measures[measure] > before else 0
            before = measures[measure]
            if n_worse == _PATIENCE and not is_default:
                break
    assert best is not None  # a grid is never empty
    return TunedFilter(name, best.parameters, best.vertices, best.mad, best.vertex_error, n_tried)


def best_tuned(
    mesh: TriangleMesh, truth: GroundTruth, names: Sequence[str] | None = None, *, measure: Measure = "mad"
) -> list[TunedFilter]:
    """Return the tuned filters, the best first.

    Args:
        mesh: the input.
        truth: what to compare with, aligned to ``mesh``.
        names: which filters; by default all, without those of MeshLab that fail on this mesh.
        measure: as for :func:`tuned`.

    Raises:
        SettingsError: as for :func:`tuned`.
        MeshError: when a filter of MeshLab fails that was named.
    """
    found = []
    for name in FILTERS if names is None else names:
        try:
            found.append(tuned(mesh, truth, name, measure=measure))
        except MeshError:
            if names is not None or not FILTERS[name].needs_meshlab:
                raise
    return sorted(found, key=lambda result: float(getattr(result, measure)))
