"""Run a filter on any triangle mesh, whatever its units, its place and its unused vertices."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from dmp.filters.averaging import taubin, uniform_laplacian
from dmp.filters.bilateral import bilateral_normal
from dmp.filters.catalogue import Filter, Value, filter_named
from dmp.filters.guided import guided_normal
from dmp.filters.of_meshlab import hc_laplacian, two_step
from dmp.geometry import mean_edge_length
from dmp.mesh import FloatArray, TriangleMesh
from dmp.topology import connected_vertices, proper_faces, unique_edges

# Each takes a mesh, ascending counts and the other parameters by name, and yields vertices for each count.
_RUN: Mapping[str, Callable[..., Iterator[FloatArray]]] = {
    "laplacian": uniform_laplacian,
    "taubin": taubin,
    "bilateral_normal": bilateral_normal,
    "guided_normal": guided_normal,
    "hc_laplacian": hc_laplacian,
    "two_step": two_step,
}


def filtered(mesh: TriangleMesh, name: str, **parameters: Any) -> FloatArray:
    """Return the vertices of ``mesh`` after the filter ``name``, (V, 3) float64, in the units of the mesh.

    Vertices without a neighbour are returned as they are. The mesh may be open, of several pieces, not manifold, and have
    faces without area; faces that name a vertex twice are overlooked.

    Args:
        mesh: the input.
        name: one of :data:`dmp.filters.FILTERS`.
        parameters: those of the filter; defaults where not named.

    Raises:
        SettingsError: when there is no such filter or parameter, or a value is outside its range.
        MeshError: when a filter of MeshLab fails (see :func:`dmp.meshlab.run_filters`).
    """
    chosen = filter_named(name)
    values = chosen.checked(parameters)
    count = int(values.pop(chosen.count.name))
    return next(results(mesh, chosen, [count], values))


def results(mesh: TriangleMesh, chosen: Filter, counts: Sequence[int], others: Mapping[str, Value]) -> Iterator[FloatArray]:
    """Yield the filtered vertices (V, 3) for each of the ascending ``counts``, all from one run.

    Args:
        mesh: the input.
        chosen: the filter.
        counts: values of ``chosen.count``.
        others: all other parameters, checked.

    Raises:
        MeshError: as for :func:`filtered`.
    """
    used = np.flatnonzero(connected_vertices(mesh.faces, mesh.n_vertices))
    edges = unique_edges(mesh.faces)
    edge_length = mean_edge_length(mesh.vertices, edges) if len(edges) else 0.0
    if edge_length == 0:
        for _ in counts:
            yield mesh.vertices.copy()
        return
    # Around the centre and in mean edge lengths, so that a mesh far from the origin or of tiny units loses no digits.
    centre = mesh.vertices[used].mean(axis=0)
    inner = TriangleMesh((mesh.vertices[used] - centre) / edge_length, np.searchsorted(used, proper_faces(mesh.faces)))
    for count, positions in zip(counts, _RUN[chosen.name](inner, counts, **others), strict=True):
        output = mesh.vertices.copy()
        if count:
            output[used] = positions * edge_length + centre
        yield output
