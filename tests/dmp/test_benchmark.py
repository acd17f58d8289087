"""What ``dmp benchmark`` times is the same work: the rivals compute what this program computes."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from torch import nn

from dmp.benchmark.floors import least_traffic, matrix_products
from dmp.benchmark.meshes import noisy_torus
from dmp.benchmark.preparing import time_preparation
from dmp.benchmark.rivals import _PeerNetwork, peer_steps
from dmp.benchmark.steps import steps_text, time_steps
from dmp.benchmark.timing import take_turns
from dmp.commands.measuring import benchmark
from dmp.errors import SettingsError
from dmp.layers import graph_for
from dmp.network import LAYOUTS, DisplacementNetwork
from dmp.problem import denoising
from dmp.settings import settings_for
from dmp.topology import adjacency, unique_edges


def test_made_meshes_are_closed_with_six_neighbours_each() -> None:
    for shuffled in (True, False):
        mesh = noisy_torus(1200, shuffled=shuffled)
        assert abs(mesh.n_vertices - 1200) < 60
        assert mesh.n_faces == 2 * mesh.n_vertices
        assert np.all(adjacency(mesh.faces, mesh.n_vertices).sum(axis=1) == 6)


def test_both_forms_of_the_rival_compute_what_our_network_computes() -> None:
    from torch_geometric.nn import GCNConv

    mesh = noisy_torus(300)
    settings = settings_for("denoise", "compact")
    layout = LAYOUTS["2024-06"].divided(settings.width_divisor)
    ours = DisplacementNetwork(16, layout.widths, layout.hidden).double()
    edges = torch.from_numpy(unique_edges(mesh.faces).T.copy())
    graph = graph_for(settings, mesh.faces, mesh.vertices)
    assert isinstance(graph, torch.Tensor)
    features = torch.randn(mesh.n_vertices, 16, dtype=torch.float64)
    expected = ours(features, graph.double())
    for given, options in ((torch.cat([edges, edges.flip(0)], dim=1), {}), (graph.double(), {"normalize": False})):
        theirs = _PeerNetwork(GCNConv, (16, *layout.widths), layout.hidden, **options).double()
        with torch.no_grad():
            for mine, other in zip(ours.convolutions, theirs.convolutions, strict=True):
                other.lin.weight.copy_(mine.weight.T)
            theirs.hidden.load_state_dict(ours.hidden.state_dict() if isinstance(ours.hidden, nn.Linear) else {})
            theirs.output.load_state_dict(ours.output.state_dict())
        assert torch.allclose(theirs(features, given), expected, atol=1e-5)


def test_steps_of_the_rivals_train() -> None:
    settings = settings_for("denoise", "compact", device="cpu")
    for step in peer_steps(denoising(noisy_torus(300), settings), settings).values():
        losses = [float(step()) for _ in range(12)]
        assert losses[-1] < losses[0]


def test_floors_count_what_their_definitions_say() -> None:
    # One layer from 2 to 5 channels: 3 * 2 + 7 * 5 values a vertex.
    assert least_traffic(10, (2, 5)) == 10 * 41 * 4
    with torch.profiler.profile() as profile:
        matrix_products(10, (2, 5, 3))()
    assert sum(event.count for event in profile.key_averages() if event.key == "aten::mm") == 6


def test_all_take_turns_and_the_first_round_does_not_count() -> None:
    order: list[str] = []
    timings = take_turns({name: lambda name=name: order.append(name) for name in "ab"}, rounds=3)
    assert order == ["a", "b"] * 4
    assert all(timing.seconds > 0 for timing in timings.values())


def test_a_small_benchmark_reports_everyone() -> None:
    values = time_steps(noisy_torus(200), "compact", rounds=1, threads=1)
    assert {"dmp, float32", "torch_geometric, edge_index", "matrix products alone, float32"} <= values["seconds"].keys()
    assert values["ratios"]["torch_geometric, edge_index"] == pytest.approx(
        values["processor_seconds"]["dmp, float32"] / values["processor_seconds"]["torch_geometric, edge_index"]
    )
    text = steps_text(values)
    assert all(name in text for name in values["seconds"])


def test_parts_of_the_preparation_are_timed_apart() -> None:
    parts = time_preparation(noisy_torus(200), "compact")
    assert list(parts) == ["import", "writing", "reading", "checking", "smoothing", "operators"]
    assert all(seconds > 0 for seconds in parts.values())


def test_the_command_prints_json_and_refuses_what_it_does_not_know(capsys: pytest.CaptureFixture[str]) -> None:
    assert benchmark(sizes=[200], presets=["compact"], rounds=1, threads=1, rivals=False, json=True) == 0
    values = json.loads(capsys.readouterr().out)
    assert [item["preset"] for item in values] == ["compact"]
    assert "torch_geometric, edge_index" not in values[0]["seconds"]
    with pytest.raises(SettingsError, match="compact, paper, best"):
        benchmark(presets=["fastest"])
    with pytest.raises(SettingsError, match="--rounds"):
        benchmark(rounds=0)
