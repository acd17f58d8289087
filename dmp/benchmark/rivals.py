"""The published network written with torch_geometric, and its training step."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from dmp.devices import choose_device
from dmp.errors import SettingsError
from dmp.network import LAYOUTS
from dmp.operators import normalised_adjacency, to_torch
from dmp.problem import Problem
from dmp.settings import Settings
from dmp.topology import unique_edges

EDGE_INDEX, SPARSE = "torch_geometric, edge_index", "torch_geometric, sparse adjacency"


class _PeerNetwork(nn.Module):
    def __init__(self, convolution: Any, sizes: tuple[int, ...], hidden: int, **options: Any) -> None:
        super().__init__()
        self.convolutions = nn.ModuleList(convolution(i, o, **options) for i, o in pairwise(sizes))
        self.normalisations = nn.ModuleList(nn.BatchNorm1d(width) for width in sizes[1:])
        self.hidden = nn.Linear(sizes[-1], hidden)
        self.output = nn.Linear(hidden, 3)

    def forward(self, features: Tensor, graph: Tensor) -> Tensor:
        for convolution, normalisation in zip(self.convolutions, self.normalisations, strict=True):
            features = functional.leaky_relu(normalisation(convolution(features, graph)), 0.01)
        return self.output(functional.leaky_relu(self.hidden(features), 0.01))


def peer_steps(problem: Problem, settings: Settings) -> dict[str, Callable[[], Tensor]]:
    """Return by name what does one whole training step (forward, loss, backward, Adam) with torch_geometric's ``GCNConv``.

    One form is given edges, as most programs do; the other the normalised adjacency as a sparse matrix, which is that
    library's fastest.

    Raises:
        SettingsError: when torch_geometric is not installed.
    """
    try:
        from torch_geometric.nn import GCNConv
    except ImportError as error:
        raise SettingsError(
            "The benchmark compares with torch_geometric. Install it with: pip install torch_geometric, or use --no-rivals."
        ) from error
    mesh = problem.mesh
    layout = LAYOUTS[settings.architecture].divided(settings.width_divisor)
    sizes = (settings.input_channels, *layout.widths)
    edges = torch.from_numpy(unique_edges(mesh.faces).T.copy())
    edge_index = torch.cat([edges, edges.flip(0)], dim=1)
    device = choose_device(settings.device)
    edge_index, matrix = edge_index.to(device), to_torch(normalised_adjacency(mesh.faces, mesh.n_vertices), device)
    return {
        EDGE_INDEX: _peer_step(_PeerNetwork(GCNConv, sizes, layout.hidden), edge_index, edge_index, problem, settings),
        SPARSE: _peer_step(_PeerNetwork(GCNConv, sizes, layout.hidden, normalize=False), matrix, edge_index, problem, settings),
    }


def _peer_step(
    model: nn.Module, graph: Tensor, edge_index: Tensor, problem: Problem, settings: Settings
) -> Callable[[], Tensor]:
    n_vertices = problem.mesh.n_vertices
    device = edge_index.device
    model.to(device)
    optimiser = torch.optim.Adam(model.parameters(), lr=settings.learning_rate)
    valence = torch.bincount(edge_index[1], minlength=n_vertices).clamp_min(1)[:, None]
    base = torch.from_numpy(problem.to_training_units(problem.base)).to(device, torch.float32)
    target = torch.from_numpy(problem.to_training_units(problem.target)).to(device, torch.float32)
    features = torch.randn(n_vertices, settings.input_channels).to(device)

    def step() -> Tensor:
        output = base + model(features, graph)
        neighbour_sum = torch.zeros_like(output).index_add(0, edge_index[1], output[edge_index[0]])
        data = torch.sqrt((output - target).square().sum(dim=1) + 1e-12).mean()
        smoothness = torch.sqrt((output - neighbour_sum / valence).square().sum(dim=1) + 1e-12).mean()
        optimiser.zero_grad()
        loss = data + settings.laplacian_weight * smoothness
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        return loss.detach()

    return step
