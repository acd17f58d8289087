"""The hand-written blocks against plain loops in autograd, and their gradients against finite differences."""

from __future__ import annotations

import dataclasses
import gc
import weakref

import numpy as np
import pytest
import torch
from scipy.sparse import csr_array
from torch import Tensor
from torch.nn import functional

from dmp.geometry import face_normals
from dmp.mesh import TriangleMesh
from dmp.operators import to_torch
from dmp.recorrupted.diffusion import diffused, diffused_at
from dmp.recorrupted.face_graph import face_graph
from dmp.recorrupted.passes import average_normals, follow_normals
from dmp.recorrupted.products import Incidence, gather_corners, gather_neighbour_rows, gather_neighbours, sum_corners
from tests.meshes import grid_mesh, sphere_mesh

_MESHES = pytest.mark.parametrize("mesh", [sphere_mesh(0), grid_mesh(4, height=0.3)], ids=["closed", "boundary"])


def _incidence(mesh: TriangleMesh) -> Incidence:
    """In double precision, so that finite differences mean something."""
    graph = face_graph(mesh.faces, face_normals(mesh.vertices, mesh.faces))
    single = Incidence.of(mesh.faces, mesh.n_vertices, graph, torch.device("cpu"))
    return dataclasses.replace(
        single,
        corner_sum=single.corner_sum.to(torch.float64),
        corner_counts=single.corner_counts.double(),
        signs=single.signs.double(),
    )


def _random(*shape: int, seed: int = 0) -> Tensor:
    return torch.from_numpy(np.random.default_rng(seed).uniform(0.2, 1.0, shape)).requires_grad_()


@_MESHES
def test_gathers_and_sums_have_the_gradients_of_plain_indexing(mesh: TriangleMesh) -> None:
    incidence = _incidence(mesh)
    at_vertices, at_faces, at_corners = _random(mesh.n_vertices, 2), _random(mesh.n_faces, 2), _random(3, mesh.n_faces, 2)
    faces = torch.tensor(mesh.faces)
    assert torch.equal(gather_corners(at_vertices, incidence), at_vertices[faces].transpose(0, 1))
    neighbours = incidence.neighbours.view(3, -1)
    assert torch.equal(gather_neighbours(at_faces, incidence), at_faces[neighbours])
    assert torch.equal(gather_neighbour_rows(at_faces.t(), incidence), at_faces[neighbours].permute(2, 0, 1))
    dense = torch.zeros(mesh.n_vertices, 2, dtype=torch.float64)
    for face, corners in enumerate(mesh.faces):
        for corner, vertex in enumerate(corners):
            dense[vertex] += at_corners[corner, face].detach()
    assert torch.allclose(sum_corners(at_corners, incidence), dense)
    assert torch.autograd.gradcheck(lambda x: gather_corners(x, incidence), at_vertices)
    assert torch.autograd.gradcheck(lambda x: gather_neighbours(x, incidence), at_faces)
    assert torch.autograd.gradcheck(lambda x: gather_neighbour_rows(x, incidence), at_faces.t())
    assert torch.autograd.gradcheck(lambda x: sum_corners(x, incidence), at_corners)


@pytest.mark.parametrize("steps", [0, 1, 5])
@pytest.mark.parametrize("columns", [1, 3, 4, 5])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_diffused_is_products_with_the_dense_matrix(steps: int, columns: int, dtype: torch.dtype) -> None:
    """With a row of no entries, and one of many; five columns are more than the compiled kernel takes."""
    generator = np.random.default_rng(3)
    dense = torch.from_numpy(generator.standard_normal((9, 9))).to(dtype)
    dense[dense.abs() < 0.5] = 0
    dense[4] = 0
    values = torch.from_numpy(generator.standard_normal((9, columns))).to(dtype).requires_grad_()
    matrix, transposed = (to_torch(csr_array(part.double().numpy())).to(dtype) for part in (dense, dense.T))
    dense = matrix.to_dense()
    power = torch.linalg.matrix_power(dense.double(), steps)
    expected = power @ values.double()
    actual = diffused(matrix, transposed, values, steps)
    _is_close(actual, expected)
    _is_close(torch.autograd.grad(actual.square().sum(), values)[0], 2 * power.T @ expected)
    several = diffused_at(matrix, values, (0, 1, steps + 2))
    assert torch.equal(several[0], values)
    _is_close(several[1], dense.double() @ values.double())
    _is_close(several[2], dense.double() @ (dense.double() @ expected))


def _is_close(actual: Tensor, expected: Tensor) -> None:
    assert (actual - expected).norm() < 1e-5 * expected.norm()


@_MESHES
def test_average_normals_is_the_plain_loop(mesh: TriangleMesh) -> None:
    incidence = _incidence(mesh)
    own, weights = _random(mesh.n_faces), (_random(3, mesh.n_faces) * incidence.signs[:, :, 0]).detach().requires_grad_()
    normals = torch.from_numpy(face_normals(mesh.vertices, mesh.faces)).requires_grad_()
    expected = normals
    for _ in range(4):
        around = expected[incidence.neighbours.view(3, -1)]
        expected = functional.normalize(own[:, None] * expected + (weights[:, :, None] * around).sum(dim=0), dim=1)
    assert torch.allclose(average_normals(own, weights, normals, incidence, 4), expected)
    # An empty slot's weight stays 0 whatever its gradient, so it is checked as the product with its sign.
    signs = incidence.signs[:, :, 0]
    assert torch.autograd.gradcheck(lambda a, b, c: average_normals(a, b * signs, c, incidence, 3), (own, weights, normals))


@_MESHES
def test_follow_normals_is_the_plain_loop(mesh: TriangleMesh) -> None:
    incidence = _incidence(mesh)
    positions, gates = torch.from_numpy(mesh.vertices.copy()).requires_grad_(), _random(mesh.n_faces)
    normals = functional.normalize(_random(mesh.n_faces, 3) - 0.5, dim=1).detach().requires_grad_()
    expected = mesh.vertices.copy()
    for _ in range(2):
        moves, counts = np.zeros_like(expected), np.zeros((mesh.n_vertices, 1))
        for face, corners in enumerate(mesh.faces):
            normal, centroid = normals.detach().numpy()[face], expected[corners].mean(axis=0)
            for vertex in corners:
                moves[vertex] += gates.detach().numpy()[face] * normal * (normal @ (centroid - expected[vertex]))
                counts[vertex] += 1
        expected = expected + moves / counts
    actual = follow_normals(positions, normals, gates, incidence, 2)
    assert np.allclose(actual.detach().numpy(), expected)
    assert torch.autograd.gradcheck(lambda a, b, c: follow_normals(a, b, c, incidence, 2), (positions, normals, gates))


def test_vertices_at_rest_on_their_planes_stay() -> None:
    mesh = grid_mesh(4)
    incidence = _incidence(mesh)
    positions = torch.from_numpy(mesh.vertices.copy())
    normals = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64).expand(mesh.n_faces, 3)
    gates = torch.ones(mesh.n_faces, dtype=torch.float64)
    assert torch.equal(follow_normals(positions, normals, gates, incidence, 3), positions)


def test_a_step_leaves_nothing_behind() -> None:
    """A result that its own backward pass holds on to is freed late at best, and memory grows with every step."""
    mesh = sphere_mesh(1)
    incidence = _incidence(mesh)
    positions, normals, own, weights, gates = (
        _random(mesh.n_vertices, 3),
        _random(mesh.n_faces, 3),
        _random(mesh.n_faces),
        _random(3, mesh.n_faces),
        _random(mesh.n_faces),
    )
    averaged = average_normals(own, weights, normals, incidence, 3)
    moved = follow_normals(positions, averaged, gates, incidence, 2)
    left = [weakref.ref(averaged.grad_fn), weakref.ref(moved.grad_fn)]
    assert all(reference() is not None for reference in left)
    gc.disable()  # It would find such a circle in the end, but only after gigabytes.
    try:
        moved.square().sum().backward()  # type: ignore[no-untyped-call]
        del averaged, moved
        assert [reference() for reference in left] == [None, None]
    finally:
        gc.enable()
