from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy import sparse
from scipy.spatial.transform import Rotation

from dmp.completion import completion
from dmp.errors import MeshError, SettingsError
from dmp.made_up_holes.features import N_FEATURES, shape_features
from dmp.made_up_holes.making import HoleMaker, ring_distances
from dmp.made_up_holes.thin_plate import ThinPlate
from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.settings import settings_for
from dmp.shapes.spheres import bumpy_sphere
from dmp.topology import adjacency
from tests.meshes import grid_mesh, sphere_mesh


def _cut(mesh: TriangleMesh, gone: np.ndarray) -> TriangleMesh:
    faces = mesh.faces[~gone[mesh.faces].any(axis=1)]
    used, index = np.unique(faces, return_inverse=True)
    return TriangleMesh(mesh.vertices[used], index.reshape(-1, 3))


@pytest.fixture(scope="module")
def whole() -> TriangleMesh:
    return bumpy_sphere(12)


@pytest.fixture(scope="module")
def holed(whole: TriangleMesh) -> TriangleMesh:
    directions = whole.vertices / np.linalg.norm(whole.vertices, axis=1, keepdims=True)
    return _cut(whole, directions[:, 2] > 0.93)


def test_thin_plate_continues_a_plane_exactly() -> None:
    sheet = grid_mesh(9)
    tilted = sheet.vertices + np.array([0, 0, 1.0]) * (0.3 * sheet.vertices[:, :1] - 0.2 * sheet.vertices[:, 1:2])
    free = np.zeros(81, dtype=bool)
    free[[30, 31, 39, 40, 41, 49]] = True
    spoiled = np.where(free[:, None], 7.0, tilted)
    filled = ThinPlate(adjacency(sheet.faces, 81), sheet.faces).fill(spoiled, free)
    heights = filled[:, 2] - 0.3 * filled[:, 0] + 0.2 * filled[:, 1]
    assert np.abs(heights).max() < 1e-6
    assert np.array_equal(filled[~free], tilted[~free])


def test_ring_distances_against_a_shortest_path_search() -> None:
    mesh = sphere_mesh(2)
    graph = adjacency(mesh.faces, mesh.n_vertices)
    sources = np.zeros(mesh.n_vertices, dtype=bool)
    sources[[0, 17]] = True
    expected = sparse.csgraph.dijkstra(graph, unweighted=True, indices=[0, 17]).min(axis=0)
    assert ring_distances(graph, sources).tolist() == expected.tolist()
    near = ring_distances(graph, sources, 2)
    assert near.tolist() == [d if d <= 2 else -1 for d in expected]


def test_made_up_holes_keep_away_from_each_other_and_from_real_ones(holed: TriangleMesh) -> None:
    problem = completion(holed, settings_for("complete", "best"))
    graph = adjacency(problem.mesh.faces, problem.mesh.n_vertices)
    maker = HoleMaker(graph, problem.known)
    holes = maker.make(np.random.default_rng(0))
    assert holes.any()
    assert (ring_distances(graph, ~problem.known)[holes] > 3).all()
    labels = sparse.csgraph.connected_components(graph[holes][:, holes], directed=False)[1]
    first = np.zeros(problem.mesh.n_vertices, dtype=bool)
    first[np.flatnonzero(holes)[labels == 0]] = True
    assert ring_distances(graph, first)[holes & ~first].min() > 3


def test_features_do_not_depend_on_how_the_mesh_lies(whole: TriangleMesh) -> None:
    graph = adjacency(whole.faces, whole.n_vertices)
    averaging = sparse.diags_array(1 / graph.sum(axis=1)) @ graph
    smoothing = sparse.csr_array(0.5 * (sparse.eye_array(whole.n_vertices) + averaging))
    filled = np.zeros(whole.n_vertices, dtype=bool)
    filled[:20] = True
    turned = Rotation.from_rotvec([0.3, -1.0, 0.5]).apply(whole.vertices.copy()) + np.array([5, 6, 7])
    features = [
        shape_features(positions, filled, depth=3, smoothing=smoothing, adjacency=graph, faces=whole.faces)[0]
        for positions in (whole.vertices, turned)
    ]
    assert features[0].shape == (whole.n_vertices, N_FEATURES)
    assert features[1] == pytest.approx(features[0], abs=1e-9)


def test_the_structure_of_the_mesh_is_carried_into_the_hole(holed: TriangleMesh, whole: TriangleMesh) -> None:
    settings = settings_for("complete", "best", steps=60, log_every=30, snapshot_every=60, threads=1)
    problem = completion(holed, settings, whole)
    records = [record for record in training_for(problem, settings).steps() if record.metrics]
    assert records[-1].metrics["made_up_error"] < 0.8 * records[0].metrics["made_up_error"]
    assert records[-1].snapshot is not None
    assert np.array_equal(records[-1].snapshot.vertices[problem.known], holed.vertices)


def test_an_untrained_network_leaves_the_thin_plate(holed: TriangleMesh) -> None:
    settings = settings_for("complete", "best", steps=1, threads=1)
    problem = completion(holed, settings)
    first = next(training_for(problem, settings).steps())
    assert first.snapshot is not None
    plate = ThinPlate(adjacency(problem.mesh.faces, problem.mesh.n_vertices), problem.mesh.faces).fill(
        problem.target, ~problem.known
    )
    assert first.snapshot.vertices == pytest.approx(plate, abs=1e-5)


def test_going_on_from_a_state_is_bit_exact(holed: TriangleMesh) -> None:
    settings = settings_for("complete", "best", steps=12, log_every=4, snapshot_every=4, threads=1)
    problem = completion(holed, settings)
    whole_run = [r.snapshot.vertices for r in training_for(problem, settings).steps() if r.snapshot]
    first, second = training_for(problem, settings), training_for(problem, settings)
    for record in first.steps():
        if record.step == 8:
            break
    second.load_state(first.state())
    assert np.array_equal([r.snapshot.vertices for r in second.steps() if r.snapshot][-1], whole_run[-1])


def test_what_cannot_be_done_is_refused_in_words(holed: TriangleMesh) -> None:
    settings = settings_for("complete", "best", known_vertices="predict")
    with pytest.raises(SettingsError, match="compact"):
        training_for(completion(holed, settings), settings)
    tiny = _cut(sphere_mesh(1), np.arange(18) == 4)
    settings = settings_for("complete", "best")
    with pytest.raises(MeshError, match="too small"):
        training_for(completion(tiny, settings), settings)
    assert torch.is_grad_enabled()
