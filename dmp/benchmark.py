"""Seconds per training step beside torch_geometric's GCNConv on the same layers, taking turns in one process."""

from __future__ import annotations

import statistics
import time
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from dmp.devices import available_cores
from dmp.errors import SettingsError
from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.network import PUBLISHED_HIDDEN, scaled_widths
from dmp.problem import denoising
from dmp.settings import settings_for
from dmp.topology import unique_edges


def compare_steps(mesh: TriangleMesh, *, width_divisor: int = 1, rounds: int = 5, threads: int = 0) -> dict[str, Any]:
    """Time whole steps (forward, loss, backward, Adam) of this program and of a torch_geometric model in turns.

    Returns:
        Counts, medians in seconds and the ratio of the medians, ours to theirs.

    Raises:
        SettingsError: when torch_geometric is not installed.
    """
    try:
        from torch_geometric.nn import GCNConv
    except ImportError as error:
        raise SettingsError(
            "The benchmark compares with torch_geometric. Install it with: pip install torch_geometric"
        ) from error
    settings = settings_for("denoise", "paper", threads=threads, width_divisor=width_divisor, device="cpu", steps=10**6,
                            log_every=10**6, snapshot_every=10**6)  # fmt: skip
    problem = denoising(mesh, settings)
    training = training_for(problem, settings)
    ours = training.steps()
    next(ours)  # the untrained network, and the number of threads

    model = _PeerNetwork(GCNConv, settings.input_channels, scaled_widths(width_divisor))
    optimiser = torch.optim.Adam(model.parameters(), lr=settings.learning_rate)
    edges = torch.from_numpy(unique_edges(mesh.faces).T.copy())
    edge_index = torch.cat([edges, edges.flip(0)], dim=1)
    valence = torch.bincount(edge_index[1], minlength=mesh.n_vertices).clamp_min(1)[:, None]
    base = torch.from_numpy(problem.to_training_units(problem.base)).float()
    target = torch.from_numpy(problem.to_training_units(problem.target)).float()
    features = torch.randn(mesh.n_vertices, settings.input_channels)

    def peer_step() -> None:
        output = base + model(features, edge_index)
        neighbour_sum = torch.zeros_like(output).index_add(0, edge_index[1], output[edge_index[0]])
        data = torch.sqrt((output - target).square().sum(dim=1) + 1e-12).mean()
        smoothness = torch.sqrt((output - neighbour_sum / valence).square().sum(dim=1) + 1e-12).mean()
        optimiser.zero_grad()
        (data + settings.laplacian_weight * smoothness).backward()  # type: ignore[no-untyped-call]
        optimiser.step()

    times: dict[str, list[float]] = {"dmp": [], "torch_geometric": []}
    for index in range(rounds + 1):
        for name, step in (("dmp", lambda: next(ours)), ("torch_geometric", peer_step)):
            started = time.perf_counter()
            step()
            if index:  # the first round warms up
                times[name].append(time.perf_counter() - started)
    medians = {name: statistics.median(values) for name, values in times.items()}
    return {
        "vertices": mesh.n_vertices,
        "faces": mesh.n_faces,
        "parameters": training.n_parameters,
        "threads": threads or available_cores(),
        "rounds": rounds,
        "seconds_per_step": medians,
        "ratio": medians["dmp"] / medians["torch_geometric"],
    }


def comparison_text(values: dict[str, Any]) -> str:
    """Return the comparison as lines for people."""
    seconds = values["seconds_per_step"]
    return "\n".join(
        [
            f"{values['vertices']} vertices, {values['parameters']} parameters, {values['threads']} threads, "
            f"median of {values['rounds']} steps taken in turns:",
            f"  dmp                         {seconds['dmp']:.3f} s per step",
            f"  torch_geometric, edge_index {seconds['torch_geometric']:.3f} s per step",
            f"  ratio                       {values['ratio']:.2f}",
        ]
    )


class _PeerNetwork(nn.Module):
    """The published network written with another library's convolution."""

    def __init__(self, convolution: Any, input_channels: int, widths: tuple[int, ...]) -> None:
        super().__init__()
        sizes = (input_channels, *widths)
        self.convolutions = nn.ModuleList(convolution(i, o) for i, o in zip(sizes, widths, strict=False))
        self.normalisations = nn.ModuleList(nn.BatchNorm1d(width) for width in widths)
        self.hidden = nn.Linear(widths[-1], PUBLISHED_HIDDEN)
        self.output = nn.Linear(PUBLISHED_HIDDEN, 3)

    def forward(self, features: Tensor, edge_index: Tensor) -> Tensor:
        for convolution, normalisation in zip(self.convolutions, self.normalisations, strict=True):
            features = functional.leaky_relu(normalisation(convolution(features, edge_index)), 0.01)
        return self.output(functional.leaky_relu(self.hidden(features), 0.01))
