"""Repair mends what the report finds, keeps the shape, says what it did, and finds nothing to do the second time."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from dmp.boundary import boundary_loops
from dmp.cap_removal import remove_flat_faces
from dmp.cli import main
from dmp.corner_groups import corner_groups, groups_at_vertices, pairs_over_edges
from dmp.errors import MeshError
from dmp.geometry import face_areas
from dmp.mesh import TriangleMesh
from dmp.mesh_report import mesh_report
from dmp.meshio import read_mesh, write_mesh
from dmp.repair import RepairOptions, repair
from dmp.topology import edge_face_counts, n_components
from tests import odd_meshes
from tests.meshes import grid_mesh, sphere_mesh
from tests.odd_meshes import ODD_MESHES

OPTIONS = [RepairOptions(), RepairOptions(split=True), RepairOptions(weld=1e-4, split=True, keep_pieces=1)]


def kinds(mesh: TriangleMesh) -> set[str]:
    return {finding.kind for finding in mesh_report(mesh)}


def assert_idempotent(mesh: TriangleMesh, options: RepairOptions) -> None:
    again = repair(mesh, options)
    assert again.changes == ()
    assert again.mesh is mesh
    assert np.array_equal(again.vertex_source, np.arange(mesh.n_vertices))


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("name", ODD_MESHES)
def test_what_can_be_mended_is_mended_once_and_for_all(name: str, options: RepairOptions) -> None:
    mesh = ODD_MESHES[name]()
    repaired = repair(mesh, options)
    assert not [finding.kind for finding in mesh_report(repaired.mesh) if finding.remedy == "repair"]
    assert np.array_equal(repaired.mesh.vertices, mesh.vertices[repaired.vertex_source])
    assert bool(repaired.changes) == (repaired.mesh is not mesh)
    assert_idempotent(repaired.mesh, options)


@st.composite
def soups(draw: st.DrawFn) -> TriangleMesh:
    """Any triangles at all, over few places, so that all kinds of coincidences occur."""
    n = draw(st.integers(3, 12))
    place = st.tuples(*[st.integers(0, 2) for _ in range(3)])
    vertices = np.array(draw(st.lists(place, min_size=n, max_size=n)), dtype=float)
    corner = st.integers(0, n - 1)
    faces = draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=24))
    return TriangleMesh(vertices, np.array(faces), {"color": np.arange(3 * n, dtype=np.uint8).reshape(n, 3)})


options_of_any_kind = st.builds(
    RepairOptions,
    weld=st.sampled_from([0.0, 0.05, 0.3]),
    split=st.booleans(),
    keep_pieces=st.integers(0, 2),
    fewest_faces=st.sampled_from([0, 2]),
)


@settings(max_examples=60, deadline=None)
@given(soups(), options_of_any_kind)
def test_repairing_twice_is_repairing_once(mesh: TriangleMesh, options: RepairOptions) -> None:
    try:
        repaired = repair(mesh, options).mesh
    except MeshError:
        return
    assert_idempotent(repaired, options)
    if options.split:
        assert edge_face_counts(repaired.faces)[1].max() <= 2
        groups = corner_groups(repaired.faces, pairs_over_edges(repaired.faces))
        assert (groups_at_vertices(repaired.faces, groups, repaired.n_vertices) == 1).all()


def test_what_was_done_is_said_with_counts() -> None:
    def texts(mesh: TriangleMesh, **options: object) -> list[str]:
        return [change.text for change in repair(mesh, RepairOptions(**options)).changes]  # type: ignore[arg-type]

    assert texts(odd_meshes.isolated_vertices()) == ["Removed 3 vertices without a face."]
    assert texts(odd_meshes.collapsed_faces()) == ["Removed 5 faces without area.", "Removed 1 vertex without a face."]
    assert texts(odd_meshes.duplicate_faces()) == ["Removed 9 faces that were there twice."]
    assert texts(odd_meshes.coincident_vertices()) == ["Joined 132 vertices with others at the same place."]
    assert texts(odd_meshes.flipped_faces()) == ["Turned 43 faces round, like those around them."]
    assert texts(odd_meshes.inside_out()) == ["Turned 1 closed piece, which was inside out."]
    assert texts(odd_meshes.non_manifold_vertex()) == []
    assert texts(odd_meshes.non_manifold_vertex(), split=True) == ["Split 1 vertex where the surface branches."]
    assert texts(odd_meshes.several_pieces(), keep_pieces=2) == [
        "Dropped 1 separate piece with 1 face in all.",
        "Removed 3 vertices without a face.",
    ]
    assert texts(sphere_mesh(2)) == []


# -- each kind --------------------------------------------------------------------------------------------------------


def test_joined_vertices_close_the_cracks() -> None:
    torn = odd_meshes.coincident_vertices()
    repaired = repair(torn).mesh
    ball = odd_meshes._ball()
    assert (repaired.n_vertices, repaired.n_faces) == (ball.n_vertices, ball.n_faces)
    assert trimesh.Trimesh(repaired.vertices, repaired.faces, process=False).is_watertight
    assert set(map(tuple, repaired.vertices)) == set(map(tuple, ball.vertices))


def test_welding_joins_what_is_near_and_makes_no_chains() -> None:
    # A row of points 0.4 apart, with triangles far larger: in chains all would become one.
    row = np.column_stack([np.arange(6) * 0.4, np.zeros(6), np.zeros(6)])
    far = np.column_stack([np.arange(6) * 0.4, np.full(6, 10.0), np.arange(6) % 2])
    faces = np.array([[i, i + 6, (i + 1) % 6 + 6] for i in range(6)])
    mesh = TriangleMesh(np.vstack([row, far]), faces)
    length = float(np.linalg.norm(mesh.vertices[faces] - np.roll(mesh.vertices[faces], 1, axis=1), axis=2).mean())
    kept = repair(mesh, RepairOptions(weld=0.5 / length)).mesh.vertices
    on_row = kept[kept[:, 1] == 0][:, 0]
    assert len(on_row) == 3
    assert np.diff(np.sort(on_row)).min() > 0.5
    # Places are those of the file, never means of several.
    assert set(on_row) <= set(row[:, 0])


def test_values_of_the_vertices_go_with_them() -> None:
    torn = odd_meshes.coincident_vertices()
    number = np.arange(torn.n_vertices)
    carrying = torn.with_attributes(color=np.column_stack([number % 256] * 3).astype(np.uint8), quality=number.astype(float))
    repaired = repair(carrying)
    assert np.array_equal(repaired.mesh.vertex_attributes["quality"], repaired.vertex_source.astype(float))
    assert np.array_equal(repaired.mesh.vertex_attributes["color"][:, 0], repaired.vertex_source % 256)
    assert any("the first one's were kept" in change.text for change in repaired.changes)
    same = torn.with_attributes(color=np.full((torn.n_vertices, 3), 7, dtype=np.uint8))
    assert not any("kept" in change.text for change in repair(same).changes)


def test_a_face_without_area_goes_and_leaves_no_slit() -> None:
    mesh = odd_meshes.cap()
    repaired = repair(mesh).mesh
    assert repaired.n_faces == mesh.n_faces
    assert repaired.n_vertices == mesh.n_vertices
    closed = trimesh.Trimesh(repaired.vertices, repaired.faces, process=False)
    assert closed.is_watertight and closed.is_winding_consistent
    assert closed.volume == pytest.approx(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume, rel=1e-12)
    assert face_areas(repaired.vertices, repaired.faces).min() > 1e-3


def test_a_flat_face_at_the_rim_is_left_out_and_many_in_a_row_are_flipped() -> None:
    sheet = grid_mesh(5)
    # A flat face that continues an edge of the rim: nothing is on the other side of its long side.
    more = TriangleMesh(np.vstack([sheet.vertices, [[-1.0, 0, 0]]]), np.vstack([sheet.faces, [[1, 0, 25]]]))
    faces, count = remove_flat_faces(more.vertices, more.faces)
    assert count == 1
    assert np.array_equal(faces, sheet.faces)
    # A comb of flat faces on one side of a large triangle: a fan over collinear points.
    points = np.column_stack([np.linspace(0, 1, 6), np.zeros(6), np.zeros(6)])
    apex = np.array([[0.5, -1.0, 0.0], [0.5, 1.0, 0.0]])
    vertices = np.vstack([points, apex])
    fan = [[i, i + 1, 6] for i in range(5)]
    comb = TriangleMesh(vertices, np.array([*(face[::-1] for face in fan), [0, 5, 7], *[[0, i, i + 1] for i in range(1, 5)]]))
    repaired = repair(comb).mesh
    assert not {"degenerate faces", "duplicate faces"} & kinds(repaired)
    assert face_areas(repaired.vertices, repaired.faces).sum() == pytest.approx(1.0)
    assert len(boundary_loops(repaired)) == 1


def test_taking_apart_makes_a_manifold_of_the_same_faces() -> None:
    for make in (odd_meshes.non_manifold_edge, odd_meshes.non_manifold_vertex, odd_meshes.fan):
        mesh = make()
        repaired = repair(mesh, RepairOptions(split=True))
        assert not {"non-manifold edges", "non-manifold vertices"} & kinds(repaired.mesh)
        before, after = mesh.vertices[mesh.faces], repaired.mesh.vertices[repaired.mesh.faces]
        assert np.array_equal(np.sort(before.reshape(len(before), -1)), np.sort(after.reshape(len(after), -1)))
        # The first vertices are those of the file.
        assert np.array_equal(repaired.mesh.vertices[: mesh.n_vertices], mesh.vertices)
    apart = repair(odd_meshes.non_manifold_vertex(), RepairOptions(split=True)).mesh
    assert n_components(apart.faces, apart.n_vertices) == 2


def test_the_two_sheets_that_continue_each_other_stay_together() -> None:
    # Two flat sheets that cross in a line: four faces at each edge there.
    flat, up = grid_mesh(5), grid_mesh(5)
    flat = flat.with_vertices(flat.vertices - [2, 2, 0])
    standing = up.with_vertices(np.column_stack([np.zeros(25), up.vertices[:, 1] - 2, up.vertices[:, 0] - 2]))
    both = odd_meshes.joined(flat, standing)
    places, numbers = np.unique(both.vertices, axis=0, return_inverse=True)
    crossed = TriangleMesh(places, numbers.ravel()[both.faces])
    assert "non-manifold edges" in kinds(crossed)
    apart = repair(crossed, RepairOptions(split=True)).mesh
    assert n_components(apart.faces, apart.n_vertices) == 2
    assert len(boundary_loops(apart)) == 2
    # Joined in the first place they stay joined unless asked, and apart they stay apart.
    assert repair(crossed).mesh is crossed
    assert repair(both).changes == ()
    assert kinds(both) == kinds(apart) == {"touching surfaces", "boundaries", "separate pieces"}


def test_bodies_that_touch_are_not_joined_and_their_cracks_are() -> None:
    cube = trimesh.creation.box((1, 1, 1))
    first = TriangleMesh(cube.vertices, cube.faces)
    touching = odd_meshes.joined(first, first.with_vertices(first.vertices + np.array([1.0, 1.0, 0.0])))
    repaired = repair(touching)
    assert repaired.changes == ()
    assert kinds(touching) == {"touching surfaces", "separate pieces"}
    # Every face with corners of its own, as in an STL file.
    soup = TriangleMesh(touching.vertices[touching.faces].reshape(-1, 3), np.arange(3 * touching.n_faces).reshape(-1, 3))
    joined = repair(soup)
    assert [change.text for change in joined.changes] == ["Joined 56 vertices with others at the same place."]
    assert (joined.mesh.n_vertices, n_components(joined.mesh.faces, 16)) == (16, 2)
    assert trimesh.Trimesh(joined.mesh.vertices, joined.mesh.faces, process=False).is_watertight
    assert kinds(joined.mesh) == {"touching surfaces", "separate pieces"}


def test_pieces_are_kept_by_number_or_size() -> None:
    mesh = odd_meshes.several_pieces()
    assert repair(mesh, RepairOptions(keep_pieces=2)).mesh.n_faces == 256
    assert repair(mesh, RepairOptions(fewest_faces=2)).mesh.n_faces == 256
    only = repair(mesh, RepairOptions(keep_pieces=1)).mesh
    # Of two equally large ones the first.
    assert np.array_equal(only.vertices, odd_meshes._ball().vertices)
    with pytest.raises(MeshError, match=r"No piece of this mesh has 1,000 faces; the largest has 128\."):
        repair(mesh, RepairOptions(fewest_faces=1000))


def test_nothing_left_is_refused_and_impossible_options_too() -> None:
    with pytest.raises(MeshError, match="Nothing would be left"):
        repair(TriangleMesh(np.eye(3), np.array([[0, 0, 1]])))
    with pytest.raises(MeshError, match="nearer to each other"):
        repair(odd_meshes.needles(), RepairOptions(weld=0.5))
    for options in ({"weld": 1.0}, {"weld": -0.1}, {"weld": float("nan")}, {"keep_pieces": -1}, {"fewest_faces": -1}):
        with pytest.raises(MeshError):
            RepairOptions(**options)


def test_a_clean_mesh_is_returned_itself() -> None:
    sphere = sphere_mesh(2)
    repaired = repair(sphere, RepairOptions(split=True))
    assert repaired.mesh is sphere
    assert repaired.changes == ()


# -- from the command line --------------------------------------------------------------------------------------------


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    def call(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as end:
            main([str(argument) for argument in arguments])
        said = capsys.readouterr()
        return end.value.code, said.out, said.err  # type: ignore[return-value]

    return call


def test_the_command_mends_and_tells(run: Callable[..., tuple[int, str, str]], tmp_path: Path) -> None:
    scan, mended = tmp_path / "scan.ply", tmp_path / "mended.ply"
    torn = odd_meshes.coincident_vertices()
    write_mesh(scan, torn.with_attributes(color=np.full((torn.n_vertices, 3), 90, dtype=np.uint8)))
    before = scan.read_bytes()
    code, out, err = run("repair", scan, "-o", mended)
    assert (code, out) == (0, "")
    assert err.splitlines() == [
        "Joined 132 vertices with others at the same place.",
        f"The repaired mesh with 66 vertices and 128 faces was written to {mended}.",
    ]
    assert read_mesh(mended).vertex_attributes["color"].tolist() == [[90] * 3] * 66
    assert scan.read_bytes() == before
    code, out, err = run("repair", mended, "-o", tmp_path / "again.ply", "--json")
    assert json.loads(out)["changes"] == []
    assert (code, err) == (0, "")
    assert np.array_equal(read_mesh(tmp_path / "again.ply").vertices, read_mesh(mended).vertices)


def test_the_command_tells_what_is_left_and_how_to_mend_it(run: Callable[..., tuple[int, str, str]], tmp_path: Path) -> None:
    write_mesh(tmp_path / "a.ply", odd_meshes.non_manifold_edge())
    _, _, err = run("repair", tmp_path / "a.ply", "-o", tmp_path / "b.ply")
    assert "Nothing had to be repaired." in err
    assert "--split" in err
    code, _, err = run("repair", tmp_path / "a.ply", "-o", tmp_path / "b.ply", "--split", "--keep-components", 1)
    assert code == 0
    assert "Split 2 vertices" in err and "Dropped 1 separate piece" in err and "What is left" not in err
    assert read_mesh(tmp_path / "b.ply").n_faces == 128


@pytest.mark.parametrize("link", [False, True])
def test_the_command_never_writes_over_its_input(run: Callable[..., tuple[int, str, str]], tmp_path: Path, link: bool) -> None:
    scan = tmp_path / "scan.ply"
    write_mesh(scan, odd_meshes.coincident_vertices())
    before = scan.read_bytes()
    output = scan
    if link:
        output = tmp_path / "other.ply"
        output.symlink_to(scan)
    code, _, err = run("repair", scan, "-o", output)
    assert code == 2
    assert "this is the file that is read" in err
    assert scan.read_bytes() == before


@pytest.mark.parametrize("option", [("--weld", "2"), ("--keep-pieces", "-1"), ("--weld", "much")])
def test_impossible_options_are_refused(
    run: Callable[..., tuple[int, str, str]], tmp_path: Path, option: tuple[str, str]
) -> None:
    write_mesh(tmp_path / "scan.ply", sphere_mesh(2))
    code, _, err = run("repair", tmp_path / "scan.ply", "-o", tmp_path / "b.ply", *option)
    assert code == 2
    assert err.startswith("dmp: ") and err.count("\n") == 1
    assert not (tmp_path / "b.ply").exists()
