"""The report finds each fault that was put into a mesh, where it was put, and nothing in a clean one."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from dmp.corner_groups import corner_groups, groups_at_vertices, half_edge_keys, pairs_over_edges
from dmp.joining import duplicate_rows
from dmp.mesh import TriangleMesh
from dmp.mesh_info import describe_mesh, description_text
from dmp.mesh_report import Finding, flat_faces, mesh_report
from dmp.orientation import orientation, sorted_corners
from dmp.topology import unique_edges
from tests import odd_meshes
from tests.meshes import grid_mesh, sphere_mesh
from tests.odd_meshes import ODD_MESHES

EXPECTED: dict[str, dict[str, int]] = {
    "a ball": {},
    "non-manifold edge": {"non-manifold edges": 1, "boundaries": 1},
    "non-manifold vertex": {"non-manifold vertices": 1},
    "fan": {"non-manifold edges": 1, "flipped faces": 2, "boundaries": 1},
    "isolated vertices": {"isolated vertices": 3},
    "collapsed faces": {"degenerate faces": 5, "isolated vertices": 1},
    "cap": {"degenerate faces": 1},
    "coincident vertices": {"duplicate vertices": 132, "boundaries": 51, "separate pieces": 51},
    "duplicate faces": {"duplicate faces": 9},
    "several pieces": {"separate pieces": 3, "boundaries": 1},
    "single triangle": {"boundaries": 1},
    "tetrahedron": {},
    "flat square": {"boundaries": 1},
    "flipped faces": {"flipped faces": 43},
    "inside out": {"inside out": 1},
    "Moebius strip": {"one-sided surface": 24, "boundaries": 1},
    "needles": {"thin faces": 50, "boundaries": 1},
    "size 1e-6": {},
    "size 1e7": {},
    "1e7 away": {"far from the origin": 1},
    "small and 1e7 away": {"far from the origin": 1},
}


def found(mesh: TriangleMesh) -> dict[str, Finding]:
    return {finding.kind: finding for finding in mesh_report(mesh)}


@pytest.mark.parametrize("name", ODD_MESHES)
def test_each_fault_is_found_and_nothing_else(name: str) -> None:
    assert {kind: finding.count for kind, finding in found(ODD_MESHES[name]()).items()} == EXPECTED[name]


def test_a_place_that_even_double_precision_has_rounded_is_a_warning() -> None:
    ball = ODD_MESHES["a ball"]()
    far = ball.with_vertices(ball.vertices + 1e14)
    (finding,) = mesh_report(far)
    assert (finding.kind, finding.severity) == ("far from the origin", "warning")
    edges = unique_edges(ball.faces)
    length = np.linalg.norm(far.vertices[edges[:, 0]] - far.vertices[edges[:, 1]], axis=1).mean()
    # Numbers between 2^46 and 2^47 are 2^-6 apart.
    assert f"places that are {2.0**-6 / length:.2g} edge lengths apart" in finding.meaning
    (finding,) = mesh_report(ball.with_vertices(ball.vertices + 1e7))
    assert (finding.kind, finding.severity) == ("far from the origin", "note")


@pytest.mark.parametrize("name", ODD_MESHES)
def test_findings_are_sentences_with_existing_vertices_warnings_first(name: str) -> None:
    mesh = ODD_MESHES[name]()
    findings = mesh_report(mesh)
    assert [finding.severity for finding in findings] == sorted((f.severity for f in findings), key="note".__eq__)
    for finding in findings:
        for text in (finding.text, finding.meaning):
            assert text.endswith(".") and text[0].isupper() | text[0].isdigit() and "\n" not in text
        assert np.array_equal(finding.vertices, np.unique(finding.vertices))
        assert finding.vertices.size == 0 or 0 <= finding.vertices.min() <= finding.vertices.max() < mesh.n_vertices
        assert json.loads(json.dumps(finding.values()))["kind"] == finding.kind


def test_the_affected_vertices_are_named() -> None:
    assert found(odd_meshes.isolated_vertices())["isolated vertices"].vertices.tolist() == [0, 31, 68]
    assert found(odd_meshes.non_manifold_vertex())["non-manifold vertices"].vertices.tolist() == [0]
    edge = found(odd_meshes.non_manifold_edge())["non-manifold edges"].edges
    assert edge.tolist() == [sorted(odd_meshes._ball().faces[0, :2].tolist())]
    doubled = found(odd_meshes.coincident_vertices())["duplicate vertices"].vertices
    positions = odd_meshes.coincident_vertices().vertices
    alike = (positions[:, None] == positions[None]).all(axis=2).sum(axis=1) > 1
    assert doubled.tolist() == np.flatnonzero(alike).tolist()


def test_close_vertices_count_only_where_edges_are_long_and_open() -> None:
    left, right = grid_mesh(4), grid_mesh(4)
    gap = odd_meshes.joined(left, right.with_vertices(right.vertices + np.array([3.005, 0, 0])))
    assert found(gap)["close vertices"].count == 8
    assert "close vertices" not in found(odd_meshes.joined(left, right.with_vertices(right.vertices + np.array([3.05, 0, 0]))))
    # A fine mesh beside a coarse one is fine, not torn.
    fine = left.with_vertices(1e-4 * left.vertices + [50, 0, 0])
    assert "close vertices" not in found(odd_meshes.joined(left, fine))


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e7])
def test_faces_without_area_do_not_depend_on_the_scale(scale: float) -> None:
    vertices = scale * np.array([[0, 0, 0], [1, 0, 0], [0.4, 0, 0], [0.5, 1e-9, 0], [0.5, 1e-3, 0], [0.5, 0.9, 0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 1, 5]])
    assert flat_faces(vertices, faces).tolist() == [True, True, False, False]


def test_duplicates_are_found_as_a_loop_finds_them() -> None:
    rows = np.random.default_rng(0).integers(0, 3, (60, 2)).astype(float)
    rows[5] = -0.0
    rows[40] = 0.0
    first = [next(j for j in range(len(rows)) if (rows[j] == rows[i]).all()) for i in range(len(rows))]
    earlier, repeated = duplicate_rows(rows)
    assert earlier.tolist() == first
    assert repeated.tolist() == [i for i in range(len(rows)) if first[i] != i]


# -- corners ----------------------------------------------------------------------------------------------------------


def test_groups_of_corners_are_those_of_a_walk_around_each_vertex() -> None:
    generator = np.random.default_rng(3)
    for _ in range(40):
        faces = np.array([generator.choice(9, 3, replace=False) for _ in range(14)])
        groups = corner_groups(faces, pairs_over_edges(faces))
        counts = groups_at_vertices(faces, groups, 9)
        for vertex in range(9):
            around = [index for index in range(len(faces)) if vertex in faces[index]]
            # Faces at the vertex hang together when they share another vertex as well.
            seen: list[set[int]] = []
            for index in around:
                touching = [
                    group for group in seen if any((set(faces[index]) & set(faces[other])) - {vertex} for other in group)
                ]
                seen = [group for group in seen if group not in touching] + [set.union({index}, *touching)]
            assert counts[vertex] == len(seen)


def test_sides_are_numbered_by_their_edge() -> None:
    keys = half_edge_keys(np.array([[0, 1, 2], [2, 1, 3]]))
    assert keys[0, 1] == keys[1, 0]
    assert len(np.unique(keys)) == 5
    assert pairs_over_edges(np.array([[0, 1, 2], [2, 1, 3]])).tolist() == [[1, 3]]


# -- orientation ------------------------------------------------------------------------------------------------------


def test_orientation_agrees_with_trimesh_on_randomly_turned_faces() -> None:
    sphere = sphere_mesh(3)
    generator = np.random.default_rng(0)
    turned = generator.random(sphere.n_faces) < 0.5
    faces = sphere.faces.copy()
    faces[turned] = faces[turned][:, ::-1]
    result = orientation(sphere.vertices, faces)
    assert np.array_equal(result.flips, turned)
    mended = faces.copy()
    mended[result.flips] = mended[result.flips][:, ::-1]
    other = trimesh.Trimesh(sphere.vertices, mended, process=False)
    assert other.is_winding_consistent
    assert other.volume > 0


def test_the_wall_of_a_cavity_may_look_inwards_and_what_is_in_it_outwards() -> None:
    ball = sphere_mesh(2)

    def nested(*inward: bool) -> TriangleMesh:
        shells = [
            TriangleMesh(ball.vertices * size, ball.faces[:, ::-1] if turned else ball.faces)
            for size, turned in zip((1.0, 0.6, 0.3), inward, strict=True)
        ]
        return odd_meshes.joined(odd_meshes.joined(shells[0], shells[1]), shells[2])

    for inward, inside_out in (((False, True, False), 0), ((False, False, False), 0), ((True, True, True), 2)):
        mesh = nested(*inward)
        result = orientation(mesh.vertices, mesh.faces)
        assert result.n_inside_out == inside_out
        assert result.flips.sum() == inside_out * ball.n_faces
    # Beside one another nothing is nested.
    beside = odd_meshes.joined(ball, TriangleMesh(ball.vertices * 0.5 + 5, ball.faces[:, ::-1]))
    assert orientation(beside.vertices, beside.faces).n_inside_out == 1


def test_one_sided_surfaces_are_left_alone_whatever_else_there_is() -> None:
    strip = odd_meshes.moebius_strip()
    mesh = odd_meshes.joined(strip, odd_meshes.flipped_faces())
    result = orientation(mesh.vertices, mesh.faces)
    assert result.one_sided.tolist() == [True] * strip.n_faces + [False] * (mesh.n_faces - strip.n_faces)
    assert not result.flips[: strip.n_faces].any()
    assert result.flips.sum() == 43


def test_corners_are_sorted_with_the_sense_of_the_permutation() -> None:
    faces = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]])
    ascending, is_odd = sorted_corners(faces)
    assert ascending.tolist() == [[0, 1, 2]] * 6
    assert is_odd.tolist() == [False, False, False, True, True, True]


# -- as text ----------------------------------------------------------------------------------------------------------


def test_the_description_tells_the_findings_and_how_to_mend_them() -> None:
    values = describe_mesh(odd_meshes.non_manifold_edge())
    assert [finding["kind"] for finding in values["findings"]] == ["non-manifold edges", "boundaries"]
    text = description_text({"file": "scan.ply", "notes": [], **values})
    assert "! 1 edge belongs to more than two faces." in text
    assert "'dmp repair --split' takes the sheets apart." in text
    clean = description_text({"file": "ball.ply", "notes": [], **describe_mesh(sphere_mesh(2))})
    assert "nothing odd was found" in clean


def test_a_mesh_without_faces_has_no_report() -> None:
    assert mesh_report(TriangleMesh(np.eye(3), np.zeros((0, 3), dtype=int))) == ()
    assert [finding.kind for finding in mesh_report(TriangleMesh(np.eye(3), np.array([[0, 0, 1]])))] == [
        "degenerate faces",
        "isolated vertices",
    ]
