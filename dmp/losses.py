"""The terms of the loss, one function each (paper, section 3, equations of E and E_lap)."""

from __future__ import annotations

import torch
from torch import Tensor

from dmp.operators import symmetric_product
from dmp.settings import LaplacianForm

# Keeps the gradient of the root finite where a residual is exactly 0; the value of the authors' code in its newest state.
EPSILON = 1e-12


def _mean_norm(vectors: Tensor, epsilon: float = EPSILON) -> Tensor:
    return torch.sqrt(vectors.square().sum(dim=1) + epsilon).mean()


def data_loss(predicted: Tensor, target: Tensor, fitted: Tensor | None = None) -> Tensor:
    """E: mean over the fitted vertices of || y_i - q_i ||, the norm itself and not its square.

    The paper sums over vertices, its code takes the mean; the mean makes the weight of the Laplacian term independent
    of the size of the mesh.

    Args:
        predicted: q, (V, 3).
        target: y, (V, 3).
        fitted: indices of the vertices that count, (N,) int64; None for all.
    """
    residual = predicted - target
    return _mean_norm(residual if fitted is None else residual.index_select(0, fitted))


def laplacian_loss(
    predicted: Tensor, adjacency: Tensor, valence: Tensor, form: LaplacianForm = "mean", epsilon: float = EPSILON
) -> Tensor:
    """E_lap: mean over all vertices of the norm of the uniform Laplacian of the prediction.

    ``"mean"``: || q_i - (1/|N(i)|) sum over N(i) of q_j ||, the authors' code. ``"sum"``: || |N(i)| q_i - sum of q_j ||,
    the paper's text. At valence 6, 0.2 times the second is about 1.2 times the first.

    Args:
        predicted: q, (V, 3).
        adjacency: A, (V, V), symmetric CSR.
        valence: |N(i)|, (V, 1), at least 1.
        form: which of the two.
        epsilon: added to the squared length before the root; 1e-6 in the authors' code of April 2021, which in a unit box is a
            floor of a thousandth under each length.
    """
    neighbour_sum = symmetric_product(adjacency, predicted)
    if form == "mean":
        return _mean_norm(predicted - neighbour_sum / valence, epsilon)
    return _mean_norm(valence * predicted - neighbour_sum, epsilon)
