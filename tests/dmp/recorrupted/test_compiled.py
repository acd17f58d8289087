"""Compiled kernels against the same in operations of torch in float64, whose gradients finite differences check elsewhere."""

from __future__ import annotations

import copy
import dataclasses
import gc
import weakref
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn import functional

from dmp.benchmark.meshes import noisy_torus
from dmp.geometry import face_normals
from dmp.mesh import TriangleMesh
from dmp.recorrupted import compiled_passes
from dmp.recorrupted.bilateral import BilateralLayer
from dmp.recorrupted.face_graph import face_graph
from dmp.recorrupted.passes import average_normals, follow_normals
from dmp.recorrupted.products import Incidence
from tests.meshes import grid_mesh, sphere_mesh


def _with_oddities() -> TriangleMesh:
    """A grid of 18 faces, not a multiple of 4, some of which face the other way, with a vertex that belongs to none."""
    mesh = grid_mesh(4, height=0.3)
    faces = mesh.faces.copy()
    faces[::5] = faces[::5, ::-1]
    return TriangleMesh(np.vstack([mesh.vertices, [[9.0, 9.0, 9.0]]]), faces)


_MESHES = pytest.mark.parametrize(
    "mesh", [sphere_mesh(2), grid_mesh(7, height=0.3), _with_oddities()], ids=["closed", "boundary", "odd"]
)


@pytest.fixture
def two_threads() -> Iterator[Callable[[int], None]]:
    before = torch.get_num_threads()
    yield torch.set_num_threads
    torch.set_num_threads(before)


def _incidence(mesh: TriangleMesh, *, double: bool = False) -> Incidence:
    graph = face_graph(mesh.faces, face_normals(mesh.vertices, mesh.faces))
    single = Incidence.of(mesh.faces, mesh.n_vertices, graph, torch.device("cpu"))
    if not double:
        return single
    return dataclasses.replace(
        single,
        corner_sum=single.corner_sum.double(),
        corner_counts=single.corner_counts.double(),
        signs=single.signs.double(),
    )


def _both(
    run: Callable[..., Tensor | tuple[Tensor, ...]], inputs: list[Tensor], incidences: tuple[Incidence, Incidence]
) -> tuple[list[Tensor], list[Tensor]]:
    """Return results and gradients in float32 and in float64; of all results the same random sum is differentiated."""
    found = []
    for dtype, incidence in zip((torch.float32, torch.float64), incidences, strict=True):
        own = [tensor.detach().to(dtype).requires_grad_() for tensor in inputs]
        results = run(*own, incidence)
        results = (results,) if isinstance(results, Tensor) else results
        generator = torch.Generator().manual_seed(1)
        total = sum((part * torch.randn(part.shape, generator=generator).to(dtype)).sum() for part in results)
        assert isinstance(total, Tensor)
        found.append([*(part.detach() for part in results), *torch.autograd.grad(total, own)])
    return found[0], found[1]


def _agree(single: list[Tensor], double: list[Tensor], tolerance: float = 1e-5) -> None:
    for actual, expected in zip(single, double, strict=True):
        assert actual.dtype == torch.float32
        assert actual.shape == expected.shape
        assert (actual.double() - expected).norm() <= tolerance * expected.norm()


def _random(generator: torch.Generator, *shape: int) -> Tensor:
    return torch.rand(*shape, generator=generator, dtype=torch.float64)


def _for_normals(mesh: TriangleMesh, incidence: Incidence) -> list[Tensor]:
    generator = torch.Generator().manual_seed(0)
    # Some weights of the wrong sign, so that there are sums that say little.
    weights = (_random(generator, 3, mesh.n_faces) - 0.3) * incidence.signs[:, :, 0].double()
    normals = functional.normalize(torch.randn(mesh.n_faces, 3, generator=generator, dtype=torch.float64), dim=1)
    return [_random(generator, mesh.n_faces), weights, normals]


def _for_vertices(mesh: TriangleMesh) -> list[Tensor]:
    generator = torch.Generator().manual_seed(0)
    normals = torch.from_numpy(face_normals(mesh.vertices, mesh.faces)) + 0.5 * _random(generator, mesh.n_faces, 3)
    return [torch.from_numpy(mesh.vertices.copy()), functional.normalize(normals, dim=1), _random(generator, mesh.n_faces)]


@_MESHES
@pytest.mark.parametrize("passes", [0, 1, 2, 7])
def test_passes_over_normals_are_those_of_torch(mesh: TriangleMesh, passes: int) -> None:
    incidences = _incidence(mesh), _incidence(mesh, double=True)
    inputs = _for_normals(mesh, incidences[0])
    single, double = _both(lambda *given: average_normals(*given, passes), inputs, incidences)
    if passes == 1 and mesh.n_faces > 100:
        # Sums that are divided by their bound are among them.
        assert (double[0].norm(dim=1) < 0.99).any()
    _agree(single, double)


@_MESHES
@pytest.mark.parametrize("passes", [0, 1, 2, 7])
def test_passes_over_vertices_are_those_of_torch(mesh: TriangleMesh, passes: int) -> None:
    incidences = _incidence(mesh), _incidence(mesh, double=True)
    _agree(*_both(lambda *given: follow_normals(*given, passes), _for_vertices(mesh), incidences))


def test_passes_over_vertices_do_not_know_where_the_origin_is() -> None:
    """Operations of torch in float32 lose as many digits as positions have in front of the point."""
    mesh = sphere_mesh(2)
    incidences = _incidence(mesh), _incidence(mesh, double=True)
    inputs = _for_vertices(mesh)
    # Representable in float32, so that both see the same mesh.
    inputs[0] = (inputs[0].float() * 64).round() / 64 + 1024
    single, double = _both(lambda *given: follow_normals(*given, 5), inputs, incidences)
    assert (single[0].double() - double[0]).abs().max() < 1e-4
    _agree(single[1:], double[1:])


@_MESHES
def test_messages_are_those_of_torch(mesh: TriangleMesh) -> None:
    torch.manual_seed(0)
    layer = BilateralLayer(24, 12, 1, 1)
    with torch.no_grad():
        for parameter in layer.parameters():
            parameter.add_(0.2 * torch.randn_like(parameter))
    reference = copy.deepcopy(layer).double()
    of_layer = [layer, reference]

    def run(positions: Tensor, hidden: Tensor, incidence: Incidence) -> tuple[Tensor, ...]:
        chosen = of_layer[positions.dtype == torch.float64]
        assert chosen.has_kernels(positions) == (positions.dtype == torch.float32)
        return chosen.messages(positions, hidden, incidence, 0.3)

    incidences = _incidence(mesh), _incidence(mesh, double=True)
    inputs = [torch.from_numpy(mesh.vertices.copy()), torch.randn(mesh.n_faces, 24)]
    _agree(*_both(run, inputs, incidences))

    found: list[list[Tensor]] = []
    names = [name for name, _ in layer.named_parameters() if name.startswith(("of_", "weight", "sharpness"))]
    for dtype, incidence in zip((torch.float32, torch.float64), incidences, strict=True):
        chosen = of_layer[dtype == torch.float64]
        results = run(*(tensor.to(dtype) for tensor in inputs), incidence)
        parameters = [chosen.get_parameter(name) for name in names]
        found.append(list(torch.autograd.grad(sum(part.square().sum() for part in results), parameters)))  # type: ignore[arg-type]
    assert len(names) == 7
    _agree(*found)


@pytest.mark.parametrize("n_faces", [1, 4, 7, 600])
def test_new_features_are_those_of_torch(n_faces: int) -> None:
    torch.manual_seed(0)
    layer = BilateralLayer(24, 12, 1, 1)
    with torch.no_grad():
        for parameter in layer.parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))
    reference = copy.deepcopy(layer).double()
    inputs = [torch.randn(n_faces, 24), torch.randn(n_faces, 12), torch.rand(n_faces) + 0.1]
    names = [name for name, _ in layer.named_parameters() if name.startswith(("update", "norm", "own_weight", "gate"))]
    found = []
    for dtype, chosen in ((torch.float32, layer), (torch.float64, reference)):
        given = [part.to(dtype).requires_grad_() for part in inputs]
        results = chosen.updated(*given)
        generator = torch.Generator().manual_seed(1)
        total = sum((part * torch.randn(part.shape, generator=generator).to(dtype)).sum() for part in results)
        assert isinstance(total, Tensor)
        assert ("_Update" in type(results[0].grad_fn).__name__) == (dtype == torch.float32)
        found.append([*results, *torch.autograd.grad(total, [*given, *map(chosen.get_parameter, names)])])
    assert len(names) == 10
    _agree(*found)


def test_a_face_without_area_tells_finite_numbers() -> None:
    mesh = grid_mesh(4, height=0.3)
    vertices = mesh.vertices.copy()
    vertices[mesh.faces[3, 1]] = vertices[mesh.faces[3, 0]]
    mesh = TriangleMesh(vertices, mesh.faces)
    incidences = _incidence(mesh), _incidence(mesh, double=True)
    layer = BilateralLayer(24, 12, 1, 1)
    of_layer = [layer, copy.deepcopy(layer).double()]
    inputs = [torch.from_numpy(vertices), torch.randn(mesh.n_faces, 24, generator=torch.Generator().manual_seed(0))]
    _agree(*_both(lambda p, h, i: of_layer[p.dtype == torch.float64].messages(p, h, i, 0.3), inputs, incidences))


def test_two_threads_find_the_same_bits(two_threads: Callable[[int], None]) -> None:
    mesh = noisy_torus(2500)
    incidence = _incidence(mesh)
    of_normals = [part.float().requires_grad_() for part in _for_normals(mesh, incidence)]
    positions, _, gates = (part.float().requires_grad_() for part in _for_vertices(mesh))
    both = torch.randn(mesh.n_faces, 24, generator=torch.Generator().manual_seed(2)).requires_grad_()
    layer = BilateralLayer(24, 12, 1, 1)
    given = *of_normals, positions, gates, both, *layer.parameters()
    found = []
    for threads in (1, 2):
        two_threads(threads)
        normals = average_normals(*of_normals, incidence, 5)
        moved = follow_normals(positions, normals, gates, incidence, 4)
        results = moved, *layer.tell(moved, both, incidence, 0.2)
        gradients = torch.autograd.grad(sum(part.square().sum() for part in results), given, allow_unused=True)  # type: ignore[arg-type]
        found.append([*results, *(gradient for gradient in gradients if gradient is not None)])
    assert len(found[0]) == 5 + 6 + 4
    for one, other in zip(*found, strict=True):
        assert torch.equal(one, other)


def test_without_gradients_the_result_is_the_same_and_nothing_is_kept() -> None:
    mesh = sphere_mesh(2)
    incidence = _incidence(mesh)
    inputs = [part.float() for part in _for_normals(mesh, incidence)]
    with_gradients = average_normals(*(part.clone().requires_grad_() for part in inputs), incidence, 6)
    assert torch.equal(average_normals(*inputs, incidence, 6), with_gradients)
    of_vertices = [part.float() for part in _for_vertices(mesh)]
    with_gradients = follow_normals(*(part.clone().requires_grad_() for part in of_vertices), incidence, 6)
    assert torch.equal(follow_normals(*of_vertices, incidence, 6), with_gradients)


def test_which_tensors_the_kernels_take() -> None:
    assert compiled_passes.serve(torch.zeros(1))
    assert not compiled_passes.serve(torch.zeros(1, dtype=torch.float64))
    assert not compiled_passes.serve(torch.zeros(1, device="meta"))


def test_a_step_leaves_nothing_behind() -> None:
    """See the test of the same name for the operations of torch."""
    mesh = sphere_mesh(1)
    incidence = _incidence(mesh)
    of_normals = [part.float().requires_grad_() for part in _for_normals(mesh, incidence)]
    positions, _, gates = (part.float().requires_grad_() for part in _for_vertices(mesh))
    layer = BilateralLayer(24, 12, 1, 1)
    averaged = average_normals(*of_normals, incidence, 3)
    moved = follow_normals(positions, averaged, gates, incidence, 2)
    told = layer.messages(moved, torch.zeros(mesh.n_faces, 24), incidence, 0.2)
    left = [weakref.ref(averaged.grad_fn), weakref.ref(moved.grad_fn), weakref.ref(told[0].grad_fn)]
    assert all(reference() is not None for reference in left)
    gc.disable()
    try:
        sum(part.square().sum() for part in told).backward()  # type: ignore[union-attr, no-untyped-call]
        del averaged, moved, told
        assert [reference() for reference in left] == [None, None, None]
    finally:
        gc.enable()


def test_a_face_turned_over_in_a_closed_mesh_is_as_alike_to_its_neighbours_as_before() -> None:
    mesh, layer = sphere_mesh(2), BilateralLayer(24, 12, 1, 1)
    turned = mesh.faces.copy()
    turned[5] = turned[5, ::-1]
    cosines = []
    for faces in (mesh.faces, turned):
        other = TriangleMesh(mesh.vertices, faces)
        incidence = _incidence(other)
        normals = torch.from_numpy(face_normals(other.vertices, other.faces)).float()
        centres = torch.from_numpy(mesh.vertices[faces].mean(axis=1)).float()
        geometry, _ = layer._geometry(normals, centres, torch.ones(len(faces)), incidence, 1.0)
        # Slots follow the edges of a face, which a turned face has in another order.
        cosines.append(geometry[:, :, 0].sort(dim=0).values)
    assert torch.allclose(*cosines, atol=1e-6)
    assert cosines[0].min() > 0
