from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dmp.geometry import face_normals
from dmp.mesh import TriangleMesh
from dmp.recorrupted.network import Operators, RestorationNetwork
from tests.meshes import grid_mesh, sphere_mesh


def _network() -> RestorationNetwork:
    with torch.random.fork_rng():
        torch.manual_seed(1)
        network = RestorationNetwork(2, 2, 2)
        # The last layer of the bank starts at zero, which would hide whatever is in front of it.
        torch.nn.init.normal_(network.bank.coefficients.weight, std=0.05)
    return network


def _output(network: RestorationNetwork, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    operators = Operators.of(faces, len(vertices), face_normals(vertices, faces), torch.device("cpu"))
    with torch.no_grad():
        return np.asarray(network(torch.tensor(vertices, dtype=torch.float32), operators, 0.2).double().numpy())


def _noisy(mesh: TriangleMesh) -> np.ndarray:
    return np.asarray(mesh.vertices * 4 + 0.1 * np.random.default_rng(2).standard_normal(mesh.vertices.shape))


@pytest.mark.parametrize("mesh", [sphere_mesh(2), grid_mesh(6, height=0.2)], ids=["closed", "boundary"])
def test_output_turns_and_moves_with_the_mesh(mesh: TriangleMesh) -> None:
    network, vertices = _network(), _noisy(mesh)
    turn, shift = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([1.0, -2.0, 0.5])
    plain = _output(network, vertices, mesh.faces)
    turned = _output(network, vertices @ turn.T + shift, mesh.faces)
    assert np.abs(turned - (plain @ turn.T + shift)).max() < 2e-4
    assert np.abs(plain - vertices).max() > 0.05


def test_output_follows_the_numbering_of_vertices_and_faces() -> None:
    mesh, network = sphere_mesh(2), _network()
    vertices, generator = _noisy(sphere_mesh(2)), np.random.default_rng(3)
    order, face_order = generator.permutation(mesh.n_vertices), generator.permutation(mesh.n_faces)
    new_number = np.argsort(order)
    plain = _output(network, vertices, mesh.faces)
    renumbered = _output(network, vertices[order], new_number[mesh.faces[face_order]])
    assert np.abs(renumbered - plain[order]).max() < 2e-4


def test_components_do_not_see_each_other() -> None:
    mesh, network = sphere_mesh(1), _network()
    vertices = _noisy(mesh)
    alone = _output(network, vertices, mesh.faces)
    both = _output(network, np.vstack([vertices, 2 * vertices + 3]), np.vstack([mesh.faces, mesh.faces + mesh.n_vertices]))
    assert np.abs(both[: mesh.n_vertices] - alone).max() < 1e-4
