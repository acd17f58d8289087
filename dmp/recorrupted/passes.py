"""Repeated passes over normals and over vertices: the inner loop of the network.

Compiled kernels take them on the processor in float32, operations of torch elsewhere; both compute the same up to rounding.
"""

from __future__ import annotations

from torch import Tensor

from dmp.recorrupted import compiled_passes, torch_passes
from dmp.recorrupted.products import Incidence


def average_normals(own: Tensor, weights: Tensor, normals: Tensor, incidence: Incidence, passes: int) -> Tensor:
    """Replace each normal, ``passes`` times, by the unit vector along the weighted sum of itself and its neighbours.

    Where they cancel each other to less than a tenth, the result is shorter than a unit vector.

    Args:
        own: weights of the faces themselves, (F,).
        weights: weights of the faces in the slots, with the sign of their orientation and 0 in empty ones, (3, F).
        normals: unit normals, (F, 3).
        incidence: of the mesh.
        passes: how often.
    """
    function = compiled_passes.NormalPasses if compiled_passes.serve(own) else torch_passes.NormalPasses
    return function.apply(own, weights, normals, incidence, passes)  # type: ignore[no-untyped-call]


def follow_normals(positions: Tensor, normals: Tensor, gates: Tensor, incidence: Incidence, passes: int) -> Tensor:
    """Move each vertex, ``passes`` times, by the mean over its faces of g_f n_f (n_f . (c_f - x)), c_f the centroid.

    The vertex update of Sun et al. ("Fast and effective feature-preserving mesh denoising", 2007) with a gate a face.

    Args:
        positions: (V, 3).
        normals: unit normals that the faces shall have, (F, 3).
        gates: g, (F,), 0 to 1.
        incidence: of the mesh.
        passes: how often.
    """
    function = compiled_passes.VertexPasses if compiled_passes.serve(positions) else torch_passes.VertexPasses
    return function.apply(positions, normals, gates, incidence, passes)  # type: ignore[no-untyped-call]
