from __future__ import annotations

import numpy as np
import pytest

from dmp.errors import SettingsError
from dmp.filters import FILTERS, Filter, filtered
from dmp.filters.bilateral import squared_lengths
from dmp.filters.neighbours import over_edges
from dmp.geometry import face_normals
from dmp.mesh import FloatArray, TriangleMesh
from tests.meshes import grid_mesh, sphere_mesh


def _together(*meshes: TriangleMesh) -> TriangleMesh:
    starts = np.cumsum([0, *(mesh.n_vertices for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return TriangleMesh(np.vstack([mesh.vertices for mesh in meshes]), np.vstack(faces))


SHEET = grid_mesh(5, height=0.3)
ALONE = TriangleMesh(np.array([[1e6, 2.0, 3.0]]), np.zeros((0, 3)))
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0.2], [0, 0.1, 1]])
HARD_MESHES = {
    "two pieces and a lone vertex": _together(SHEET, ALONE, sphere_mesh(0)),
    "three faces at an edge": TriangleMesh(CORNERS, np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])),
    "faces without area": TriangleMesh(
        np.vstack([SHEET.vertices, SHEET.vertices[:1]]), np.vstack([SHEET.faces, [[0, 0, 1], [3, 3, 3], [0, 1, 2], [25, 0, 1]]])
    ),
    "nothing but faces without area": TriangleMesh(
        np.eye(3)[[0] * 6] * np.arange(6)[:, None], np.array([[0, 1, 2], [3, 4, 5]])
    ),
    "all in one point": TriangleMesh(np.ones((3, 3)), np.array([[0, 1, 2]])),
    "one face": TriangleMesh(np.eye(3), np.array([[0, 1, 2]])),
    "no faces": TriangleMesh(np.eye(3), np.zeros((0, 3))),
    "opposite orientations": TriangleMesh(SHEET.vertices, np.vstack([SHEET.faces[:10], SHEET.faces[10:, ::-1]])),
}
OWN = [name for name, chosen in FILTERS.items() if not chosen.needs_meshlab]


@pytest.mark.parametrize("name", OWN)
@pytest.mark.parametrize("mesh", HARD_MESHES.values(), ids=HARD_MESHES.keys())
def test_hard_meshes_give_finite_results_and_unused_vertices_stay(mesh: TriangleMesh, name: str) -> None:
    result = filtered(mesh, name)
    assert result.shape == mesh.vertices.shape
    assert np.isfinite(result).all()
    unused = np.setdiff1d(np.arange(mesh.n_vertices), mesh.faces)
    np.testing.assert_array_equal(result[unused], mesh.vertices[unused])


@pytest.mark.parametrize("name", OWN)
def test_two_copies_are_filtered_as_one_alone(name: str) -> None:
    aside = np.array([50.0, 0, 0])
    both = filtered(_together(SHEET, SHEET.with_vertices(SHEET.vertices + aside)), name)
    alone = filtered(SHEET, name)
    np.testing.assert_allclose(both, np.vstack([alone, alone + aside]), rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", OWN)
def test_results_turn_scale_and_move_with_the_mesh(name: str, noisy_sphere: TriangleMesh) -> None:
    turn = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = noisy_sphere.with_vertices(1e-6 * noisy_sphere.vertices @ turn + [1, 2, 3])
    expected = 1e-6 * filtered(noisy_sphere, name) @ turn + [1, 2, 3]
    np.testing.assert_allclose(filtered(moved, name), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", [name for name in FILTERS if name not in OWN])
def test_filters_of_meshlab_make_pieces_smoother_and_keep_lone_vertices(name: str) -> None:
    mesh = HARD_MESHES["two pieces and a lone vertex"]
    result = filtered(mesh, name)
    np.testing.assert_array_equal(result[25], mesh.vertices[25])
    pairs = over_edges(SHEET.faces)

    def roughness(vertices: FloatArray) -> float:
        return float(squared_lengths(face_normals(vertices, SHEET.faces), pairs).mean())

    assert roughness(result[:25]) < 0.3 * roughness(SHEET.vertices)


@pytest.mark.parametrize("name", FILTERS)
def test_no_steps_change_nothing(name: str) -> None:
    np.testing.assert_array_equal(filtered(SHEET, name, **{FILTERS[name].count.name: 0}), SHEET.vertices)


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("median", {}, "no filter 'median'.*laplacian"),
        ("taubin", {"sigma": 0.3}, "taubin has no parameter sigma; it has passes, shrink, inflate"),
        ("bilateral_normal", {"sigma": 0}, "sigma .* a number from 0.01 to 10, not 0"),
        ("bilateral_normal", {"sigma": float("nan")}, "sigma"),
        ("bilateral_normal", {"neighbourhood": "far"}, "vertex or edge, not far"),
        ("guided_normal", {"vertex_steps": 2.5}, "vertex steps .* a whole number from 1 to 1000, not 2.5"),
        ("laplacian", {"steps": -1}, "steps"),
        ("laplacian", {"steps": "many"}, "many"),
        ("laplacian", {"steps": True}, "True"),
    ],
)
def test_what_is_no_parameter_is_refused_in_words(name: str, parameters: dict[str, object], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        filtered(SHEET, name, **parameters)


@pytest.mark.parametrize("chosen", FILTERS.values(), ids=FILTERS.keys())
def test_every_grid_holds_the_default_and_fits_its_range(chosen: Filter) -> None:
    for parameter in chosen.parameters:
        assert parameter.default in parameter.grid
        assert [parameter.checked(value, chosen.name) for value in parameter.grid] == list(parameter.grid)
    assert chosen.count.grid[0] == 0
    assert list(chosen.count.grid) == sorted(set(chosen.count.grid))
