"""The first half of the network: every vertex mixes a bank of diffusions of the mesh with coefficients that it learns."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from dmp.operators import symmetric_product
from dmp.recorrupted.diffusion import diffused_at
from dmp.recorrupted.products import Incidence, linear_of_both, vertex_normals

# Numbers of half-lazy averaging steps, growing like the Fibonacci numbers: fine where the noise is, coarse beyond.
STEPS = (1, 2, 3, 5, 8, 13, 21)
# The normals that features refer to are those of the mesh after this many steps, one of those above.
_NORMAL_STEPS = 5


def n_features() -> int:
    """Return the number of features of a vertex."""
    return 2 * len(STEPS) + len(STEPS) * (len(STEPS) + 1) // 2


@torch.no_grad()
def diffusions(positions: Tensor, half_lazy: Tensor, incidence: Incidence) -> tuple[Tensor, Tensor]:
    """Return the differences u_k = P^k x - x for k in :data:`STEPS`, (V, K, 3), and unit vertex normals, (V, 3).

    Args:
        positions: x, (V, 3).
        half_lazy: P = (I + D^-1 A) / 2, (V, V) CSR.
        incidence: of the same mesh.
    """
    diffused = diffused_at(half_lazy, positions, STEPS)
    normals = vertex_normals(diffused[STEPS.index(_NORMAL_STEPS)], incidence)
    return (diffused - positions).transpose(0, 1).contiguous(), normals


@torch.no_grad()
def invariants(differences: Tensor, normals: Tensor, level: float) -> tuple[Tensor, Tensor]:
    """Return features that do not change when the mesh is turned or moved, (V, C), and the normal parts u_k . n, (V, K)."""
    along = torch.einsum("vkc,vc->vk", differences, normals)
    rows, columns = torch.triu_indices(len(STEPS), len(STEPS), device=differences.device)
    gram = (differences @ differences.transpose(1, 2))[:, rows, columns] / level**2
    # The logarithm tames the products, which span orders of magnitude between noise and coarse shape.
    return torch.cat([along / level, along.abs() / level, torch.log1p(gram.abs()) * gram.sign()], dim=1), along


class FilterBank(nn.Module):
    """x + sum_k a_k u_k + sum_k b_k (u_k . n) n, with coefficients from graph layers over invariant features.

    Differences and normals turn with the mesh and coefficients do not, so the output turns with it too.
    """

    feature_mean: Tensor
    feature_scale: Tensor

    def __init__(self, width: int = 64, layers: int = 4) -> None:
        super().__init__()
        self.register_buffer("feature_mean", torch.zeros(n_features()))
        self.register_buffer("feature_scale", torch.ones(n_features()))
        self.embed = nn.Linear(n_features(), width)
        self.mix = nn.ModuleList([nn.Linear(2 * width, width) for _ in range(layers)])
        self.norms = nn.ModuleList([nn.LayerNorm(width) for _ in range(layers)])
        self.coefficients = nn.Linear(width, 2 * len(STEPS))
        # Starts as a plain average of 0.7 of the third diffusion everywhere.
        nn.init.zeros_(self.coefficients.weight)
        nn.init.zeros_(self.coefficients.bias)
        with torch.no_grad():
            self.coefficients.bias[2] = 0.7

    def standardise(self, features: Tensor) -> None:
        """Fix the scale of the features by a typical sample of them, (N, C)."""
        self.feature_mean.copy_(features.mean(dim=0))
        self.feature_scale.copy_(features.std(dim=0).clamp_min(1e-6))

    def forward(self, positions: Tensor, half_lazy: Tensor, propagation: Tensor, incidence: Incidence, level: float) -> Tensor:
        """Return filtered positions, (V, 3), for ``positions`` (V, 3)."""
        differences, normals = diffusions(positions, half_lazy, incidence)
        features, along = invariants(differences, normals, level)
        hidden = functional.relu(self.embed((features - self.feature_mean) / self.feature_scale))
        for layer, norm in zip(self.mix, self.norms, strict=True):
            assert isinstance(layer, nn.Linear)
            around = symmetric_product(propagation, hidden)
            hidden = hidden + functional.relu(norm(linear_of_both(layer, hidden, around)))
        mixed = self.coefficients(hidden)
        plain, normal = mixed[:, : len(STEPS), None], mixed[:, len(STEPS) :]
        return positions + (plain * differences).sum(dim=1) + (normal * along).sum(dim=1, keepdim=True) * normals
