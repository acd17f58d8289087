"""What ``dmp benchmark`` times is the same work: the rivals compute what this program computes."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest
import torch
from torch import nn

from dmp.benchmark import profiling
from dmp.benchmark.floors import least_traffic, matrix_products
from dmp.benchmark.meshes import noisy_torus
from dmp.benchmark.preparing import time_preparation
from dmp.benchmark.profiling import BACKWARD, BANK, BILATERAL, FLATTENING, NETWORK, profile_step, profile_text
from dmp.benchmark.rivals import _PeerNetwork, peer_steps
from dmp.benchmark.settings import for_timing
from dmp.benchmark.steps import steps_text, time_steps
from dmp.benchmark.timing import take_turns
from dmp.commands.measuring import benchmark
from dmp.errors import SettingsError
from dmp.layers import graph_for
from dmp.methods import training_for
from dmp.network import LAYOUTS, DisplacementNetwork
from dmp.problem import denoising
from dmp.settings import settings_for
from dmp.topology import adjacency, unique_edges
from dmp.training import Training


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


def test_what_a_contestant_has_begun_counts_until_it_is_done() -> None:
    order: list[str] = []

    def finish() -> None:
        order.append("finish")
        time.sleep(0.02)

    timings = take_turns({"a": lambda: order.append("a")}, rounds=2, warm_up=3, finish=finish)
    assert order == ["a", "finish"] * 5
    assert timings["a"].seconds >= 0.02


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU here, or torch cannot use it")
def test_a_small_benchmark_on_a_gpu_reports_everyone() -> None:
    values = time_steps(noisy_torus(200), "compact", rounds=2, device="cuda")
    assert {"dmp, float32", "dmp, TF32", "torch_geometric, edge_index", "matrix products alone, TF32"} <= values[
        "seconds"
    ].keys()
    assert values["ratios"]["dmp, TF32"] == pytest.approx(values["seconds"]["dmp, float32"] / values["seconds"]["dmp, TF32"])
    assert "cuda" in steps_text(values)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_device_that_is_not_there_is_told() -> None:
    with pytest.raises(SettingsError, match="CUDA"):
        time_steps(noisy_torus(200), "compact", rounds=1, device="cuda")


def test_a_small_benchmark_reports_everyone() -> None:
    values = time_steps(noisy_torus(200), "compact", rounds=1, threads=1)
    assert {"dmp, float32", "torch_geometric, edge_index", "matrix products alone, float32"} <= values["seconds"].keys()
    assert values["ratios"]["torch_geometric, edge_index"] == pytest.approx(
        values["processor_seconds"]["dmp, float32"] / values["processor_seconds"]["torch_geometric, edge_index"]
    )
    text = steps_text(values)
    assert all(name in text for name in values["seconds"])


@pytest.mark.parametrize(("preset", "expected"), [("compact", {NETWORK}), ("best", {BANK, BILATERAL, FLATTENING})])
def test_a_profile_names_all_parts_and_they_add_up_to_a_step(preset: str, expected: set[str]) -> None:
    mesh, few = noisy_torus(400), {"rounds": 3, "threads": 1, "bilateral_layers": 1}
    values = profile_step(mesh, preset, **few)
    parts = values["parts"]
    assert expected | {part + BACKWARD for part in expected} <= parts.keys()
    assert all(parts[part] > 0 and parts[part + BACKWARD] > 0 for part in expected)
    whole = time_steps(mesh, preset, rivals=False, **few)["processor_seconds"]["dmp, float32"]
    assert 0.4 * whole < sum(parts.values()) < 2.5 * whole
    text = profile_text(values)
    assert all(part in text for part in expected)
    assert ("of it diffusions" in text) == (preset == "best")


def test_a_profile_changes_nothing_of_the_training(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Training] = []
    original = profiling.training_for
    monkeypatch.setattr(profiling, "training_for", lambda *given: seen.append(original(*given)) or seen[-1])
    mesh = noisy_torus(400)
    profile_step(mesh, "best", rounds=1, threads=1, bilateral_layers=1)
    settings = for_timing("best", 1, bilateral_layers=1)
    plain = training_for(denoising(mesh, settings), settings)
    steps = plain.steps()
    for _ in range(3):
        next(steps)
    for name, weight in plain._network.state_dict().items():
        assert torch.equal(weight, seen[0]._network.state_dict()[name]), name


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
    with pytest.raises(SettingsError, match="leave out --device"):
        benchmark(device="cuda", profile=True)
