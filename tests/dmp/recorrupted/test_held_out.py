"""Rings that the training never sees."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from dmp.recorrupted.held_out import hold_out_rings, standard_errors_above
from dmp.recorrupted.patches import patches, whole
from dmp.topology import adjacency
from tests.meshes import grid_mesh, sphere_mesh


@pytest.mark.parametrize("size", [1500, 10_000])
def test_rings_are_whole_apart_and_as_many_as_wanted(size: int) -> None:
    mesh = sphere_mesh(5)
    parts = patches(mesh.vertices, mesh.faces, size)
    hidden, found = hold_out_rings(parts, mesh.n_vertices, 0.1, seed=3)
    neighbours = sparse.csr_array(adjacency(mesh.faces, mesh.n_vertices))
    seen: set[int] = set()
    ring_of: dict[int, int] = {}
    for rings in found:
        part = parts[rings.patch]
        vertices = part.vertices[rings.vertices]
        assert not seen & set(vertices.tolist())
        seen |= set(vertices.tolist())
        ring_of |= dict(zip(vertices.tolist(), rings.vertex_rings.tolist(), strict=True))
        assert np.isin(rings.vertices, part.judged_vertices).all()
    assert np.flatnonzero(hidden).tolist() == sorted(seen)
    members: dict[int, set[int]] = {}
    for vertex, ring in ring_of.items():
        members.setdefault(ring, set()).add(vertex)
    for ring in members.values():
        around = [set(neighbours.indices[neighbours.indptr[v] : neighbours.indptr[v + 1]].tolist()) | {v} for v in ring]
        assert any(ring == one for one in around)
    for rings in found:
        part = parts[rings.patch]
        corners = part.vertices[part.faces[rings.faces]]
        for face, ring in zip(corners, rings.face_rings, strict=True):
            assert {ring_of[int(vertex)] for vertex in face} == {ring}
    if size > mesh.n_vertices:
        assert 0.09 < hidden.mean() < 0.12
        # A ring on a sphere of this kind has five or six faces.
        assert len(found[0].faces) >= 5 * len(members)


def test_the_same_seed_hides_the_same_rings() -> None:
    mesh = sphere_mesh(5)
    part = [whole(mesh.faces, mesh.n_vertices)]
    first, _ = hold_out_rings(part, mesh.n_vertices, 0.3, seed=1)
    again, _ = hold_out_rings(part, mesh.n_vertices, 0.3, seed=1)
    other, _ = hold_out_rings(part, mesh.n_vertices, 0.3, seed=2)
    assert first.any()
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_nothing_is_hidden_where_it_could_not_tell_anything() -> None:
    mesh = grid_mesh(6)
    part = [whole(mesh.faces, mesh.n_vertices)]
    assert not hold_out_rings(part, mesh.n_vertices, 0.1, seed=0)[0].any()
    mesh = sphere_mesh(5)
    hidden, found = hold_out_rings([whole(mesh.faces, mesh.n_vertices)], mesh.n_vertices, 0.0, seed=0)
    assert not hidden.any()
    assert found == []


def test_standard_errors_are_those_of_a_paired_comparison() -> None:
    generator = np.random.default_rng(0)
    common = 100 * generator.standard_normal(400)  # what two steps have in common must not count
    lowest, risk = common, common + 0.2 + generator.standard_normal(400)
    difference = risk - lowest
    expected = difference.mean() / (difference.std(ddof=1) / np.sqrt(400))
    assert standard_errors_above(risk, lowest) == pytest.approx(expected)
    assert standard_errors_above(lowest, lowest) == 0.0
