from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional
from torch_geometric.nn import GCNConv

from dmp.layers import graph_for
from dmp.mesh import TriangleMesh
from dmp.network import LAYOUTS, DisplacementNetwork, skip_sources
from dmp.settings import settings_for
from dmp.topology import unique_edges


def _n_parameters(network: nn.Module) -> int:
    return sum(parameter.numel() for parameter in network.parameters())


@pytest.mark.parametrize(("architecture", "count"), [("2024-06", 751_075), ("2021-04", 747_299)])
def test_both_published_networks_have_their_number_of_parameters(architecture: str, count: int) -> None:
    layout = LAYOUTS[architecture]  # type: ignore[index]
    assert _n_parameters(DisplacementNetwork(16, layout.widths, layout.hidden)) == count


def test_divided_layouts_keep_sixteen_channels() -> None:
    divided = LAYOUTS["2021-04"].divided(8)
    assert divided.widths == (16, 16, 16, 32, 32, 64, 64, 32, 32, 16)
    assert divided.hidden == 16
    assert LAYOUTS["2024-06"].divided(2).widths[5:8] == (256, 256, 128)


def test_skip_connections_mirror_the_layers() -> None:
    # Numbered from 1: layers 8 to 13 take the outputs of 6 to 1; layer 7 has that of 6 anyway.
    assert skip_sources(13) == (*(None,) * 7, 5, 4, 3, 2, 1, 0)
    assert skip_sources(10) == (*(None,) * 6, 3, 2, 1, 0)
    assert skip_sources(2) == (None, None)


class _PublishedSkipNetwork(nn.Module):
    """The U-shaped network written out with another library's layers."""

    def __init__(self, widths: tuple[int, ...]) -> None:
        super().__init__()
        inputs = [16, *widths[:6]]
        inputs += [widths[6 + k] + widths[5 - k] for k in range(6)]
        self.convolutions = nn.ModuleList(GCNConv(i, o) for i, o in zip(inputs, widths, strict=True))
        self.normalisations = nn.ModuleList(nn.BatchNorm1d(width) for width in widths)
        self.output = nn.Linear(widths[-1], 3)

    def forward(self, features: Tensor, edge_index: Tensor) -> Tensor:
        kept: list[Tensor] = []
        for number in range(1, 14):
            if number >= 8:
                features = torch.cat([features, kept[13 - number]], dim=1)
            features = self.convolutions[number - 1](features, edge_index)
            features = functional.leaky_relu(self.normalisations[number - 1](features))
            kept.append(features)
        return self.output(features)


def test_skip_network_equals_the_one_written_out(sphere: TriangleMesh) -> None:
    widths = LAYOUTS["2024-06"].divided(8).widths
    ours, theirs = DisplacementNetwork(16, widths, skip=True), _PublishedSkipNetwork(widths)
    # Depth and batch normalisation blow rounding up; in double precision the two can be told apart from two that differ.
    ours, theirs = ours.double(), theirs.double()
    with torch.no_grad():
        for mine, other in zip(ours.convolutions, theirs.convolutions, strict=True):
            other.lin.weight.copy_(mine.weight.T)
        theirs.output.load_state_dict(ours.output.state_dict())
    edges = torch.from_numpy(unique_edges(sphere.faces).T.copy())
    features = torch.randn(sphere.n_vertices, 16, dtype=torch.float64)
    graph = graph_for(settings_for(), sphere.faces, sphere.vertices)
    assert isinstance(graph, Tensor)
    left, right = ours(features, graph.to(torch.float64)), theirs(features, torch.cat([edges, edges.flip(0)], dim=1))
    assert torch.allclose(left, right, atol=1e-5)


def test_skip_network_of_full_width_has_one_linear_layer() -> None:
    widths = LAYOUTS["2024-06"].widths
    network = DisplacementNetwork(16, widths, skip=True)
    inputs = [16, 32, 64, 128, 256, 256, 512, 512 + 512, 256 + 256, 256 + 256, 128 + 128, 64 + 64, 32 + 32]
    assert _n_parameters(network) == sum(i * o + 3 * o for i, o in zip(inputs, widths, strict=True)) + 32 * 3 + 3
    assert [module for module in network.modules() if isinstance(module, nn.Linear)] == [network.output]
