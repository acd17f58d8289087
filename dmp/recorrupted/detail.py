"""Detail that a network takes away along with the noise, and how much of it is given back.

The network is trained on inputs with more noise than the mesh has, so it removes more than it should. If it is a Wiener filter
for a part of the mesh with detail of the variance D, under noise of (1 + a^2) s^2, it leaves G = D / (D + (1 + a^2) s^2) of it;
on the mesh itself, with noise s^2, right would be D / (D + s^2). What is taken away then has to be multiplied by

    beta = (1 + kappa) / (1 + (1 + a^2) kappa),      kappa = G / (1 - G) = <m, l> / <m, m>,

with m what is taken away and l what is left. So how alike these two are tells how much of m is detail, whatever level of noise
was assumed: noise alone is like nothing that is left.
"""

from __future__ import annotations

import torch
from torch import Tensor

from dmp.recorrupted.diffusion import diffused_at
from dmp.recorrupted.network import Operators
from dmp.recorrupted.products import vertex_normals

# Kappa is measured in what so many diffusions leave and so many more take away: of finer parts the network's own filters know
# better, coarser ones are mostly the shape.
_FROM, _TO = 2, 8
# What is given back goes up to waves of this many diffusions; coarser ones are not removed in the first place.
_COARSEST = 30
# Means over the surroundings are taken with so many diffusions.
_SURROUNDINGS = 300
# Edges and large curvature make the two somewhat alike as well: only what is above the first value counts, times the second,
# and along the normal it counts in full where the whole mesh is above the third.
_CLEARLY, _GAIN, _SURE = 0.35, 2.0, 0.5


def given_back(before: Tensor, after: Tensor, operators: Operators, recorruption: float, *, across: bool) -> Tensor:
    """Return the restored positions with the detail that was taken away along with the noise, (V, 3).

    Args:
        before: positions of the input, (V, 3).
        after: what the network makes of them, (V, 3).
        operators: of the mesh.
        recorruption: a, of the noise that the network was trained with.
        across: whether the movement across the normals is corrected too; only where there is noise across them.
    """
    normals = vertex_normals(after, operators.incidence)
    finer, coarser = _edges_of_band(before - after, operators)
    band = finer - coarser
    finer_left, coarser_left = _edges_of_band(after, operators)
    band_left = finer_left - coarser_left
    returned = finer - _diffused(coarser, operators, _COARSEST - _TO)

    band_along, left_along = _along(band, normals), _along(band_left, normals)
    products = band_along * (left_along - left_along.mean())
    squares = band_along.square()
    sure = ((_ratio(products.mean(), squares.mean()) - _CLEARLY) / (_SURE - _CLEARLY)).clamp(0, 1)
    around = _diffused(torch.cat([products, squares], dim=1), operators, _SURROUNDINGS)
    likeness = _ratio(around[:, :1], around[:, 1:])
    returned_along = _along(returned, normals)
    result = after + sure * (1 - _kept(likeness, recorruption)) * returned_along * normals
    if across:
        band_across, left_across = band - band_along * normals, band_left - left_along * normals
        likeness = _ratio((band_across * left_across).sum(), band_across.square().sum())
        result = result + (1 - _kept(likeness, recorruption)) * (returned - returned_along * normals)
    return result


def _kept(likeness: Tensor, recorruption: float) -> Tensor:
    """Return beta, what is right of what is taken away."""
    kappa = (_GAIN * (likeness - _CLEARLY)).clamp_min(0)
    return (1 + kappa) / (1 + (1 + recorruption**2) * kappa)


def _ratio(product: Tensor, square: Tensor) -> Tensor:
    return product / square.clamp_min(torch.finfo(square.dtype).tiny)


def _along(vectors: Tensor, normals: Tensor) -> Tensor:
    return (vectors * normals).sum(dim=1, keepdim=True)


def _edges_of_band(values: Tensor, operators: Operators) -> tuple[Tensor, Tensor]:
    """Return what the first and the last diffusions of the band leave of the values; their difference is the band."""
    finer = _diffused(values, operators, _FROM)
    return finer, _diffused(finer, operators, _TO - _FROM)


def _diffused(values: Tensor, operators: Operators, steps: int) -> Tensor:
    return diffused_at(operators.half_lazy, values, (steps,))[0]
